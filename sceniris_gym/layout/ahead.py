"""`Ahead`: prefetches the next layout of every world, so that a reset only copies it.

A layout is a pure function of (scene, split, seed, episode), so it can be made as soon as the world's present layout is
served. On a GPU, prefetching runs on a separate stream, concurrently with the following steps. Making a few layouts
takes about as long as making many, so a prefetch starts only once a large enough fraction of the worlds lacks a
prefetched layout, or a world has lacked one for many resets. The required fraction grows with every prefetch, and drops
when a world is reset before its layout is ready. A reset never waits for a prefetch. If the layout is not ready, or if
the world was reseeded, the reset itself makes the layout, with the same result.

The device decides when a prefetch starts, because the host is many steps ahead. The device counts its decisions, and
the host launches prefetches when it reads a new number. A launch at every reset, which the device would mostly skip,
slows a step down by up to 3%.
"""

import sys
import weakref
from typing import Any

import warp as wp

from sceniris_gym.device.fixed import StaysHere
from sceniris_gym.device.sequence import LaunchSequence, launching, repeat_launches, repeats_in_graphs
from sceniris_gym.errors import ArgumentError, check_type
from sceniris_gym.layout.layouts import LayoutsView, close_episode, copy_layout, layout_width, next_key, open_episode
from sceniris_gym.layout.masks import selects
from sceniris_gym.layout.seeds import count_rejections
from sceniris_gym.layout.source import LayoutSource

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_FIRST = -1
"""Stream priority of prefetching on a GPU, so that its many short kernels do not queue behind long physics kernels."""

_LEAST, _MOST, _MORE = (wp.constant(share) for share in (1.0 / 4.0, 2.0 / 3.0, 1.0 / 64.0))
"""Limits and growth of the fraction of the worlds that should wait for layouts before a prefetch starts.

The fraction is from `_LEAST` to `_MOST`, and grows by `_MORE` with each prefetch. When a world is reset before its
layout is ready, the fraction drops to `_LEAST`.
"""

_PATIENCE = 32
"""Maximum number of resets that a world waits before a prefetch starts."""

_LAUNCHES = 3
"""Number of resets at which the host launches a prefetch after it has read a new number of decisions.

With rare resets, the first launch may come too late, and the next prefetch is decided on only after that launch.
"""

_kept_longer: list[tuple[wp.Event | None, tuple[Any, ...]]] = []
"""Memory of makers that were garbage-collected during a capture, each with the event that releases it."""


_WAITING = wp.constant(0)
_BEING_MADE = wp.constant(1)
_READY = wp.constant(2)
"""Stages of a world's next layout."""


@wp.func
def _has_other_params(served: LayoutsView, prepared: LayoutsView, worldid: int) -> bool:
    """Return whether a world's prefetched layout has other param values than the world's next layout should have."""
    found = bool(False)
    for k in range(served.next_param.shape[1]):
        if prepared.next_param[worldid, k] != served.next_param[worldid, k]:
            found = True
    return found


@wp.kernel
def _find_missing(
    # Layouts in: seed, episode, next*, stream, next_param; out: draws*, pending*
    served: LayoutsView,
    # Layouts in: seed, episode, next_param
    prepared: LayoutsView,
    # In:
    mask: wp.array[bool],
    # In and out:
    stage: wp.array[int],
    nwaiting: wp.array[int],
    enough: wp.array[float],
    # Out:
    missing: wp.array[bool],
):
    worldid = wp.tid()
    missing[worldid] = False
    if not selects(mask, worldid):
        return
    # atomic, because a prefetch on the other stream may set the stage to READY at any time
    known = wp.atomic_exch(stage, worldid, _WAITING)
    if known != _WAITING:
        wp.atomic_add(nwaiting, 0, 1)
    missing[worldid] = True
    if known != _READY:
        enough[0] = 0.0
    else:
        seed, episode = next_key(served, worldid)
        if prepared.seed[worldid] == seed:
            if prepared.episode[worldid] == episode:
                missing[worldid] = _has_other_params(served, prepared, worldid)
    if missing[worldid]:
        open_episode(served, worldid)


