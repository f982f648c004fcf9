"""An exponential race, which samples a piece of a region by area in one pass and without any sum.

Each piece draws an arrival time at the rate of its area, and the least time wins: P(i) = area_i / total.
P. Efraimidis, P. Spirakis, "Weighted random sampling with a reservoir", Information Processing Letters 97, 2006.
"""

import warp as wp

from sceniris_gym.device.random import uniforms
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.search import Search, stream_of, trial_of
from sceniris_gym.program.device import Program

# Draws of a trial from here on belong to the region: a block of them for each redraw, of which the first has the
# numbers of the point, and each other one those of four pieces.
_FIRST_DRAW = wp.constant(1 << 16)
_DRAWS = wp.constant(1 << 20)
_HALF_STEP = wp.constant(2.0**-25)
NO_PIECE = wp.constant(wp.uint64(0xFFFFFFFFFFFFFFFF))
"""Sentinel: no piece has positive area."""


@wp.struct
class Numbers:
    """The random numbers of a candidate's point, all but the number of the draw."""

    seed: wp.uint64
    episode: int
    stream: wp.uint32
    trial: int


@wp.func
def numbers_of(program: Program, split: wp.uint32, layouts: LayoutsView, search: Search, c: int) -> Numbers:
    """The random numbers of a candidate's point."""
    world = search.row_world[search.row[c]]
    n = Numbers()
    n.seed = layouts.seed[world]
    n.episode = layouts.pending_episode[world]
    n.stream = stream_of(program, split, search.obj[c])
    n.trial = trial_of(program, search, c)
    return n


@wp.func
def point_numbers(n: Numbers, redraw: int) -> wp.vec4:
    """The numbers that the point of a redraw is drawn with, once its piece is chosen."""
    return uniforms(n.seed, n.episode, n.stream, n.trial, _FIRST_DRAW + redraw * _DRAWS)


@wp.func
def race_time(u: float, size: float) -> float:
    """When a piece of this area [m^2] finishes the race that the smallest time wins, from a uniform number.

    The number 0 stands for all below 2^-24, and is taken for their middle: at a time of 0 area would decide nothing.
    """
    run = -wp.log(1.0 - u)
    if u == 0.0:
        run = _HALF_STEP
    return run / size


@wp.func
def finish(n: Numbers, redraw: int, index: int, size: float) -> wp.uint64:
    """How a piece of this number and area [m^2] does in the race of a redraw: the least of these has won.

    Its time is the upper word, where the bits of positive floats are in the order of the floats, its number the lower.
    """
    u = uniforms(n.seed, n.episode, n.stream, n.trial, _FIRST_DRAW + redraw * _DRAWS + 1 + index // 4)
    which = index % 4
    own = wp.where(which < 2, wp.where(which == 0, u[0], u[1]), wp.where(which == 2, u[2], u[3]))
    return (wp.uint64(wp.cast(race_time(own, size), wp.uint32)) << wp.uint64(32)) | wp.uint64(index)


@wp.func
def winner_index(winner: wp.uint64) -> int:
    """The number of the piece that has won."""
    return int(winner & wp.uint64(0xFFFFFFFF))
