"""Which members of a group are in a world, and where the others are parked: untested, since nothing placed gets there.

`program.parking_check` refuses scenes in which something might.
"""

import warp as wp

from sceniris_gym.layout.random import GROUP_STREAM, STREAM_BITS, uniforms
from sceniris_gym.program.device import Program
from sceniris_gym.scene.parking import PARKING_COLUMNS, PARKING_FROM, PARKING_SPACING

_STREAM_BITS = wp.constant(wp.uint32(STREAM_BITS))
_GROUP_STREAM = wp.constant(wp.uint32(GROUP_STREAM))
_FAR = wp.constant(PARKING_FROM)
_SPACING = wp.constant(PARKING_SPACING)
_COLUMNS = wp.constant(PARKING_COLUMNS)


@wp.func
def draw_groups(program: Program, seed: wp.uint64, episode: int, split: wp.uint32, present: wp.array(dtype=int)):
    """Draw which objects of each group are present: k uniform in its interval, then k members without repetition.

    The draw belongs to the episode and not to a trial: restarts must not favour small sets, which are easier to place.
    """
    stream = (split << _STREAM_BITS) + _GROUP_STREAM
    for g in range(program.ngroup):
        adr = program.group_adr[g]
        num = program.group_num[g]
        low = program.group_low[g]
        left = low + int(uniforms(seed, episode, stream, g, 0)[0] * float(program.group_high[g] - low + 1))
        left = wp.min(left, program.group_high[g])
        # selection sampling: D. Knuth, "The Art of Computer Programming", vol. 2, algorithm 3.4.2 S
        for i in range(num):
            u = uniforms(seed, episode, stream, g, 1 + i // 4)[i % 4]
            chosen = int(0)
            if u * float(num - i) < float(left):
                chosen = int(1)
            present[program.group_slot[adr + i]] = chosen
            left -= chosen


@wp.func
def parking_place(slot: int) -> wp.vec3:
    """Where an absent object's pivot lies [m], world frame, on the ground plane."""
    return wp.vec3(_FAR + _SPACING * float(slot % _COLUMNS), _FAR + _SPACING * float(slot // _COLUMNS), 0.0)
