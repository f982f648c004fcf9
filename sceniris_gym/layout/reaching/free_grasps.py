"""Free grasps: a new object has to leave each earlier reach target of tier `clear` at least one free grasp.

A grasp is *free* if the arm's map accepts it and the hand is clear of all objects placed after the target. A candidate
that blocks the last free grasp of a target is rejected with the cause BLOCKED. The next trial of the same object then
follows, which costs less than a restart. The reach stage tries only free grasps. These rules do not apply to targets
that are placed before their robot.
"""

import warp as wp

from sceniris_gym.collide.boxes import NARROW_STACK, SHARED_STACK, UNPROVEN, collides, collides_without_stack
from sceniris_gym.collide.leaves import margin_of
from sceniris_gym.device.blocks import block_sync
from sceniris_gym.device.transforms import mul_quat, pose_of, rot_vec_quat
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.poses import pose_hand
from sceniris_gym.layout.reaching.search import ReachSearch
from sceniris_gym.layout.wave.search import Search, Workspace, candidate_num
from sceniris_gym.placement.grasps import passes_map
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach

_OPTIONS = {"enable_backward": False, "fuse_fp": False}
wp.set_module_options(_OPTIONS)

_SLACK = wp.constant(1.0e-3)
"""If two spheres are within this distance [m], the exact test decides. The distance is far above rounding errors."""


@wp.kernel
def _pose_hands(
    program: Program,
    reach: Reach,
    # ReachSearch both: hand_qpos, hand_pos, hand_quat
    reach_search: ReachSearch,
):
    early = wp.tid()
    grasp = reach.early_grasp[early]
    if reach.reach_arm[reach.grasp_reach[grasp]] == reach.number:
        pos = reach_search.hand_pos[early]
        quat = reach_search.hand_quat[early]
        quat[reach.grasp_body[grasp]] = wp.vec4(1.0, 0.0, 0.0, 0.0)
        qpos = reach_search.hand_qpos[early]
        pose_hand(program, reach, grasp, 0.0, pos, quat, program.home_qpos, qpos, pos, quat)


def launch_pose_hands(work: Workspace, reach: Reach, reach_search: ReachSearch) -> None:
    """Pose the hand at each grasp, in the frame of the grasped body. Joints outside the gripper keep the home pose."""
    work.launch(_pose_hands, reach.early_grasp.shape[0], work.program, reach, reach_search)


@wp.func
def _needs_free_grasp(reach: Reach, layouts: LayoutsView, row: int, obj: int, column: int) -> bool:
    """Return True if a candidate of object `obj` has to leave a free grasp to target `column`.

    This is so only if the target belongs to the arm of `reach`, was placed earlier and is present.
    """
    if reach.reach_arm[column] != reach.number or reach.reach_obj[column] >= obj:
        return False
    return reach.reach_early[column] and layouts.present[row, reach.reach_slot[column]] != 0


@wp.func
def _is_accepted(reach: Reach, layouts: LayoutsView, search: Search, c: int, column: int, grasp: int) -> bool:
    """Return True if a grasp fits the stable pose of a candidate of a reach target, and the map accepts this grasp."""
    number = grasp - reach.stable_graspadr[search.stable_draw[c].stable]
    if number < 0 or number >= reach.stable_graspnum[search.stable_draw[c].stable]:
        return False
    row = search.row[c]
    base = pose_of(layouts.body_pos[row, reach.base_body], layouts.body_quat[row, reach.base_body])
    return passes_map(reach, column, grasp, base, search.body_pos[c], search.body_quat[c])


@wp.func
def _pairs_of(program: Program, reach: Reach, column: int, obj: int):
    """Return the index of the first broad-phase pair between the hand and an object, and the number of these pairs."""
    i = column * (program.nobject + 1) + obj
    before = reach.hand_before[i]
    return reach.arm_broadadr[reach.arm_hand[column]] + before, reach.hand_before[i + 1] - before


@wp.func
def _is_near(
    program: Program,
    reach: Reach,
    layouts: LayoutsView,
    search: Search,
    reach_search: ReachSearch,
    c: int,
    early: int,
    adr: int,
    num: int,
) -> bool:
    """Return True if the hand at a grasp is near a candidate, judged by spheres around their boxes.

    `early` is the index of the grasp in `Reach.early_grasp`. The broad-phase pairs to test are the `num` entries from
    address `adr` on.
    """
    row = search.row[c]
    grasped = reach.grasp_body[reach.early_grasp[early]]
    at = layouts.body_pos[row, grasped]
    rotation = layouts.body_quat[row, grasped]
    for i in range(adr, adr + num):
        entry = program.broad_pair[i]
        if program.pair_bodies[entry[0]][3] >= 0:  # a plane has no box
            return True
        a = program.pair_bodies[entry[0]][0]
        b = program.pair_bodies[entry[0]][1]
        hand = rot_vec_quat(program.node_center[entry[1]], reach_search.hand_quat[early, a])
        hand = at + rot_vec_quat(reach_search.hand_pos[early, a] + hand, rotation)
        there = search.body_pos[c, b] + rot_vec_quat(program.node_center[entry[2]], search.body_quat[c, b])
        radius = wp.length(program.node_half[entry[1]]) + wp.length(program.node_half[entry[2]])
        if wp.length(there - hand) <= radius + wp.max(margin_of(program, 0, entry[0], -1), 0.0) + _SLACK:
            return True
    return False


