"""`Search`: the state of a search for layouts, with rows, candidates, and queues of fixed capacity.

A *row* is one restart of one world: the objects placed so far, and the next object with its next trial. The first
`nworld` rows belong to the worlds, and the other rows run later restarts of worlds in parallel. A *candidate* is one
trial of one row's object. Counts that end a loop of launches are arrays of one element, so that the device can read
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import warp as wp

from sceniris_gym.device.random import STREAM_BITS
from sceniris_gym.errors import ArgumentError, refuses_old_names
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.placement.measure import StableDraw
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Program, allocate, repeat
from sceniris_gym.program.device_reach import Reach, Starts
from sceniris_gym.program.device_statics import Statics

NO_GRASP = 1 << 30
"""Sentinel: the arm's map accepts no grasp."""

# Maximum number of 4-byte words for the half-planes and pieces of a wave's candidates. Further rows wait for the next
# wave.
_MOST_WORDS = 1 << 27

# From these numbers of worlds, a wave has room for two and four times the usual candidates and pairs. Waves of many
# rows also have two and four times the lanes and blocks, and twice the candidates keep the device busy.
_MANY_WORLDS = (1 << 15, 1 << 18)
MANY_ROWS = wp.constant(_MANY_WORLDS[0])
# A candidate is tested against the objects placed before. In scenes with at most this number of objects, without an arm
# and without visible meshes, twice the candidates take the same time.
_FEW_OBJECTS = 6
# Scenes whose relations cut a region into more pieces than this try fewer restarts in parallel.
_MOST_PIECES = 1024

_STREAM_BITS = wp.constant(wp.uint32(STREAM_BITS))


@wp.struct
class Search:
    """The arrays of a search on the device."""

    # Worlds
    pending: wp.array[bool]  # has no layout yet
    restart: wp.array[int]  # the next restart
    ticket: wp.array[int]  # index among the pending worlds of this or the next round
    best: wp.array[int]  # the lowest finished restart of this round, see `flip_failed`
    # Restarts, each in a row
    row_world: wp.array[int]
    row_restart: wp.array[int]
    # Rows
    waiting: wp.array[bool]  # all objects are placed, and the reach stage has to solve for joints
    row_object: wp.array[int]  # the next object to place, `nobject` if all are placed
    row_trial: wp.array[int]  # the next trial of this object, from 0
    row_attempts: wp.array[int]  # candidates drawn in this restart
    row_free: wp.array2d[bool]  # whether each grasp in `early_grasp` is still free
    queue: wp.array2d[int]  # rows that still place objects: two lists, one read and one written
    # Shares of rows in a wave
    row_first: wp.array[int]  # the row's first candidate in this wave
    row_trials: wp.array[int]  # number of the row's candidates, 0 if the wave has no room for them
    row_ahead: wp.array[int]  # number of candidates before them, one per object drawn ahead
    # Placed: support of each placed object, in scenes where objects may fall or start at markers
    row_surface: wp.array2d[int]
    row_stable: wp.array2d[int]
    # Counts
    worlds_left: wp.array[int]
    rows_left: wp.array[int]
    restarts_at_once: wp.array[int]
    busy: wp.array[int]  # number of candidates that keeps the device busy in this round
    source: wp.array[int]  # the list of `queue` to read
    rows: wp.array[int]  # number of rows in this list
    rows_before: wp.array[int]  # number of rows in the last wave
    many_rows: wp.array[int]  # 1: the last wave had at least `MANY_ROWS`, or the round begins with as many
    opened: wp.array[int]  # number of candidates of the next wave
    cutting: wp.array[int]  # 1: the region of an object in the next wave differs between worlds
    candidates: wp.array[int]
    narrow_pairs: wp.array[int]
    hands: wp.array[int]  # number of entries in `hand`
    any_overflowed: wp.array[int]  # 1: at least one candidate has `overflowed` set
    # Trials, each a candidate
    row: wp.array[int]
    obj: wp.array[int]
    trial: wp.array[int]  # index of the object's trial in this restart
    # Candidates
    cause: wp.array[int]
    stable_draw: wp.array[StableDraw]
    heading: wp.array[float]
    point: wp.array[wp.vec3]  # under the pivot [m]
    surface: wp.array[int]
    grasp: wp.array[int]
    free: wp.array2d[bool]  # whether the candidate leaves each grasp in `early_grasp` free
    hand: wp.array[int]  # (candidate, grasp) that are near each other, as indices into `free`
    overflowed: wp.array[int]  # 1: a stack or queue of the collision test overflowed, so one lane repeats the test
    # Pivots of candidates
    pivot_pose: wp.array[wp.vec4]
    bounds: wp.array[wp.vec4]
    # Flags of the prefilter
    covered: wp.array[int]  # 1: an obstacle is above the candidate's point
    overhanging: wp.array[int]  # 1: part of the footprint lies off the support
    # Poses of candidates
    qpos: wp.array2d[float]
    body_pos: wp.array2d[wp.vec3]
    body_quat: wp.array2d[wp.vec4]
    # Narrow phase
    narrow_pair: wp.array[wp.vec4i]  # (candidate, pair, node of a, node of b)


