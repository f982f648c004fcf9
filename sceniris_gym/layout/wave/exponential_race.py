"""An exponential race, which samples a piece of a region by area in one pass and without any sum.

Each piece draws an arrival time at the rate of its area, and the least time wins: P(i) = area_i / total.
P. Efraimidis, P. Spirakis, "Weighted random sampling with a reservoir", Information Processing Letters 97, 2006.
"""

import warp as wp

from sceniris_gym.device.angles import log_of
from sceniris_gym.device.random import uniforms
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.search import Search, stream_of, trial_of
from sceniris_gym.program.device import Program

# Draws of a trial from here on are those of the region: one block per redraw. The first draw of a block gives the
# numbers of the point, each further one the numbers of four pieces.
_FIRST_DRAW = wp.constant(1 << 16)
_DRAWS = wp.constant(1 << 20)
_HALF_STEP = wp.constant(2.0**-25)
# Pieces below this area [m^2] are rounding errors: a line of 1 mm, drawn 40 um wide, has 4e-8.
_LEAST_AREA = wp.constant(1.0e-10)
NO_PIECE = wp.constant(wp.uint64(0xFFFFFFFFFFFFFFFF))
"""Sentinel: no piece has positive area."""


@wp.struct
class PointCounter:
    """The key and counter of the random numbers behind a candidate's point, all but the number of the draw."""

    seed: wp.uint64
    episode: int
    stream: wp.uint32
    trial: int


@wp.func
def point_counter(program: Program, split: wp.uint32, layouts: LayoutsView, search: Search, c: int) -> PointCounter:
    """Return the counter of a candidate's point."""
    world = search.row_world[search.row[c]]
    stream = stream_of(program, split, search.obj[c])
    return PointCounter(
        layouts.pending_seed[world], layouts.pending_episode[world], stream, trial_of(program, search, c)
    )


@wp.func
def point_uniforms(n: PointCounter, redraw: int) -> wp.vec4:
    """Return the uniform numbers that place the point of a redraw inside its piece."""
    return uniforms(n.seed, n.episode, n.stream, n.trial, _FIRST_DRAW + redraw * _DRAWS)


@wp.func
def arrival_time(u: float, size: float) -> float:
    """Return the arrival time of a piece of this area [m^2], from a uniform number.

    The number 0 stands for all numbers below 2^-24 and is replaced by their midpoint: at time 0 the area would not
    matter.
    """
    return wp.where(u == 0.0, _HALF_STEP, -log_of(1.0 - u)) / size


@wp.func
def arrival_key(n: PointCounter, redraw: int, index: int, size: float) -> wp.uint64:
    """Return the key of a piece of this number and area [m^2] in the race of a redraw; the least key wins.

    The upper word is the arrival time, since the bits of positive floats are ordered like the floats themselves. The
    lower word is the number of the piece.
    """
    u = uniforms(n.seed, n.episode, n.stream, n.trial, _FIRST_DRAW + redraw * _DRAWS + 1 + index // 4)
    which = index % 4
    own = wp.where(which < 2, wp.where(which == 0, u[0], u[1]), wp.where(which == 2, u[2], u[3]))
    return (wp.uint64(wp.cast(arrival_time(own, size), wp.uint32)) << wp.uint64(32)) | wp.uint64(index)


@wp.func
def first_arrival(search: Search, holder: int, n: PointCounter, redraw: int, lane: int, lanes: int) -> wp.uint64:
    """Return the least arrival key among the pieces of a region: the share of lane `lane` of `lanes`."""
    best = NO_PIECE
    for k in range(lane, search.pieces[holder], lanes):
        size = search.piece_area[holder, k]
        if size > _LEAST_AREA:
            best = wp.min(best, arrival_key(n, redraw, search.piece[holder, k], size))
    return best


@wp.func
def piece_of(key: wp.uint64) -> int:
    """Return the number of the piece with an arrival key."""
    return int(key & wp.uint64(0xFFFFFFFF))