@wp.kernel
def _forget(
    # Layouts in: next_param
    served: LayoutsView,
    # Layouts in: next_param
    prepared: LayoutsView,
    mask: wp.array[bool],
    # In and out:
    stage: wp.array[int],
    nwaiting: wp.array[int],
):
    worldid = wp.tid()
    if not selects(mask, worldid):
        return
    if _has_other_params(served, prepared, worldid):
        if wp.atomic_exch(stage, worldid, _WAITING) != _WAITING:
            wp.atomic_add(nwaiting, 0, 1)


@wp.kernel
def _serve(
    # Layouts in: draws*, state*, choices*, grasps*, counts*, pending*, next_param, row_rejections
    prepared: LayoutsView,
    # In:
    mask: wp.array[bool],
    missing: wp.array[bool],
    # Layouts in: pending*, next_param, row_rejections; out: key*, state*, choices*, grasps*, counts*, next_episode;
    #   both: draws*, rejections
    served: LayoutsView,
):
    worldid, i = wp.tid()
    if not selects(mask, worldid):
        return
    # Worlds whose layouts were made in place also advance here, so that an interrupt cannot advance only some worlds.
    if missing[worldid]:
        if i == 0:
            close_episode(served, served, worldid)
        if i < served.rejections.shape[0]:
            count_rejections(served, worldid, i, served.rejections)
        return
    if i < served.rejections.shape[0]:
        count_rejections(prepared, worldid, i, served.rejections)
    if i == 0:
        close_episode(prepared, served, worldid)
        served.status[worldid] = prepared.status[worldid]
        served.attempts[worldid] = prepared.attempts[worldid]
        served.first_pass_valid[worldid] = prepared.first_pass_valid[worldid]
    copy_layout(prepared, worldid, served, worldid, i)


@wp.kernel
def _decide(
    nworld: int,
    most_patience: int,
    due: wp.array[int],
    # In and out:
    enough: wp.array[float],
    nwaiting: wp.array[int],
    patience: wp.array[int],
    begins: wp.array[int],
):
    # An interrupt may leave a prefetch begun but not published: `_publish` runs next and publishes it.
    if begins[0] == 1 or nwaiting[0] == 0 or due[0] == 1:
        return
    patience[0] = patience[0] - 1
    share = wp.clamp(enough[0], _LEAST, _MOST)
    if float(nwaiting[0]) >= share * float(nworld) or patience[0] <= 0:
        begins[0] = 1
        nwaiting[0] = 0
        patience[0] = most_patience
        enough[0] = share + _MORE


@wp.kernel
def _begin(
    # Layouts in: seed, episode, next*, next_param
    served: LayoutsView,
    # In:
    begins: wp.array[int],
    # Out:
    stage: wp.array[int],
    being_made: wp.array[bool],
    # Layouts out: next*, next_param
    prepared: LayoutsView,
):
    worldid = wp.tid()
    if begins[0] == 0:
        return
    # A world is BEING_MADE here only if an interrupt followed this kernel in an earlier reset. It is chosen again.
    chosen = stage[worldid] != _READY
    being_made[worldid] = chosen
    if chosen:
        stage[worldid] = _BEING_MADE
        seed, episode = next_key(served, worldid)
        prepared.next_seed[worldid] = seed
        prepared.next_episode[worldid] = episode
        for k in range(served.next_param.shape[1]):
            prepared.next_param[worldid, k] = served.next_param[worldid, k]


@wp.kernel
def _publish(
    # In and out:
    begins: wp.array[int],
    # Out:
    due: wp.array[int],
    # In and out:
    ndecided: wp.array[int],
):
    if begins[0] == 1:
        begins[0] = 0
        due[0] = 1
        ndecided[0] = ndecided[0] + 1


@wp.kernel
def _finish(
    being_made: wp.array[bool],
    # In and out:
    stage: wp.array[int],
):
    worldid = wp.tid()
    if being_made[worldid]:
        # a world that was reset in the meantime stays WAITING
        wp.atomic_cas(stage, worldid, _BEING_MADE, _READY)