@wp.func
def candidate_num(search: Search) -> int:
    """Return the number of candidates in this wave, at most the capacity. The counter may exceed the capacity."""
    return wp.min(search.candidates[0], search.cause.shape[0])


@wp.func
def lanes_for_each(lanes: int, num: int, least: int) -> int:
    """Return the number of lanes for each of `num` tasks: `lanes` divided among them, but at least `least`."""
    return wp.max(lanes // wp.max(num, 1), least)


@wp.func
def narrow_pair_num(search: Search) -> int:
    """Return the number of narrow-phase pairs in the queue, at most its capacity. The counter may exceed it."""
    found = search.narrow_pairs[0]
    if found < 0:  # the count overflowed
        return search.narrow_pair.shape[0]
    return wp.min(found, search.narrow_pair.shape[0])


@wp.func
def queue_row(program: Program, search: Search, row: int, ahead: int):
    """Queue a row for the next wave, with candidates for the next trials of its object, within the capacity.

    The row gets more candidates if few rows are left, or if its object usually needs many trials. If candidates of
    `ahead` later objects were already drawn, these candidates come first, one per object. If the wave has no room for
    one of them, its object becomes the row's next object.
    """
    search.queue[1 - search.source[0], wp.atomic_add(search.rows_left, 0, 1)] = row
    obj = search.row_object[row]
    trial = search.row_trial[row]
    if program.obj_cutnum[obj] > 0:
        search.cutting[0] = 1
    # expect the same fraction of rows to continue as in the last wave
    rows = float(wp.max(search.rows[0], 1))
    share = wp.max(float(search.rows_before[0]), rows) / (rows * rows)
    # at most the capacity, because the count of all candidates would overflow
    most = wp.min(float(search.busy[0]) * program.obj_effort[obj], float(search.cause.shape[0]))
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
    """Convert a restart (0 or above) that found no free start pose to its code in `Search.best` (below 0), or back.

    The code is -1 minus the restart, so the same function converts both ways.
    """
    return -1 - best


@wp.func
def finish_row(search: Search, row: int, staged: bool):
    """End the placing of objects in a row.

    If `staged`, the row then waits for the reach stage. Otherwise, its restart is finished.
    """
    if staged:
        search.waiting[row] = True
    else:
        wp.atomic_min(search.best, search.row_world[row], search.row_restart[row])


@wp.func
def trial_of(program: Program, search: Search, candidate: int) -> int:
    """Return the index of a candidate among the trials of its object, counted over all restarts."""
    return search.row_restart[search.row[candidate]] * program.attempts + search.trial[candidate]


@wp.func
def numbered_stream(split: wp.uint32, number: int) -> wp.uint32:
    """Return the random stream with a given number, for a split."""
    return (split << _STREAM_BITS) + wp.uint32(number)


@wp.func
def stream_of(program: Program, split: wp.uint32, obj: int) -> wp.uint32:
    """Return the random stream of an object's candidates."""
    return numbered_stream(split, program.obj_stream[obj])


@dataclass(frozen=True)
class SearchSize:
    """Capacities of a search. The defaults suit a GPU. Capacities affect only the speed, not the layouts.

    Attributes:
        rows: Number of rows in addition to one per world, for restarts in parallel.
        candidates: Maximum number of candidates in a wave.
        busy: Number of candidates that keeps the device busy, in a round of few rows. A smaller wave is filled up with
            further trials of its rows.
        narrow_pairs: Capacity of the queue of narrow-phase pairs, unused with `geometry: visual`. If the queue
            overflows, the candidate's collision test is repeated by one lane.
        grasps: Maximum number of candidates in a wave of the reach stage. Each has a pose of the robot.
        lanes: Number of lanes in a launch whose lanes work independently, at most its default in waves of few rows.
        parts: Number of lanes that share the containment test of a candidate. At least this number of lanes share its
            prefilter and the pieces of its region.
        blocks: Number of blocks in a launch whose blocks each test one candidate at a time, likewise.
        block_dim: Number of lanes in a block, for both kinds of launches.

    Raises:
        ArgumentError: A capacity is below 1, or below 0 for `rows` and `narrow_pairs`.
    """

    rows: int = 8192
    candidates: int = 1 << 17
    busy: int = 1 << 13
    narrow_pairs: int = 1 << 21
    grasps: int = 1 << 14
    lanes: int = 1 << 16
    parts: int = 8
    blocks: int = 1 << 13
    block_dim: int = 32

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            least = 0 if name in ("rows", "narrow_pairs") else 1
            if value < least:
                raise ArgumentError(f"SearchSize: {name} should be at least {least}, got {value}.")

    def most_candidates(self, compiled: CompiledScene) -> int:
        """Return the maximum number of candidates in a wave of a scene."""
        words = 5 * compiled.sides + 2 * compiled.pieces
        return min(self.candidates, max(_MOST_WORDS // words, 1)) if compiled.related else self.candidates


SearchSize.__init__ = refuses_old_names(SearchSize.__init__)
CPU_SIZE = SearchSize(
    rows=0, candidates=512, busy=1, narrow_pairs=0, grasps=512, lanes=1, parts=1, blocks=1, block_dim=1
)


def default_size(device: str) -> SearchSize:
    """Return the default capacities of a device. On a CPU, one lane does all the work without a queue."""
    return SearchSize() if wp.get_device(device).is_cuda else CPU_SIZE


def suited_size(compiled: CompiledScene, nworld: int) -> SearchSize:
    """Return the default capacities for `nworld` worlds of a scene. On a GPU, many worlds get larger waves."""
    size = default_size(compiled.device)
    if size is CPU_SIZE:
        return size
    doublings = sum(nworld >= least for least in _MANY_WORLDS)
    # with relations, most waves have few rows, and idle lanes and blocks only take time
    larger = ("candidates", "narrow_pairs", *(() if compiled.related else ("lanes", "blocks")))
    is_cheap = len(compiled.placed) <= _FEW_OBJECTS and compiled.reaching is None and not compiled.program.visual
    # candidates are expensive in a scene with many pieces of regions, so fewer restarts are tried in parallel
    rows = size.rows // 8 if compiled.pieces > _MOST_PIECES else size.rows
    scaled = {name: getattr(size, name) << doublings for name in larger}
    return replace(size, rows=rows, busy=size.busy << is_cheap, **scaled)


@dataclass(frozen=True)
class Workspace:
    """The arrays and capacities that all launches of a generator share.

    Attributes:
        compiled: The compiled scene.
        program: The placement program. Fields that differ between worlds have a row per world.
        statics: Data of the standing test, with masses per world if they are drawn. None if objects cannot fall.
        ahead: Number of objects drawn ahead.
        reaches: The arms, or a single empty arm if there are no reach targets. Fields common to all arms are read from
            the first arm.
        split: Number of the split, which selects its random streams.
        size: Capacities.
        layouts: The layouts of all rows.
        search: The state of the search.
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
    def kinds(self) -> Starts:
        """The kinds of starts, empty if the scene has no `start`."""
        return Starts() if self.compiled.starts is None else self.compiled.starts  # pyrefly: ignore[missing-argument]

    @property
    def nworld(self) -> int:
        """Number of worlds."""
        return self.layouts.seed.shape[0]

    @property
    def nrow(self) -> int:
        """Number of rows."""
        return self.search.row_world.shape[0]

    def launch(self, kernel: wp.Kernel, dim: int, *inputs: Any) -> None:
        """Launch a kernel whose lanes work independently."""
        wp.launch(kernel, dim=dim, inputs=inputs, block_dim=self.size.block_dim, device=self.compiled.device)

    def launch_lanes(self, kernel: wp.Kernel, *inputs: Any) -> None:
        """Launch a kernel whose lanes step through a queue. Its first argument is the number of lanes."""
        self.launch(kernel, self.size.lanes, self.size.lanes, *inputs)

    def launch_blocks(self, kernel: wp.Kernel, *inputs: Any, blocks: int | None = None) -> None:
        """Launch a kernel whose blocks step through a queue. Its first argument is the number of blocks.

        The number of blocks is `size.blocks` by default.
        """
        num, device = blocks or self.size.blocks, self.compiled.device
        wp.launch_tiled(kernel, dim=[num], inputs=[num, *inputs], block_dim=self.size.block_dim, device=device)


def create_search(compiled: CompiledScene, nworld: int, size: SearchSize) -> Search:
    """Allocate the arrays of a search for `nworld` worlds."""
    nrow, ncand = nworld + size.rows, size.most_candidates(compiled)
    targets = () if compiled.reaching is None else compiled.reaching.targets
    early = sum(len(target.grasp_set.grasps) for target in targets if target.early)
    kept = compiled.statics is not None or compiled.starts is not None
    shapes = {
        "pending restart ticket best": nworld,
        "waiting row_world row_restart row_object row_trial row_attempts row_first row_trials row_ahead": nrow,
        "queue": (2, nrow),
        "row_surface row_stable": (nrow, len(compiled.placed) if kept else 0),
        "worlds_left rows_left restarts_at_once busy source rows rows_before many_rows": 1,
        "opened cutting candidates narrow_pairs hands any_overflowed": 1,
        "row obj trial cause stable_draw heading point surface pivot_pose bounds grasp": ncand,
        "overflowed covered overhanging": ncand,
        "row_free": (nrow, early),
        "free": (ncand, early),
        "hand": ncand * early,
        "narrow_pair": 0 if compiled.config.geometry == "visual" else size.narrow_pairs,
    }
    s = allocate(Search, Search(), shapes, compiled.device)  # pyrefly: ignore[missing-argument]
    repeat(Search, s, ncand, compiled.home_state, compiled.device)
    return s
