"""`ReachSearch`: what is kept while joints for grasps are looked for: worlds in a queue, and their candidates.

A world that waits goes through its arms in order, through the reach targets of each, and through the grasps of each
target. A *candidate* is one start of the inverse kinematics for one grasp. It goes through the steps of `Step`; the
lowest (grasp, start) that passes all of them is kept. What is found of a grasp whatever the arm's joints are, is found
once, for its first start.
"""

from enum import IntEnum

import warp as wp

from sceniris_gym.config.tier import Tier
from sceniris_gym.layout.wave.search import SearchSize
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.reach.solve import vec8

PREGRASP_DISTANCE = 0.08
"""How far [m] a pre-grasp is back along the approach."""
STARTS = 8
"""Starts of the inverse kinematics for each grasp: the pose that the arm has, witnesses of its map, and random ones."""
MOST_AT_ONCE = 8 * STARTS
"""The most candidates that a world has in a wave, through which one lane goes in the end."""


class Step(IntEnum):
    """What a candidate goes through, in this order. The first four are those of a grasp, the others of a start.

    The tier `ik` has MAP, IK_AT_GRASP and SELF_AT_GRASP alone.
    """

    MAP = 0
    """The grasp does not come from below, and the arm's map lets it through."""
    HAND_AT_GRASP = 1
    """The hand alone is clear of the layout."""
    HAND_AT_PREGRASP = 2
    HAND_AND_TARGET = 3
    """In the pre-grasp the hand alone is clear of what it is to grasp."""
    IK_AT_GRASP = 4
    """There are joints for the grasp, and from those on for the pre-grasp."""
    IK_AT_PREGRASP = 5
    SELF_AT_GRASP = 6
    """The robot is clear of itself."""
    SCENE_AT_GRASP = 7
    """The robot is clear of the layout."""
    SELF_AT_PREGRASP = 8
    SCENE_AT_PREGRASP = 9
    TARGET_AT_PREGRASP = 10
    PASSED = 11


@wp.struct
class ReachSearch:
    """The arrays of a search for joints as device code takes them."""

    # Worlds
    arm: wp.array[int]  # the arm whose turn it is
    column: wp.array[int]  # the reach target that it is at
    number: wp.array[int]  # the next start to try, those of all grasps that are left by the map one by one
    tried: wp.array[int]  # how many starts of this target have been tried in vain
    furthest: wp.array[int]  # the last step that any candidate of this target came to
    first: wp.array[int]  # its first candidate in this wave
    trials: wp.array[int]  # and how many it has; 0 if the wave has no room for it
    queue: wp.array2d[int]  # worlds that go on; two lists, of which one is read and one written
    # Counts
    worlds_left: wp.array[int]
    source: wp.array[int]  # which list of `queue` is read
    worlds: wp.array[int]  # number of worlds in it
    at_once: wp.array[int]  # candidates of each world
    candidates: wp.array[int]
    # Candidates
    world: wp.array[int]
    grasp: wp.array[int]
    start: wp.array[int]
    failed: wp.array[int]  # the step that it failed at, PASSED for none
    grasp_qpos: wp.array[vec8]  # of the arm's joints: where the search starts, then in the grasp
    pregrasp_qpos: wp.array[vec8]
    # The robot as it is posed for a test; nothing else is posed here.
    qpos: wp.array2d[float]
    body_pos: wp.array2d[wp.vec3]
    body_quat: wp.array2d[wp.vec4]


@wp.func
def reach_candidate_num(reach_search: ReachSearch) -> int:
    """How many candidates this wave has: those that worlds asked for, as far as there is room."""
    return wp.min(reach_search.candidates[0], reach_search.failed.shape[0])


@wp.func
def queue_world(reach_search: ReachSearch, worldid: int):
    """Let a world take part in the next wave."""
    reach_search.queue[1 - reach_search.source[0], wp.atomic_add(reach_search.worlds_left, 0, 1)] = worldid


@wp.func
def first_start(reach_search: ReachSearch, c: int) -> int:
    """The candidate that goes through the steps of a grasp for all its starts; -1: it has passed in an earlier wave."""
    found = c - reach_search.start[c]
    if found < reach_search.first[reach_search.world[c]]:
        return -1
    return found


@wp.func
def takes_step(reach: Reach, reach_search: ReachSearch, c: int, step: int) -> bool:
    """Whether a candidate has come to a step, and goes through it itself."""
    if reach_search.failed[c] < step:
        return False
    if step < Step.IK_AT_GRASP and reach_search.start[c] != 0:
        return False
    if step == Step.MAP:
        return True
    if step == Step.IK_AT_GRASP:
        return True
    if step == Step.SELF_AT_GRASP:
        return True
    return reach.reach_tier[reach_search.column[reach_search.world[c]]] == Tier.CLEAR


def create_reach_search(compiled: CompiledScene, nworld: int, size: SearchSize) -> ReachSearch:
    """Allocate the arrays of a search for the joints of `nworld` worlds."""
    ncand = min(size.grasps, nworld * MOST_AT_ONCE)
    s = ReachSearch()
    with wp.ScopedDevice(compiled.device):
        for name in ("arm", "column", "number", "tried", "furthest", "first", "trials"):
            setattr(s, name, wp.zeros(nworld, dtype=int))
        s.queue = wp.zeros((2, nworld), dtype=int)
        for name in ("worlds_left", "source", "worlds", "at_once", "candidates"):
            setattr(s, name, wp.zeros(1, dtype=int))
        for name in ("world", "grasp", "start", "failed"):
            setattr(s, name, wp.zeros(ncand, dtype=int))
        s.grasp_qpos = wp.zeros(ncand, dtype=vec8)
        s.pregrasp_qpos = wp.zeros(ncand, dtype=vec8)
        s.qpos = wp.zeros((ncand, compiled.mjm.nq), dtype=float)
        s.body_pos = wp.zeros((ncand, compiled.mjm.nbody), dtype=wp.vec3)
        s.body_quat = wp.zeros((ncand, compiled.mjm.nbody), dtype=wp.vec4)
    return s
