"""`PreparedLayouts`: a layout source that has the next layout of every world ready, so that a reset only copies.

Layouts are pure functions of (scene, split, seed, episode), so the next one of a world can be made as soon as it has
got the last one: on a GPU on a stream of its own, beside the steps that follow. Few layouts take about as long as many,
so worlds wait until there are more of them. Nobody waits for what is being made: a layout that is not ready when it is
wanted, because it is still being made or the world was reseeded, is made in place. Either way it is the same layout.
"""

import sys
import weakref
from collections.abc import Callable
from typing import Any

import warp as wp

from sceniris_gym.device.launch_lock import launching
from sceniris_gym.device.pickling import StaysHere
from sceniris_gym.device.sequence import LaunchSequence, repeat_launches, repeats_in_graphs
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, check_type
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.seeds import launch_reseed
from sceniris_gym.layout.wave.rounds import count_rejections

wp.set_module_options({"enable_backward": False})

_FIRST = -1
"""Priority of what is made ahead: its many short kernels go before the long ones of physics, not after each of them."""

_MANY = 4
"""One world in so many is enough to make layouts ahead for all that wait."""

_PATIENCE = 32
"""After so many resets since the first one began to wait, layouts are made ahead for however few."""

_kept_longer: list[tuple[wp.Event | None, tuple[Any, ...]]] = []
"""Memory of sources that were collected while something was captured, and the events that it is kept for."""


_WAITING = wp.constant(0)
_BEING_MADE = wp.constant(1)
_READY = wp.constant(2)
"""Stages of a world's next layout: it is to be made ahead, is being made, or has been made."""


@wp.kernel
def _find_missing(
    # Layouts in: seed, episode
    served: LayoutsView,
    # Layouts in: seed, episode
    prepared: LayoutsView,
    # In:
    mask: wp.array[bool],
    # In and out:
    stage: wp.array[int],
    nwaiting: wp.array[int],
    # Out:
    missing: wp.array[bool],
):
    worldid = wp.tid()
    missing[worldid] = False
    if mask:
        if not mask[worldid]:
            return
    # Atomic, as what is made beside this may become ready meanwhile.
    known = wp.atomic_exch(stage, worldid, _WAITING)
    if known != _WAITING:
        wp.atomic_add(nwaiting, 0, 1)
    missing[worldid] = True
    if known == _READY:
        if prepared.seed[worldid] == served.seed[worldid]:
            missing[worldid] = prepared.episode[worldid] != served.episode[worldid] + 1


@wp.kernel
def _serve(
    # Layouts in: episode, qpos, mocap_pos, mocap_quat, status, attempts, first_pass_valid, present, grasp, grasp_qpos,
    #   pregrasp_qpos, row_rejections
    prepared: LayoutsView,
    # In:
    mask: wp.array[bool],
    missing: wp.array[bool],
    # Layouts in: rejections, pending_episode, row_rejections
    # Layouts out: episode, qpos, mocap_pos, mocap_quat, status, attempts, first_pass_valid, present, grasp, grasp_qpos,
    #   pregrasp_qpos, rejections
    served: LayoutsView,
):
    worldid, i = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    # Worlds whose layouts were made in place advance here too, so that all of them do, or, where somebody interrupts
    # the launches, none.
    if missing[worldid]:
        if i == 0:
            served.episode[worldid] = served.pending_episode[worldid]
        if i < served.rejections.shape[0]:
            count_rejections(served, worldid, i, served.rejections)
        return
    if i < served.rejections.shape[0]:
        count_rejections(prepared, worldid, i, served.rejections)
    if i == 0:
        served.episode[worldid] = prepared.episode[worldid]
        served.status[worldid] = prepared.status[worldid]
        served.attempts[worldid] = prepared.attempts[worldid]
        served.first_pass_valid[worldid] = prepared.first_pass_valid[worldid]
    if i < served.qpos.shape[1]:
        served.qpos[worldid, i] = prepared.qpos[worldid, i]
    if i < served.mocap_pos.shape[1]:
        served.mocap_pos[worldid, i] = prepared.mocap_pos[worldid, i]
        served.mocap_quat[worldid, i] = prepared.mocap_quat[worldid, i]
    if i < served.present.shape[1]:
        served.present[worldid, i] = prepared.present[worldid, i]
    if i < served.grasp.shape[1]:
        served.grasp[worldid, i] = prepared.grasp[worldid, i]
        for j in range(served.grasp_qpos.shape[2]):
            served.grasp_qpos[worldid, i, j] = prepared.grasp_qpos[worldid, i, j]
            served.pregrasp_qpos[worldid, i, j] = prepared.pregrasp_qpos[worldid, i, j]


