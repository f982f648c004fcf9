"""`Search`: the state of a search for layouts: rows, candidates, and queues of fixed capacity.

A *row* is one restart of one world: the objects placed so far, and the next object with its next trial. The first
`nworld` rows belong to the worlds themselves; the others run later restarts of worlds at the same time. A *candidate*
is one trial of one row's object. Counts that control loops are arrays of one element, read on the device.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import warp as wp

from sceniris_gym.device.random import STREAM_BITS
from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.placement.measure import StableDraw
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Program, allocate, repeat
from sceniris_gym.program.device_reach import Reach, Starts
from sceniris_gym.program.device_statics import Statics

NO_GRASP = 1 << 30
"""Sentinel: the arm's map accepts no grasp."""

# Most 4-byte words for the half-planes and pieces of the candidates of a wave; rows beyond that wait for the next wave.
_MOST_WORDS = 1 << 27

_STREAM_BITS = wp.constant(wp.uint32(STREAM_BITS))


@wp.struct
class Search:
    """The arrays of a search on the device."""

    # Worlds
    pending: wp.array[bool]  # has no layout yet
    restart: wp.array[int]  # the next restart
    ticket: wp.array[int]  # its number among the pending worlds of this round, or of the next
    best: wp.array[int]  # the lowest restart of this round that is done; see `flip_failed`
    # Restarts, each in a row
    row_world: wp.array[int]
    row_restart: wp.array[int]
    # Rows
    waiting: wp.array[bool]  # has placed everything; the reach stage has yet to find joints for its grasps
    row_object: wp.array[int]  # the object to place next; `nobject` once all are placed
    row_trial: wp.array[int]  # the next trial of that object, from 0
    row_attempts: wp.array[int]  # candidates drawn in this restart
    row_free: wp.array2d[bool]  # grasps that are still free, of those in `early_grasp`
    queue: wp.array2d[int]  # rows that still place objects: two lists, one read and one written
    # Shares of rows in a wave
    row_first: wp.array[int]  # the row's first candidate in this wave
    row_trials: wp.array[int]  # the number of its candidates; 0 if the wave has no room for them
    row_ahead: wp.array[int]  # in front of them, candidates of all objects before it, in the first wave of a round
    # Placed: of each object that is placed, if objects may fall or start at markers
    row_surface: wp.array2d[int]
    row_stable: wp.array2d[int]
    # Counts
    worlds_left: wp.array[int]
    rows_left: wp.array[int]
    restarts_at_once: wp.array[int]
    source: wp.array[int]  # the list of `queue` that is read
    rows: wp.array[int]  # number of rows in that list
    rows_before: wp.array[int]  # the same in the wave before
    opened: wp.array[int]  # number of candidates of the next wave
    candidates: wp.array[int]
    narrow_pairs: wp.array[int]
    hands: wp.array[int]  # number of entries in `hand`
    any_overflowed: wp.array[int]  # 1: at least one candidate has `overflowed` set
    # Trials, each a candidate
    row: wp.array[int]
    obj: wp.array[int]
    trial: wp.array[int]  # number of the trial of its object in this restart, from 0
    # Candidates
    cause: wp.array[int]
    stable_draw: wp.array[StableDraw]
    heading: wp.array[float]
    point: wp.array[wp.vec3]  # under the pivot [m]
    surface: wp.array[int]
    grasp: wp.array[int]
    free: wp.array2d[bool]  # grasps that it leaves free, of those in `early_grasp`
    hand: wp.array[int]  # (candidate, grasp) that are near each other, as indices into `free`
    overflowed: wp.array[int]  # 1: a stack or queue had no room for all of its collision test; one lane repeats it
    # Places of candidates
    place: wp.array[wp.vec4]
    bounds: wp.array[wp.vec4]
    # Flags of the prefilter
    covered: wp.array[int]  # 1: an obstacle is above its point
    overhanging: wp.array[int]  # 1: part of its footprint lies off the support
    # Poses of candidates
    qpos: wp.array2d[float]
    body_pos: wp.array2d[wp.vec3]
    body_quat: wp.array2d[wp.vec4]
    # Narrow phase
    narrow_pair: wp.array[wp.vec4i]  # (candidate, pair, node of a, node of b)


@wp.func
def candidate_num(search: Search) -> int:
    """Return the number of candidates in this wave: as many as rows asked for, up to the capacity."""
    return wp.min(search.candidates[0], search.cause.shape[0])


