"""`Search`: what is kept while layouts are looked for: rows, candidates, and queues of fixed capacity.

A *row* is one restart of one world: the objects placed so far, and the next one with its next trial. The first
`nworld` rows are those of the worlds themselves; the others try later restarts of worlds at the same time. A
*candidate* is one trial of one row's object. Counts that steer loops are arrays of one element, read on the device.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from sceniris_gym.config.limits import MAX_ANCHORS, MAX_RELATIONS
from sceniris_gym.device.random import STREAM_BITS
from sceniris_gym.errors import CountError
from sceniris_gym.placement.orientations import DrawnVariant
from sceniris_gym.placement.polygons import HalfPlane
from sceniris_gym.placement.relations import ResolvedRelation
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Program

NO_GRASP = 1 << 30
"""In place of a grasp: the arm's map lets none through."""

# Room for the half-planes and pieces of the candidates of a wave, in words; rows that find none wait for the next one.
_MOST_WORDS = 1 << 27

_STREAM_BITS = wp.constant(wp.uint32(STREAM_BITS))


@wp.struct
class Search:
    """The arrays of a search as device code takes them."""

    # Worlds
    pending: wp.array[bool]  # no layout yet
    waiting: wp.array[bool]  # placed, but whether the arm reaches it is open
    restart: wp.array[int]  # the next one to try
    ticket: wp.array[int]  # number among the pending worlds of this round
    best: wp.array[int]  # the lowest restart of this round that has placed everything
    # Rows
    row_world: wp.array[int]
    row_restart: wp.array[int]
    row_object: wp.array[int]  # the object to place next; all are placed if there is no such object
    row_trial: wp.array[int]  # its next trial, from 0
    row_first: wp.array[int]  # its first candidate in this wave
    row_trials: wp.array[int]  # and how many it has; 0 if the wave has no room for it
    row_attempts: wp.array[int]  # candidates drawn in this restart
    queue: wp.array2d[int]  # rows that still place objects; two lists, of which one is read and one written
    # Counts
    worlds_left: wp.array[int]
    rows_left: wp.array[int]
    tickets: wp.array[int]
    restarts_at_once: wp.array[int]
    source: wp.array[int]  # which list of `queue` is read
    rows: wp.array[int]  # number of rows in it
    candidates: wp.array[int]
    cuts: wp.array[int]  # number of candidates in `cut`
    narrow_pairs: wp.array[int]
    enclosed: wp.array[int]
    unproven: wp.array[int]  # 1: some candidate's test missed something
    # Candidates
    row: wp.array[int]
    obj: wp.array[int]
    trial: wp.array[int]  # which trial of its object in this restart, from 0
    cause: wp.array[int]
    turn: wp.array[DrawnVariant]
    heading: wp.array[float]
    point: wp.array[wp.vec3]  # under the pivot [m]
    surface: wp.array[int]
    place: wp.array[wp.vec4]
    bounds: wp.array[wp.vec4]
    grasp: wp.array[int]
    missed: wp.array[int]  # 1: there was no room for all of its test, and one lane has to make it
    covered: wp.array[int]  # 1: something is above its point
    off: wp.array[int]  # 1: some of its footprint is off the support
    qpos: wp.array2d[float]
    body_pos: wp.array2d[wp.vec3]
    body_quat: wp.array2d[wp.vec4]
    relations: wp.array2d[ResolvedRelation]
    hulls: wp.array2d[wp.vec2]
    sides: wp.array2d[HalfPlane]  # around the pieces of its relations
    side_num: wp.array2d[int]  # how many of them each piece of a relation has; -1 where that is not active
    pieces: wp.array[int]  # pieces of its region that may have any area
    piece: wp.array2d[int]  # their numbers
    piece_area: wp.array2d[float]  # [m^2]
    winner: wp.array[wp.uint64]  # the piece that wins the first race: its time and its number
    cut: wp.array[int]  # candidates whose region is another one in every world
    narrow_pair: wp.array[wp.vec4i]  # (candidate, pair, node of a, node of b)
    # Points that are inside the box of a collider, in the frame of its body; for `geometry: visual`
    enclosed_candidate: wp.array[int]
    enclosed_by: wp.array[int]
    enclosed_point: wp.array[wp.vec3]


@wp.func
def candidate_num(search: Search) -> int:
    """How many candidates this wave has: those that rows asked for, as far as there is room."""
    return wp.min(search.candidates[0], search.cause.shape[0])


@wp.func
def narrow_pair_num(search: Search) -> int:
    """How many pairs of leaves wait: those that were found, as far as there is room."""
    found = search.narrow_pairs[0]
    if found < 0:  # the count went on beyond all numbers
        return search.narrow_pair.shape[0]
    return wp.min(found, search.narrow_pair.shape[0])


@wp.func
def queue_row(search: Search, row: int):
    """Let a row take part in the next wave."""
    search.queue[1 - search.source[0], wp.atomic_add(search.rows_left, 0, 1)] = row


@wp.func
def begin_wave(search: Search):
    """Let the rows that were queued take part in this wave. A single lane calls it, once they have candidates."""
    search.rows[0] = search.rows_left[0]
    search.rows_left[0] = 0
    search.source[0] = 1 - search.source[0]
    search.cuts[0] = 0
    search.narrow_pairs[0] = 0
    search.enclosed[0] = 0
    search.unproven[0] = 0