@wp.kernel
def _decide(
    many: int,
    most_patience: int,
    due: wp.array[int],
    # In and out:
    nwaiting: wp.array[int],
    patience: wp.array[int],
    begins: wp.array[int],
):
    # What begins and was not published, as somebody interrupted the launches, still does.
    if begins[0] == 1 or nwaiting[0] == 0 or due[0] == 1:
        return
    patience[0] = patience[0] - 1
    if nwaiting[0] >= many or patience[0] <= 0:
        begins[0] = 1
        nwaiting[0] = 0
        patience[0] = most_patience


@wp.kernel
def _begin(
    # Layouts in: seed, episode
    served: LayoutsView,
    # In:
    begins: wp.array[int],
    # Out:
    stage: wp.array[int],
    being_made: wp.array[bool],
    # Layouts out: seed, episode
    prepared: LayoutsView,
):
    worldid = wp.tid()
    if begins[0] == 0:
        return
    # Nothing is being made when this begins, unless somebody interrupted the launches after it began before.
    chosen = stage[worldid] != _READY
    being_made[worldid] = chosen
    if chosen:
        stage[worldid] = _BEING_MADE
        prepared.seed[worldid] = served.seed[worldid]
        prepared.episode[worldid] = served.episode[worldid]


@wp.kernel
def _publish(
    # In and out:
    begins: wp.array[int],
    # Out:
    due: wp.array[int],
):
    if begins[0] == 1:
        begins[0] = 0
        due[0] = 1


@wp.kernel
def _finish(
    being_made: wp.array[bool],
    # In and out:
    stage: wp.array[int],
):
    worldid = wp.tid()
    if being_made[worldid]:
        # A world that was reset meanwhile goes on waiting.
        wp.atomic_cas(stage, worldid, _BEING_MADE, _READY)