@wp.func
def lanes_for_each(lanes: int, num: int, least: int) -> int:
    """Return how many lanes share each of `num` things: all there are, or `least` where things are many."""
    return wp.max(lanes // wp.max(num, 1), least)


@wp.func
def narrow_pair_num(search: Search) -> int:
    """Return the number of narrow-phase pairs in the queue: as many as were found, up to the capacity."""
    found = search.narrow_pairs[0]
    if found < 0:  # the count overflowed
        return search.narrow_pair.shape[0]
    return wp.min(found, search.narrow_pair.shape[0])


@wp.func
def queue_row(program: Program, search: Search, row: int, ahead: int, busy: int):
    """Queue a row for the next wave, with candidates for the next trials of its object, as far as there is room.

    There are more of them if few rows are left, or if the object usually needs more. In front of them is a candidate of
    each of the `ahead` objects before it; the first of these without room is the row's object in its place.
    """
    search.queue[1 - search.source[0], wp.atomic_add(search.rows_left, 0, 1)] = row
    obj = search.row_object[row]
    trial = search.row_trial[row]
    # the share of the rows that goes on is expected to be that of the last wave
    rows = float(wp.max(search.rows[0], 1))
    share = wp.max(float(search.rows_before[0]), rows) / (rows * rows)
    # no more than there is room for: the count of all candidates would overflow
    most = wp.min(float(busy) * program.obj_effort[obj], float(search.cause.shape[0]))
    trials = wp.min(share * most, float(program.attempts - trial))
    wanted = ahead + wp.max(int(trials), 1)
    first = wp.atomic_add(search.opened, 0, wanted)
    num = wp.clamp(search.cause.shape[0] - first, 0, wanted)
    if num < ahead:
        search.row_object[row] = num
    search.row_ahead[row] = wp.min(ahead, num)
    search.row_first[row] = first + wp.min(ahead, num)
    search.row_trials[row] = wp.max(num - ahead, 0)
    for k in range(num):
        search.row[first + k] = row
        search.obj[first + k] = wp.where(k < ahead, k, obj)
        search.trial[first + k] = wp.max(trial + k - ahead, 0)


@wp.func
def flip_failed(best: int) -> int:
    """Return a number below 0 for a restart whose start is not clear, or that restart for such a number."""
    return -1 - best


@wp.func
def finish_row(search: Search, row: int, staged: bool):
    """Pass on a row that has placed all its objects: to the reach stage if there is one, else its restart is done."""
    if staged:
        search.waiting[row] = True
    else:
        wp.atomic_min(search.best, search.row_world[row], search.row_restart[row])


@wp.func
def first_trial_of(program: Program, search: Search, candidate: int) -> int:
    """Return the number of the first trial of a candidate's restart, counted over all restarts."""
    return search.row_restart[search.row[candidate]] * program.attempts


@wp.func
def trial_of(program: Program, search: Search, candidate: int) -> int:
    """Return the number of a candidate's trial, counted over all restarts."""
    return first_trial_of(program, search, candidate) + search.trial[candidate]


@wp.func
def numbered_stream(split: wp.uint32, number: int) -> wp.uint32:
    """Return the random stream of a split with a given number."""
    return (split << _STREAM_BITS) + wp.uint32(number)


@wp.func
def stream_of(program: Program, split: wp.uint32, obj: int) -> wp.uint32:
    """Return the random stream that an object's candidates are drawn from."""
    return numbered_stream(split, program.obj_stream[obj])


@dataclass(frozen=True)
class SearchSize:
    """Capacities of a search. They affect its speed, never its layouts.

    Attributes:
        rows: Rows beyond one per world, for restarts that run at the same time.
        candidates: Most candidates in a wave.
        busy: Number of candidates that a wave is filled up to with further trials of its rows.
        narrow_pairs: Capacity of the queue of narrow-phase pairs, which `geometry: visual` does without. Candidates
            whose pairs have no room are tested as a whole.
        grasps: Most candidates in a wave of the reach stage, each with a pose of the robot.
        lanes: Lanes of a launch in which lanes work independently.
        parts: Lanes that share the containment test of a candidate, and at least so many share its prefilter and the
            pieces of its region.
        blocks: Blocks of a launch in which the lanes of a block share a candidate.
        block_dim: Lanes of a block, in launches of both kinds.

    Raises:
        ArgumentError: A capacity is below 1, or below 0 for `rows` and `narrow_pairs`.
    """

    rows: int
    candidates: int
    busy: int
    narrow_pairs: int
    grasps: int
    lanes: int
    parts: int
    blocks: int
    block_dim: int

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            least = 0 if name in ("rows", "narrow_pairs") else 1
            if value < least:
                raise ArgumentError(f"SearchSize: {name} should be at least {least}, got {value}.")


GPU_SIZE = SearchSize(
    rows=8192,
    candidates=1 << 17,
    busy=1 << 13,
    narrow_pairs=1 << 21,
    grasps=1 << 14,
    lanes=1 << 16,
    parts=8,
    blocks=1 << 12,
    block_dim=32,
)
CPU_SIZE = SearchSize(
    rows=0, candidates=512, busy=1, narrow_pairs=0, grasps=512, lanes=1, parts=1, blocks=1, block_dim=1
)


def default_size(device: str) -> SearchSize:
    """Return the default capacities of a device: on a CPU one lane does everything, and nothing is queued."""
    return GPU_SIZE if wp.get_device(device).is_cuda else CPU_SIZE


@dataclass(frozen=True)
class Workspace:
    """The arrays and capacities that all launches of a generator share.

    Attributes:
        compiled: The compiled scene.
        program: Its placement program, some numbers of which differ between worlds.
        statics: How objects stand, None if none can fall; the same holds.
        ahead: Number of objects that are drawn ahead.
        reaches: The arms; a single empty one if there are no reach targets.
        split: Number of the split.
        size: Capacities.
        layouts: The layouts of all rows.
        search: The state of the search for them.
    """

    compiled: CompiledScene
    program: Program
    statics: Statics | None
    ahead: int
    reaches: Sequence[Reach]
    split: int
    size: SearchSize
    layouts: LayoutsView
    search: Search

    @property
    def reach(self) -> Reach:
        """The first arm, for the fields that all arms share."""
        return self.reaches[0]

    @property
    def kinds(self) -> Starts:
        """The kinds of starts, for kernels that all scenes launch."""
        return Starts() if self.compiled.starts is None else self.compiled.starts

    @property
    def nworld(self) -> int:
        """Number of worlds."""
        return self.layouts.seed.shape[0]

    @property
    def nrow(self) -> int:
        """Number of rows."""
        return self.search.row_world.shape[0]

    def launch(self, kernel: wp.Kernel, dim: Any, inputs: Sequence, *outputs: Any) -> None:
        """Launch a kernel whose lanes work independently."""
        words = {"block_dim": self.size.block_dim, "device": self.compiled.device}
        wp.launch(kernel, dim=dim, inputs=inputs, outputs=outputs, **words)

    def launch_lanes(self, kernel: wp.Kernel, inputs: Sequence, *outputs: Any) -> None:
        """Launch a kernel whose lanes step through a queue, and which takes their number first."""
        self.launch(kernel, self.size.lanes, [self.size.lanes, *inputs], *outputs)

    def launch_blocks(self, kernel: wp.Kernel, inputs: Sequence, *outputs: Any, blocks: int | None = None) -> None:
        """Launch a kernel in which the lanes of a block share a candidate, and which takes the number of blocks first.

        By default it is launched with all blocks.
        """
        blocks, words = blocks or self.size.blocks, {"block_dim": self.size.block_dim, "device": self.compiled.device}
        wp.launch_tiled(kernel, dim=[blocks], inputs=[blocks, *inputs], outputs=outputs, **words)


def create_search(compiled: CompiledScene, nworld: int, size: SearchSize) -> Search:
    """Allocate the arrays of a search for `nworld` worlds."""
    nrow, ncand = nworld + size.rows, size.candidates
    if compiled.related:
        words = 5 * compiled.sides + 2 * compiled.pieces
        ncand = min(ncand, max(_MOST_WORDS // words, 1))
    targets = () if compiled.reaching is None else compiled.reaching.targets
    early = sum(len(target.grasp_set.grasps) for target in targets if target.early)
    s = Search()
    zeros = partial(allocate, Search, s)
    with wp.ScopedDevice(compiled.device):
        zeros(nworld, "pending restart ticket best")
        zeros(nrow, "waiting row_world row_restart row_object row_trial row_attempts row_first row_trials row_ahead")
        zeros((2, nrow), "queue")
        kept = compiled.statics is not None or compiled.starts is not None
        zeros((nrow, len(compiled.placed) if kept else 0), "row_surface row_stable")
        zeros(1, "worlds_left rows_left restarts_at_once source rows rows_before")
        zeros(1, "opened candidates narrow_pairs hands any_overflowed")
        zeros(ncand, "row obj trial cause stable_draw heading point surface place bounds grasp")
        zeros(ncand, "overflowed covered overhanging")
        repeat(Search, s, ncand, compiled.home_state, compiled.device)
        zeros((nrow, early), "row_free")
        zeros((ncand, early), "free")
        zeros(ncand * early, "hand")
        zeros(0 if compiled.config.geometry == "visual" else size.narrow_pairs, "narrow_pair")
    return s
