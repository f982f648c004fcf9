"""`PreparedLayouts`: a layout source that has the next layout of every world ready, so that a reset only copies.

Layouts are pure functions of (scene, split, seed, episode), so the next one of a world can be made as soon as it has
got the last one: on a GPU on a stream of its own, beside the steps that follow. What is not ready when it is wanted,
because the world was reseeded, is made in place. Either way it is the same layout.
"""

from __future__ import annotations

import sys
import weakref
from collections.abc import Callable
from typing import Any

import warp as wp

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Layouts, LayoutsView
from sceniris_gym.layout.seeds import launch_reseed
from sceniris_gym.layout.sequence import LaunchSequence

wp.set_module_options({"enable_backward": False})

_FIRST = -1
"""Priority of what is made ahead: its many short kernels go before the long ones of physics, not after each of them."""

_kept_longer: list[tuple[wp.Event | None, tuple[Any, ...]]] = []
"""Memory of sources that were collected while something was captured, and the events that it is kept for."""


@wp.kernel
def _find_missing(
    served: LayoutsView,
    mask: wp.array(dtype=bool),
    # Prepared in and out:
    prepared: LayoutsView,
    # Out:
    wanted: wp.array(dtype=bool),
    missing: wp.array(dtype=bool),
):
    worldid = wp.tid()
    wanted[worldid] = False
    missing[worldid] = False
    if mask:
        if not mask[worldid]:
            return
    wanted[worldid] = True
    seed = served.seed[worldid]
    episode = served.episode[worldid]
    if prepared.seed[worldid] != seed or prepared.episode[worldid] != episode + 1:
        missing[worldid] = True
        prepared.seed[worldid] = seed
        prepared.episode[worldid] = episode


@wp.kernel
def _serve(
    prepared: LayoutsView,
    wanted: wp.array(dtype=bool),
    # Layouts out:
    served: LayoutsView,
):
    worldid, i = wp.tid()
    if not wanted[worldid]:
        return
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


class PreparedLayouts:
    """Serves what a generator has made ahead; a `LayoutSource` as the generator is, with the same layouts.

    It needs the memory of a second batch of `Layouts`. Resets are made through `serve`, as a `ResetRandomizer` does; it
    sees to the order of the two streams. In a capture of the caller's own nothing is made ahead: the graph makes what
    it needs in place.

    Args:
        generator: Makes the layouts; nobody else may use it from now on.
        stream: Where they are made ahead on a GPU; None takes `side_stream`.
        graph: Capture what is made ahead into a graph and replay it.

    Attributes:
        layouts: The rows served last. Its `rejections` count those of layouts made ahead too.
    """

    def __init__(self, generator: LayoutGenerator, stream: wp.Stream | None = None, *, graph: bool = True) -> None:
        self.layouts = Layouts.create(generator.compiled, generator.nworld)
        self.layouts.view.rejections = generator.layouts.view.rejections
        self._generator, nworld = generator, generator.nworld
        self._device = wp.get_device(generator.compiled.device)
        wanted, self._missing = (wp.zeros(nworld, dtype=wp.bool, device=self._device) for _ in range(2))
        self._wanted = wanted
        wp.copy(self.layouts.seed, generator.layouts.seed)
        self._make_ahead = LaunchSequence(
            lambda: generator.launch_generate(wanted), self._device, graph=graph, priority=_FIRST
        )
        self._stream = self._ready = self._served = None
        if self._device.is_cuda:
            self._stream = side_stream(self._device) if stream is None else stream
            self._ready, self._served = wp.Event(self._device), wp.Event(self._device)
            with wp.ScopedStream(self._stream):
                wp.record_event(self._ready)
        # Memory that is still written to must not be given to anybody else: what is passed here lives until then.
        weakref.finalize(self, _wait, self._ready, generator, wanted, self._missing, self._make_ahead)

    def serve(self, reset: Callable[[], None]) -> None:
        """Run launches with `launch_generate` among them, then let the next layouts of the same worlds be made.

        Args:
            reset: Makes the launches, or replays a graph of them.
        """
        if self._device.is_capturing:
            if self._ready is not None:  # as of every replay
                wp.wait_event(self._ready, external=True)
            reset()
            return
        if self._ready is None:
            reset()
            self._make_ahead()
            return
        wp.wait_event(self._ready)
        reset()
        # An event, as Warp does not order streams for us where the current one is CUDA's default stream.
        wp.record_event(self._served)
        with wp.ScopedStream(self._stream, sync_enter=False):
            try:
                wp.wait_event(self._served)
                self._make_ahead()
            finally:
                wp.record_event(self._ready)

    def launch_reseed(self, seeds: wp.array, mask: wp.array | None) -> None:
        """See `LayoutSource`."""
        launch_reseed(seeds, mask, self.layouts.seed, self.layouts.episode)

    def launch_generate(self, mask: wp.array | None) -> None:
        """See `LayoutSource`; called within `serve`."""
        served, prepared = self.layouts.view, self._generator.layouts.view
        outputs = [prepared, self._wanted, self._missing]
        wp.launch(_find_missing, dim=self.layouts.nworld, inputs=[served, mask], outputs=outputs, device=self._device)
        self._generator.launch_generate(self._missing)
        width = max(a.shape[1] for a in (served.qpos, served.mocap_pos, served.present, served.grasp))
        dim = (self.layouts.nworld, max(width, 1))
        wp.launch(_serve, dim=dim, inputs=[prepared, self._wanted], outputs=[served], device=self._device)

    def rejection_counts(self) -> dict[str, dict[str, int]]:
        """How many candidates were rejected so far, those of layouts made ahead among them; see `LayoutSource`."""
        if self._ready is not None:
            wp.wait_event(self._ready)
        return self._generator.rejection_counts()


def side_stream(device: wp.Device) -> wp.Stream:
    """Return a new stream that runs beside the one that steps are launched on.

    CUDA runs nothing beside its default stream but what is on streams that were made non-blocking. Torch launches on
    the default stream and makes its own ones non-blocking, so where it is in use the stream is one of torch's; Warp
    launches on a stream of its own.
    """
    if (torch := sys.modules.get("torch")) is not None and torch.cuda.is_available():
        return wp.stream_from_torch(torch.cuda.Stream(str(device), priority=_FIRST))
    return wp.Stream(device, priority=_FIRST)


def _wait(ready: wp.Event | None, *kept: Any) -> None:
    """Wait until what was made ahead last is done; in a capture nobody may wait, so what is kept is kept for longer."""
    _kept_longer.append((ready, kept))
    if ready is not None and ready.device.is_capturing:
        return
    while _kept_longer:
        done, _ = _kept_longer[-1]
        if done is not None:
            wp.synchronize_event(done)
        _kept_longer.pop()