class PreparedLayouts(StaysHere):
    """Serves what was made ahead, or makes it; a `LayoutSource` as the generator is, with the same layouts.

    It needs the memory of a second generator. Resets are made through `serve`, as a `ResetRandomizer` does. In a
    capture of the caller's own nothing is made ahead: the graph makes what it needs in place.

    Args:
        generator: Makes what is not ready; nobody else may use it from now on. Another one like it works ahead.
        stream: Where layouts are made ahead on a GPU; None takes `side_stream`.
        graph: Capture what is made ahead into a graph and replay it.

    Attributes:
        layouts: The rows served last, the generator's.

    Raises:
        ArgumentTypeError: A generator of a class of its own, which might make other layouts than one that works ahead.
            Or a stream of another type.
        ArgumentError: A generator that records rejected candidates: it would not see those of layouts made ahead. Or a
            stream of another device.
    """

    @launching
    def __init__(self, generator: LayoutGenerator, stream: wp.Stream | None = None, *, graph: bool = True) -> None:
        _check_generator(generator)
        _check_stream(stream, wp.get_device(generator.compiled.device))
        compiled, nworld = generator.compiled, generator.nworld
        ahead = LayoutGenerator(compiled, nworld, split=generator.split, size=generator.size)
        self.layouts = generator.layouts
        self._generator, self._ahead = generator, ahead
        device = self._device = wp.get_device(compiled.device)
        # Graphs without loops would make the last ones again at every replay, also while they are served.
        self._works_ahead = repeats_in_graphs(device) or not graph
        being_made, self._missing = (wp.zeros(nworld, dtype=wp.bool, device=device) for _ in range(2))
        self._being_made = being_made
        stage = self._stage = wp.full(nworld, _READY, dtype=int, device=device)
        self._nwaiting, self._begins, due = (wp.zeros(1, dtype=int, device=device) for _ in range(3))
        self._patience, self._due = wp.full(1, _PATIENCE, dtype=int, device=device), due

        def make() -> None:
            ahead.launch_generate(being_made)
            wp.launch(_finish, dim=nworld, inputs=[being_made], outputs=[stage], device=device)
            due.zero_()

        self._make = LaunchSequence(lambda: repeat_launches(due, make, 1), device, graph=graph, priority=_FIRST)
        self._stream = self._done = self._served = None
        if device.is_cuda:
            self._stream = side_stream(device) if stream is None else stream
            self._served, self._done = wp.Event(device), wp.Event(device)
            # Events, as Warp does not order streams for us where the current one is CUDA's default stream.
            device.stream.record_event(self._served)
            self._stream.wait_event(self._served)
            self._stream.record_event(self._done)
        # Memory that is still written to must not be given to anybody else: what is passed here lives until then.
        weakref.finalize(self, _wait, self._done, ahead, self._make)

    def serve(self, reset: Callable[[], None]) -> None:
        """Run launches with `launch_generate` among them, then let the next layouts of the same worlds be made.

        Args:
            reset: Makes the launches, or replays a graph of them.
        """
        reset()
        if self._works_ahead and not self._device.is_capturing:
            self._launch_begin()
            self._make_beside()

    def _launch_begin(self) -> None:
        """Choose the worlds whose next layouts are made now, if enough of them wait, or long enough.

        The device decides, as the host is many steps ahead of it. What is made beside is asked for last: it may look
        at any time whether it is.
        """
        nworld, device = self.layouts.nworld, self._device
        inputs, outputs = [-(-nworld // _MANY), _PATIENCE, self._due], [self._nwaiting, self._patience, self._begins]
        wp.launch(_decide, dim=1, inputs=inputs, outputs=outputs, device=device)
        inputs, outputs = [self.layouts.view, self._begins], [self._stage, self._being_made, self._ahead.layouts.view]
        wp.launch(_begin, dim=nworld, inputs=inputs, outputs=outputs, device=device)
        wp.launch(_publish, dim=1, outputs=[self._begins, self._due], device=device)

    def _make_beside(self) -> None:
        """Make the layouts of the chosen worlds, on a GPU beside what is launched afterwards.

        Where resets follow each other faster than they are done, their stream does not wait for that of the steps, but
        looks whether anything is due: a GPU on which work of one stream always waits for another one starts each kernel
        later. Where the last reset is done, this one may be the last for a while, so it is waited for.
        """
        if self._stream is None or self._served is None:
            self._make()
            return
        seldom = self._served.is_complete
        self._device.stream.record_event(self._served)
        with wp.ScopedStream(self._stream, sync_enter=False):
            try:
                if seldom:
                    self._stream.wait_event(self._served)
                self._make()
            finally:
                self._stream.record_event(self._done)

    def launch_reseed(self, seeds: wp.array, mask: wp.array | None) -> None:
        """See `LayoutSource`."""
        launch_reseed(seeds, mask, self.layouts.seed, self.layouts.episode)

    def launch_generate(self, mask: wp.array | None) -> None:
        """See `LayoutSource`; called within `serve`."""
        served, prepared, missing = self.layouts.view, self._ahead.layouts.view, self._missing
        nworld, device = self.layouts.nworld, self._device
        outputs = [self._stage, self._nwaiting, missing]
        wp.launch(_find_missing, dim=nworld, inputs=[served, prepared, mask], outputs=outputs, device=device)
        self._generator.launch_make(missing)
        width = max(a.shape[1] for a in (served.qpos, served.mocap_pos, served.present, served.grasp))
        width = max(width, served.rejections.shape[0])
        inputs = [prepared, mask, missing]
        wp.launch(_serve, dim=(nworld, width), inputs=inputs, outputs=[served], device=device)

    def rejection_counts(self) -> dict[str, dict[str, int]]:
        """See `LayoutSource`: layouts that were made ahead count once they are served, and those made twice once."""
        return self._generator.rejection_counts()


def _check_generator(generator: LayoutGenerator) -> None:
    """Refuse a generator that another one cannot stand in for."""
    check_type(generator, LayoutGenerator, "PreparedLayouts: generator")
    if type(generator) is not LayoutGenerator:
        raise ArgumentTypeError(
            "PreparedLayouts: generator should be a LayoutGenerator itself, as another one makes layouts ahead, got "
            f"one of class {type(generator).__name__}. Use it as layout_source without PreparedLayouts."
        )
    if generator.layouts.view.rejected_object.shape[0] > 0:
        raise ArgumentError(
            "PreparedLayouts: generator should not record rejected candidates, as those of layouts made ahead would be "
            "missing. Make it with rejected=0, or use it as layout_source without PreparedLayouts."
        )


def _check_stream(stream: wp.Stream | None, device: wp.Device) -> None:
    if stream is None:
        return
    check_type(stream, wp.Stream, "PreparedLayouts: stream")
    if stream.device != device:
        raise ArgumentError(f"PreparedLayouts: stream should be one of {device}, got one of {stream.device}.")


def side_stream(device: wp.Device) -> wp.Stream:
    """Return a new stream that runs beside the one that steps are launched on.

    CUDA runs nothing beside its default stream but what is on streams that were made non-blocking. Torch launches on
    the default stream and makes its own ones non-blocking, so where it is in use the stream is one of torch's; Warp
    launches on a stream of its own.
    """
    if (torch := sys.modules.get("torch")) is not None and torch.cuda.is_available():
        return wp.stream_from_torch(torch.cuda.Stream(str(device), priority=_FIRST))
    return wp.Stream(device, priority=_FIRST)


def _wait(done: wp.Event | None, *kept: Any) -> None:
    """Wait until what was made ahead last is done; in a capture nobody may wait, so what is kept is kept for longer."""
    _kept_longer.append((done, kept))
    if done is not None and done.device.is_capturing:
        return
    while _kept_longer:
        event, _ = _kept_longer[-1]
        if event is not None:
            wp.synchronize_event(event)
        _kept_longer.pop()
