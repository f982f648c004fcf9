"""`ReachSearch`: the state of a search for the joints of grasps, with a queue of rows and their candidates.

Once all objects of a row are placed, the row works through its arms in order, through the reach targets of each arm,
and through the grasps of each target. A *candidate* is one grasp with one *IK start*: the initial joint positions of
the inverse kinematics. A candidate takes the steps of `ReachStep` in order. The first grasp with an IK start that
passes all steps is kept, with its first such IK start. Steps that do not depend on the arm's joints are taken once per
grasp, by the candidate with its first IK start. On a GPU, these steps and the inverse kinematics run at the same time.
The first step that fails counts.
"""

from enum import IntEnum

import warp as wp

from sceniris_gym.config.tier import Tier
from sceniris_gym.layout.wave.search import SearchSize
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import allocate
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.reach.solve import vec8

PREGRASP_DISTANCE = 0.08
"""Distance [m] of a pre-grasp from its grasp, back along the approach axis."""
STARTS = 8
"""Starts of the inverse kinematics per grasp: the arm's present pose, joints from its map, then random joints."""
MOST_AT_ONCE = 64 * STARTS
"""Maximum number of a row's candidates in a wave. At the end of the wave, a single lane goes through them."""
IN_HAND = max(Tier) + 1
"""The tier of a target whose start is tested with the target in the robot's hand, away from its place."""
GRASPED = max(Tier) + 2
"""The tier of a target whose start needs a grasp as for `clear`, but no pre-grasp."""


class ReachStep(IntEnum):
    """Tests of a candidate, in this order. The first four depend only on the grasp, the others also on initial joints.

    The tier `ik` takes only MAP, IK_AT_GRASP and SELF_AT_GRASP.
    """

    DEFERRED = -1
    """Not tested yet: the candidate has joints, but this wave tests only earlier candidates of its row."""
    MAP = 0
    """The grasp does not approach from below, and the arm's map accepts it."""
    HAND_AT_GRASP = 1
    """The hand, without the arm, is clear of the layout."""
    HAND_AT_PREGRASP = 2
    HAND_AND_TARGET = 3
    """In the pre-grasp, the hand is clear of its target."""
    IK_AT_GRASP = 4
    """Inverse kinematics finds joints for the grasp. The search for joints of the pre-grasp starts from them."""
    IK_AT_PREGRASP = 5
    SELF_AT_GRASP = 6
    """The robot is clear of itself."""
    SCENE_AT_GRASP = 7
    """The robot is clear of the layout."""
    SELF_AT_PREGRASP = 8
    SCENE_AT_PREGRASP = 9
    TARGET_AT_PREGRASP = 10
    PATH = 11
    """A path leads from the start pose to the grasp."""
    PASSED = 12


@wp.struct
class ReachSearch:
    """The arrays of a search for joints on the device."""

    # Rows
    arm: wp.array[int]  # the current arm
    column: wp.array[int]  # the current reach target
    number: wp.array[int]  # number of the next start, counted over all grasps from the first that the map accepts
    total: wp.array[int]  # total number of candidates of this target
    tried: wp.array[int]  # starts of this target that have failed so far
    paths: wp.array[int]  # candidates of this target without a path so far
    ends: wp.array2d[vec8]  # the pre-grasp of the current candidate, and vias from which the way to it is free
    end_num: wp.array[int]
    best_path: wp.array[int]  # the first free path of the current candidate so far, and the block that found it
    tier: wp.array2d[int]  # the required tier of each target, from the scene file or the start of the row's world
    furthest: wp.array[int]  # the last step that any candidate of this target reached
    first: wp.array[int]  # the row's first candidate in this wave
    trials: wp.array[int]  # number of the row's candidates, 0 if the wave has no room for them
    queue: wp.array2d[int]  # rows that continue: two lists, one read and one written
    # Counts
    rows_left: wp.array[int]
    source: wp.array[int]  # the list of `queue` to read
    rows: wp.array[int]  # number of rows in this list
    candidates: wp.array[int]
    # Candidates
    row: wp.array[int]
    grasp: wp.array[int]
    ik_start: wp.array[int]
    failed: wp.array[int]  # the failed step, PASSED if all steps passed, or DEFERRED if the candidate is tried again
    grasp_qpos: wp.array[vec8]  # the arm's joints: first the start, then the solution for the grasp
    pregrasp_qpos: wp.array[vec8]
    path: wp.array2d[vec8]  # the start and two vias of a path
    hard_num: wp.array[int]  # candidates whose drawn paths are tried
    hard: wp.array[int]
    # Blocks: the path that is tested, and the robot in its pre-grasp
    corner: wp.array3d[float]  # joints at the start, two vias, the pre-grasp and the grasp
    joint_pos: wp.array2d[wp.vec3]  # origins [m] and axes of the joints in the world
    joint_axis: wp.array2d[wp.vec3]
    # The state of the robot, posed for a test: first of all candidates in the grasp, then in the pre-grasp, see
    # `pose_index`. Entries of other bodies are not used.
    qpos: wp.array2d[float]
    body_pos: wp.array2d[wp.vec3]
    body_quat: wp.array2d[wp.vec4]
    # The hand posed at each grasp of `early_grasp`, in the frame of the grasped body.
    hand_qpos: wp.array2d[float]
    hand_pos: wp.array2d[wp.vec3]
    hand_quat: wp.array2d[wp.vec4]