@wp.kernel(grid_stride=False)
def _queue_hands(
    lanes: int,
    program: Program,
    reach: Reach,
    # Layouts in: present, bodies*
    layouts: LayoutsView,
    # Search in: row_free, candidates, row, obj, cause, stable_draw, body_pos, body_quat; out: free, hand; both: hands
    search: Search,
    # ReachSearch in: hand_pos, hand_quat
    reach_search: ReachSearch,
):
    num = reach.early_grasp.shape[0]
    for i in range(wp.tid(), candidate_num(search) * num, lanes):
        c = i // num
        early = i % num
        grasp = reach.early_grasp[early]
        column = reach.grasp_reach[grasp]
        if search.cause[c] != Cause.NONE or reach.reach_arm[column] != reach.number:
            continue
        row = search.row[c]
        obj = search.obj[c]
        free = search.row_free[row, early]
        if reach.reach_obj[column] == obj:
            free = _is_accepted(reach, layouts, search, c, column, grasp)
        elif free:
            if _needs_free_grasp(reach, layouts, row, obj, column):
                adr, num_pairs = _pairs_of(program, reach, column, obj)
                if _is_near(program, reach, layouts, search, reach_search, c, early, adr, num_pairs):
                    search.hand[wp.atomic_add(search.hands, 0, 1)] = i
        search.free[c, early] = free


@wp.kernel(module="unique", module_options=_OPTIONS, grid_stride=False, cuda_max_registers=128)
def _test_hands(
    blocks: int,
    program: Program,
    reach: Reach,
    # Layouts in: bodies*
    layouts: LayoutsView,
    # Search in: hands, row, obj, hand, body_pos, body_quat; out: free
    search: Search,
    # ReachSearch in: hand_pos, hand_quat; both: body_pos, body_quat
    reach_search: ReachSearch,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec3i)
    leaves = wp.tile_stack(capacity=wp.static(NARROW_STACK), dtype=wp.vec3i)
    pos = reach_search.body_pos[block]
    quat = reach_search.body_quat[block]
    for i in range(block, search.hands[0], blocks):
        c = search.hand[i] // reach.early_grasp.shape[0]
        early = search.hand[i] % reach.early_grasp.shape[0]
        obj = search.obj[c]
        grasp = reach.early_grasp[early]
        column = reach.grasp_reach[grasp]
        at = layouts.body_pos[search.row[c], reach.grasp_body[grasp]]
        rotation = layouts.body_quat[search.row[c], reach.grasp_body[grasp]]
        for k in range(lane, reach.hand_body.shape[0], wp.block_dim()):
            body = reach.hand_body[k]
            pos[body] = at + rot_vec_quat(reach_search.hand_pos[early, body], rotation)
            quat[body] = wp.normalize(mul_quat(rotation, reach_search.hand_quat[early, body]))
        block_sync()
        adr, num = _pairs_of(program, reach, column, obj)
        body_pos = search.body_pos[c]
        body_quat = search.body_quat[c]
        found = collides(program, adr, num, 0, -1, nodes, leaves, lane, pos, quat, body_pos, body_quat)
        hit = found == Cause.COLLISION
        if found == UNPROVEN:
            hit = collides_without_stack(program, adr, num, lane, pos, quat, body_pos, body_quat)
        if lane == 0 and hit:
            search.free[c, early] = False


@wp.kernel(grid_stride=False)
def _reject_blocked(
    lanes: int,
    reach: Reach,
    # Layouts in: present
    layouts: LayoutsView,
    # Search in: candidates, row, obj, free; out: hands; both: cause
    search: Search,
):
    if wp.tid() == 0:
        search.hands[0] = 0  # of the next arm or wave
    for c in range(wp.tid(), candidate_num(search), lanes):
        if search.cause[c] != Cause.NONE:
            continue
        for column in range(reach.reach_obj.shape[0]):
            if _needs_free_grasp(reach, layouts, search.row[c], search.obj[c], column):
                free = int(0)
                for early in range(reach.early_grasp.shape[0]):
                    if reach.grasp_reach[reach.early_grasp[early]] == column:
                        free += int(search.free[c, early])
                if free == 0:
                    search.cause[c] = Cause.BLOCKED


def launch_test_hands(work: Workspace, reach: Reach, reach_search: ReachSearch) -> None:
    """Find the free grasps of candidates that passed all other tests. Reject candidates that leave no free grasp."""
    inputs = [work.program, reach, work.layouts, work.search, reach_search]
    work.launch_lanes(_queue_hands, *inputs)
    work.launch_blocks(_test_hands, *inputs, blocks=min(work.size.blocks, len(reach_search.failed)))
    work.launch_lanes(_reject_blocked, reach, work.layouts, work.search)