class Ahead(StaysHere):
    """Prefetches the next layouts of worlds, as a part of a `LayoutPipeline`.

    Prefetching needs the memory of a second maker. While the caller captures a graph, prefetching is off, and resets in
    the captured graph make layouts themselves.

    Args:
        maker: The source of the layouts. Between `launch_open` and `launch_close`, the maker makes the layouts that are
            not prefetched. Its `twin` prefetches.
        stream: The stream for prefetching, used only on a GPU. If None, `side_stream` creates it.
        graph: Whether to capture the launches of a prefetch into a graph and replay it.

    Attributes:
        maker: The maker.
        missing: Worlds that have no fitting prefetched layout, so that the maker makes their layouts in the present
            reset, shape (nworld,), bool.

    Raises:
        ArgumentTypeError: A maker without a `twin`, or a stream of another type.
        ArgumentError: A `twin` of another scene, split or number of worlds, or a stream of another device. Or a
            generator that records rejected candidates, because the record would lack the candidates of prefetched
            layouts.
    """

    @launching
    def __init__(self, maker: LayoutSource, stream: wp.Stream | None = None, *, graph: bool = True) -> None:
        check_type(maker, LayoutSource, "Ahead: maker")
        device = self._device = maker.layouts.view.seed.device
        if stream is not None:
            check_type(stream, wp.Stream, "Ahead: stream")
            if stream.device != device:
                raise ArgumentError(f"Ahead: stream should be on {device}, got a stream on {stream.device}.")
        nworld, ahead = maker.layouts.nworld, maker.twin()
        self.maker, self._layouts, self._ahead = maker, maker.layouts, ahead
        check_type(ahead, LayoutSource, "Ahead: maker.twin()")
        rows = [(of.compiled.hash, of.nworld, of.params.names, of.seed.device) for of in (self._layouts, ahead.layouts)]
        if ahead is maker or rows[0] != rows[1] or ahead.split != maker.split:
            raise ArgumentError(
                "Ahead: maker.twin() should return another source, with the same scene, split, params and device, for "
                f"{nworld} worlds."
            )
        # a graph without loops would make the last layouts again at every replay, even while resets copy them
        self._works_ahead = repeats_in_graphs(device) or not graph
        being_made, self.missing = (wp.zeros(nworld, dtype=wp.bool, device=device) for _ in range(2))
        self._being_made = being_made
        stage = self._stage = wp.full(nworld, _READY, dtype=int, device=device)
        self._nwaiting, self._begins, due, self._ndecided = (wp.zeros(1, dtype=int, device=device) for _ in range(4))
        self._known = wp.zeros(1, dtype=int, device="cpu", pinned=device.is_cuda)  # the device copies to it
        self._nknown, self._launches_left = 0, _LAUNCHES
        self._enough = wp.zeros(1, dtype=float, device=device)
        self._patience, self._due = wp.full(1, _PATIENCE, dtype=int, device=device), due

        def make() -> None:
            ahead.launch_generate(being_made)
            wp.launch(_finish, dim=nworld, inputs=[being_made], outputs=[stage], device=device)
            due.zero_()

        self._make_graph = LaunchSequence(lambda: repeat_launches(due, make, 1), device, graph=graph, priority=_FIRST)
        self._stream = self._done = self._served = None
        if device.is_cuda:
            self._stream = side_stream(device) if stream is None else stream
            self._served, self._done = wp.Event(device), wp.Event(device)
            # by events, because Warp does not order streams if the current stream is CUDA's default stream
            device.stream.record_event(self._served)
            self._stream.wait_event(self._served)
            self._stream.record_event(self._done)
        # keeps the memory until the last prefetch has stopped writing to it
        weakref.finalize(self, _wait, self._done, ahead, self._make_graph, self._ndecided, self._known)

    def after_reset(self) -> None:
        """Start a prefetch if enough worlds lack a prefetched layout. Never waits for the device."""
        if self._works_ahead and not self._device.is_capturing:
            self._launch_begin()
            self._make_beside()

    def _launch_begin(self) -> None:
        """Choose worlds for a prefetch, if enough worlds lack a prefetched layout or one has lacked it for many resets.

        The flag `_due` is set last, because a prefetch on the other stream may read this flag at any time.
        """
        nworld, device = self._layouts.nworld, self._device
        outputs = [self._enough, self._nwaiting, self._patience, self._begins]
        wp.launch(_decide, dim=1, inputs=[nworld, _PATIENCE, self._due], outputs=outputs, device=device)
        inputs, outputs = [self._layouts.view, self._begins], [self._stage, self._being_made, self._ahead.layouts.view]
        wp.launch(_begin, dim=nworld, inputs=inputs, outputs=outputs, device=device)
        wp.launch(_publish, dim=1, outputs=[self._begins, self._due, self._ndecided], device=device)

    def _make_beside(self) -> None:
        """Make the layouts of the chosen worlds. On a GPU, this runs concurrently with the following launches.

        If the device is behind the host, the side stream does not wait for this reset. It makes the layouts of the
        worlds that are chosen by the time the prefetch begins. Waiting at every reset would delay each kernel. If the
        device has caught up with the host, this reset may be the last for a while, so the side stream waits for it.
        """
        if self._stream is None or self._served is None:
            self._make_graph.replay()
            return
        seldom, nknown = self._served.is_complete, int(self._known.numpy()[0])
        if nknown != self._nknown:
            self._nknown, self._launches_left = nknown, _LAUNCHES
        self._device.stream.record_event(self._served)
        with wp.ScopedStream(self._stream, sync_enter=False):
            try:
                if seldom:
                    self._stream.wait_event(self._served)
                if self._launches_left > 0:
                    self._make_graph.replay()
                    self._launches_left -= 1
                wp.copy(self._known, self._ndecided)
            finally:
                self._stream.record_event(self._done)

    def launch_open(self, mask: wp.array | None) -> None:
        """Find the masked worlds that have no fitting prefetched layout, and store them in `missing`.

        For these worlds, write the seed and episode of the layout that the maker has to make.
        """
        inputs = [self._layouts.view, self._ahead.layouts.view, mask]
        outputs = [self._stage, self._nwaiting, self._enough, self.missing]
        wp.launch(_find_missing, self._layouts.nworld, inputs=inputs, outputs=outputs, device=self._device)

    def launch_close(self, mask: wp.array | None) -> None:
        """Give each masked world its prefetched layout, or the layout that the maker has just made.

        If a layout was prefetched and also made in the reset, its rejections are counted once.
        """
        served, inputs = self._layouts.view, [self._ahead.layouts.view, mask, self.missing]
        dim = (self._layouts.nworld, max(layout_width(served), served.rejections.shape[0]))
        wp.launch(_serve, dim=dim, inputs=inputs, outputs=[served], device=self._device)

    def launch_forget(self, mask: wp.array | None) -> None:
        """Drop prefetched layouts of the masked worlds, if the params of these worlds changed after the prefetch."""
        inputs, outputs = [self._layouts.view, self._ahead.layouts.view, mask], [self._stage, self._nwaiting]
        wp.launch(_forget, self._layouts.nworld, inputs=inputs, outputs=outputs, device=self._device)


def side_stream(device: wp.Device) -> wp.Stream:
    """Create a stream that runs concurrently with the simulation stream.

    Only non-blocking streams run concurrently with CUDA's default stream. Torch launches on the default stream, and the
    side streams of torch are non-blocking, so the stream comes from torch if torch is in use. Otherwise a Warp stream
    suffices, because Warp does not launch on the default stream.
    """
    if (torch := sys.modules.get("torch")) is not None and torch.cuda.is_available():
        return wp.stream_from_torch(torch.cuda.Stream(str(device), priority=_FIRST))
    return wp.Stream(device, priority=_FIRST)


def _wait(done: wp.Event | None, *kept: Any) -> None:
    """Block until the last prefetch is done, and then release `kept`, the objects that own the memory of the prefetch.

    During a capture, synchronisation is not allowed, so the memory is kept until a later call.
    """
    _kept_longer.append((done, kept))
    if done is not None and done.device.is_capturing:
        return
    while _kept_longer:
        event, _ = _kept_longer[-1]
        if event is not None:
            wp.synchronize_event(event)
        _kept_longer.pop()