@wp.func
def candidate_num(reach_search: ReachSearch) -> int:
    """Return the number of candidates in this wave, at most the capacity. The counter may exceed the capacity."""
    return wp.min(reach_search.candidates[0], reach_search.failed.shape[0])


@wp.func
def begin_reach_wave(reach_search: ReachSearch):
    """Begin a wave with the queued rows. A single lane calls this after the rows have got their candidates."""
    reach_search.rows[0] = reach_search.rows_left[0]
    reach_search.rows_left[0] = 0
    reach_search.hard_num[0] = 0
    reach_search.source[0] = 1 - reach_search.source[0]


@wp.func
def queue_row(reach_search: ReachSearch, row: int):
    """Queue a row for the next wave."""
    reach_search.queue[1 - reach_search.source[0], wp.atomic_add(reach_search.rows_left, 0, 1)] = row


@wp.func
def queue_target(reach_search: ReachSearch, row: int, column: int, total: int):
    """Queue a row for the reach target `column`, which has `total` candidates."""
    reach_search.column[row] = column
    reach_search.number[row] = 0
    reach_search.total[row] = total
    reach_search.tried[row] = 0
    reach_search.paths[row] = 0
    reach_search.furthest[row] = ReachStep.MAP
    queue_row(reach_search, row)


@wp.func
def pose_index(reach_search: ReachSearch, c: int, pose: int) -> int:
    """Return the row of `qpos` and `body_pos` with a pose of a candidate: 0 in the grasp, 1 in the pre-grasp."""
    return c + pose * reach_search.failed.shape[0]


@wp.func
def fail_grasp(reach_search: ReachSearch, c: int, step: int):
    """Let all candidates of this wave fail at `step` that have the grasp of `c`, the grasp's first candidate."""
    row = reach_search.row[c]
    last = wp.min(c + wp.static(STARTS), reach_search.first[row] + reach_search.trials[row])
    for other in range(c, last):
        wp.atomic_min(reach_search.failed, other, step)


@wp.func
def needs_pregrasp(tier: int) -> bool:
    """Return True if a tier tests the pre-grasp, too."""
    return tier == Tier.CLEAR or tier == Tier.PATH


@wp.func
def takes_step(reach_search: ReachSearch, c: int, step: int) -> bool:
    """Return True if a candidate has to take `step` and has passed all steps before `step`.

    Only the first candidate of each grasp takes the steps before the inverse kinematics.
    """
    if reach_search.failed[c] < step:
        return False
    if step < ReachStep.IK_AT_GRASP and reach_search.ik_start[c] != 0:
        return False
    if step == ReachStep.MAP or step == ReachStep.IK_AT_GRASP or step == ReachStep.SELF_AT_GRASP:
        return True
    row = reach_search.row[c]
    tier = reach_search.tier[row, reach_search.column[row]]
    if step == ReachStep.HAND_AT_GRASP or step == ReachStep.SCENE_AT_GRASP:
        return tier >= Tier.CLEAR
    return needs_pregrasp(tier)


def create_reach_search(compiled: CompiledScene, nrow: int, size: SearchSize, early: int = 0) -> ReachSearch:
    """Allocate the arrays of a search for joints in `nrow` rows.

    `early` is the number of grasps that an object may block if it is placed after the object to grasp.
    """
    ncand, mjm, reaching = min(size.grasps, nrow * MOST_AT_ONCE), compiled.mjm, compiled.reaching
    assert reaching is not None
    paths = reaching.on_path
    shapes = {
        "arm column number total tried paths end_num best_path furthest first trials": nrow,
        "queue": (2, nrow),
        "tier": (nrow, len(reaching.targets)),
        "rows_left source rows candidates hard_num": 1,
        "row grasp ik_start failed grasp_qpos pregrasp_qpos": ncand,
        "ends": (nrow if paths else 0, 4),
        "hard": nrow if paths else 0,
        "path": (ncand if paths else 0, 3),
        "corner": (size.blocks if paths else 0, 5, MAX_JOINTS),
        "joint_pos joint_axis": (size.blocks if paths else 0, MAX_JOINTS),
        "qpos": (2 * ncand, mjm.nq),
        "body_pos body_quat": (2 * ncand, mjm.nbody),
        "hand_qpos": (early, mjm.nq),
        "hand_pos hand_quat": (early, mjm.nbody),
    }
    return allocate(ReachSearch, ReachSearch(), shapes, compiled.device)  # pyrefly: ignore[missing-argument]