@wp.func
def first_trial_of(program: Program, search: Search, candidate: int) -> int:
    """The number of the first trial of a candidate's restart."""
    return search.row_restart[search.row[candidate]] * program.attempts


@wp.func
def trial_of(program: Program, search: Search, candidate: int) -> int:
    """The number of a candidate's trial, all restarts together."""
    return first_trial_of(program, search, candidate) + search.trial[candidate]


@wp.func
def numbered_stream(split: wp.uint32, number: int) -> wp.uint32:
    """The stream of random numbers with a number, in a split."""
    return (split << _STREAM_BITS) + wp.uint32(number)


@wp.func
def stream_of(program: Program, split: wp.uint32, obj: int) -> wp.uint32:
    """The stream of random numbers that an object's candidates are drawn from."""
    return numbered_stream(split, program.obj_stream[obj])


@dataclass(frozen=True)
class SearchSize:
    """Capacities, which affect the speed and never the layouts.

    Attributes:
        rows: Rows beyond one for each world, for restarts that are tried at the same time.
        candidates: Candidates of one wave.
        busy: Candidates of a wave up to which further trials are drawn at the same time.
        narrow_pairs: Narrow-phase pairs that wait for lanes of their own, or with `geometry: visual` points that may be
            enclosed; 0: candidates are tested as a whole.
        grasps: Candidates of one wave of the stages `ik` and `clear`, each with a pose of the robot.
        lanes: Lanes of a launch in which each works for itself.
        parts: Lanes that share the screen of one candidate, its containment, and the pieces of its region at least.
        blocks, block_dim: Blocks of a launch in which a block's lanes share a candidate, and their number.

    Raises:
        CountError: One of them is less than 1; `rows` and `narrow_pairs` may be 0.
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
                raise CountError(f"SearchSize: {name} should be at least {least}, got {value}.")


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
    """What suits a device: on a CPU one lane does everything and nothing waits."""
    return GPU_SIZE if wp.get_device(device).is_cuda else CPU_SIZE


def create_search(compiled: CompiledScene, nworld: int, size: SearchSize) -> Search:
    """Allocate the arrays of a search for `nworld` worlds."""
    nrow, ncand, mjm = nworld + size.rows, size.candidates, compiled.mjm
    if compiled.related:
        words = 5 * compiled.sides + 2 * compiled.pieces
        ncand = min(ncand, max(_MOST_WORDS // words, 1))
    nbody = mjm.nbody
    s = Search()
    with wp.ScopedDevice(compiled.device):
        s.pending = wp.zeros(nworld, dtype=bool)
        s.waiting = wp.zeros(nworld, dtype=bool)
        for name in ("restart", "ticket", "best"):
            setattr(s, name, wp.zeros(nworld, dtype=int))
        for name in ("row_world", "row_restart", "row_object", "row_trial", "row_attempts", "row_first", "row_trials"):
            setattr(s, name, wp.zeros(nrow, dtype=int))
        s.queue = wp.zeros((2, nrow), dtype=int)
        for name in ("worlds_left", "rows_left", "tickets", "restarts_at_once", "source", "rows"):
            setattr(s, name, wp.zeros(1, dtype=int))
        for name in ("candidates", "cuts", "narrow_pairs", "enclosed", "unproven"):
            setattr(s, name, wp.zeros(1, dtype=int))
        for name in ("row", "obj", "trial", "cause", "surface", "grasp", "missed", "covered", "off"):
            setattr(s, name, wp.zeros(ncand, dtype=int))
        s.turn = wp.zeros(ncand, dtype=DrawnVariant)
        s.heading = wp.zeros(ncand, dtype=float)
        s.point = wp.zeros(ncand, dtype=wp.vec3)
        s.place = wp.zeros(ncand, dtype=wp.vec4)
        s.bounds = wp.zeros(ncand, dtype=wp.vec4)
        s.qpos = wp.array(np.tile(compiled.home_qpos, (ncand, 1)), dtype=float, shape=(ncand, mjm.nq))
        s.body_pos = wp.array(np.tile(compiled.home_xpos, (ncand, 1, 1)), dtype=wp.vec3, shape=(ncand, nbody))
        s.body_quat = wp.array(np.tile(compiled.home_xquat, (ncand, 1, 1)), dtype=wp.vec4, shape=(ncand, nbody))
        related = ncand if compiled.related else 0
        s.relations = wp.zeros((related, MAX_RELATIONS), dtype=ResolvedRelation)
        s.hulls = wp.zeros((related, MAX_RELATIONS * MAX_ANCHORS), dtype=wp.vec2)
        s.sides = wp.zeros((related, compiled.sides), dtype=HalfPlane)
        s.side_num = wp.zeros((related, MAX_RELATIONS), dtype=int)
        for name in ("pieces", "cut"):
            setattr(s, name, wp.zeros(related, dtype=int))
        s.piece = wp.zeros((related, compiled.pieces), dtype=int)
        s.piece_area = wp.zeros((related, compiled.pieces), dtype=float)
        s.winner = wp.zeros(related, dtype=wp.uint64)
        visual = compiled.config.geometry == "visual"
        s.narrow_pair = wp.zeros(0 if visual else size.narrow_pairs, dtype=wp.vec4i)
        room = size.narrow_pairs if visual else 0
        s.enclosed_candidate = wp.zeros(room, dtype=int)
        s.enclosed_by = wp.zeros(room, dtype=int)
        s.enclosed_point = wp.zeros(room, dtype=wp.vec3)
    return s
