"""Pose the hand or the whole robot of a candidate in a grasp or pre-grasp. One lane works on one pose."""

import warp as wp

from sceniris_gym.device.transforms import mul_quat, neg_quat, rot_vec_quat, z_axis
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.search import (
    PREGRASP_DISTANCE,
    ReachSearch,
    ReachStep,
    candidate_num,
    pose_index,
    takes_step,
)
from sceniris_gym.layout.wave.search import Workspace
from sceniris_gym.placement.grasps import tcp_of
from sceniris_gym.placement.kinematics import follow_joint, pose_body
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.reach.solve import vec8

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

OPENING_MARGIN = 0.01
"""The gripper opens by this gap [m] more than the grasp needs, but at most to the end of its range."""


@wp.func
def take_joints(program: Program, bodies: wp.array[int], from_qpos: wp.array[float], qpos: wp.array[float]):
    """Copy the joint positions of the given bodies: read them from `from_qpos`, and write them to `qpos`."""
    for i in range(bodies.shape[0]):
        body = bodies[i]
        for joint in range(program.body_jntadr[body], program.body_jntadr[body] + program.body_jntnum[body]):
            adr = program.jnt_qposadr[joint]
            qpos[adr] = from_qpos[adr]


@wp.func
def open_gripper(reach: Reach, grasp: int, qpos: wp.array[float]):
    """Open the gripper to the gap [m] that a grasp needs, plus a margin, as far as the gripper can open."""
    gap = wp.min(reach.grasp_opening[grasp] + wp.static(OPENING_MARGIN), reach.gap_open)
    share = (gap - reach.gap_closed) / wp.max(reach.gap_open - reach.gap_closed, 1.0e-6)
    set_gripper(reach, share, qpos)


@wp.func
def set_gripper(reach: Reach, share: float, qpos: wp.array[float]):
    """Open the gripper to a fraction of its range, from 0 (closed) to 1 (open)."""
    for i in range(reach.grip_qposadr.shape[0]):
        joint = reach.grip_closed[i] + wp.clamp(share, 0.0, 1.0) * (reach.grip_open[i] - reach.grip_closed[i])
        qpos[reach.grip_qposadr[i]] = joint
    for i in range(reach.follow_qposadr.shape[0]):
        follow_joint(reach.follow_driveradr, reach.follow_qposadr, reach.follow_coef, i, qpos)


@wp.func
def pose_hand(
    program: Program,
    reach: Reach,
    grasp: int,
    back: float,
    target_pos: wp.array[wp.vec3],
    target_quat: wp.array[wp.vec4],
    from_qpos: wp.array[float],
    qpos: wp.array[float],
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
):
    """Pose the hand at a grasp of a posed target, moved back by `back` [m] along the approach axis."""
    take_joints(program, reach.hand_body, from_qpos, qpos)
    open_gripper(reach, grasp, qpos)
    pos, quat = tcp_of(reach, grasp, target_pos, target_quat)
    root = reach.hand_body[0]
    body_pos[root] = pos - back * z_axis(quat) + rot_vec_quat(reach.hand_pos, quat)
    body_quat[root] = wp.normalize(mul_quat(quat, reach.hand_quat))
    for i in range(1, reach.hand_body.shape[0]):
        pose_body(program, reach.hand_body[i], qpos, body_pos, body_quat)


@wp.func
def in_base(reach: Reach, layouts: LayoutsView, row: int, pos: wp.vec3, quat: wp.vec4):
    """Transform a pose of the TCP from the world frame to the frame of the arm's base."""
    back = neg_quat(layouts.body_quat[row, reach.base_body])
    return rot_vec_quat(pos - layouts.body_pos[row, reach.base_body], back), wp.normalize(mul_quat(back, quat))


@wp.func
def pose_arm(
    program: Program,
    reach: Reach,
    layouts: LayoutsView,
    row: int,
    joints: vec8,
    qpos: wp.array[float],
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
):
    """Pose the bodies of a robot, with its base as in the row.

    `joints` are the positions of the arm's joints. The positions of all other joints are in `qpos`.
    """
    for i in range(MAX_JOINTS):
        if i < reach.arm.njoint:
            qpos[reach.arm_qposadr[i]] = joints[i]
    body_pos[reach.base_body] = layouts.body_pos[row, reach.base_body]
    body_quat[reach.base_body] = layouts.body_quat[row, reach.base_body]
    for i in range(reach.arm_body.shape[0]):
        pose_body(program, reach.arm_body[i], qpos, body_pos, body_quat)


@wp.func
def _is_deferred(reach_search: ReachSearch, at_once: int, c: int) -> bool:
    """Return True if a candidate's test can wait, because enough earlier candidates of its row have joints.

    A candidate has joints once its inverse kinematics has succeeded. The first valid candidate wins, and is usually the
    row's first candidate. More candidates of a row are tested after failures, and in waves with few rows, because a
    launch tests `at_once` candidates as fast as one. If the wave has no room for all candidates, no test is deferred,
    which bounds the number of waves. Other lanes may defer earlier candidates at the same time, so deferred candidates
    also count as candidates with joints.
    """
    if reach_search.candidates[0] > reach_search.failed.shape[0]:
        return False
    row = reach_search.row[c]
    left = wp.max(1 + 8 * reach_search.tried[row], at_once // reach_search.rows[0])
    other = int(reach_search.first[row])
    while left > 0 and other < c:
        failed = reach_search.failed[other]
        if failed == ReachStep.DEFERRED or failed >= ReachStep.SELF_AT_GRASP:
            left -= 1
        other += 1
    return left == 0


@wp.kernel(grid_stride=False)
def _pose(
    lanes: int,
    program: Program,
    reach: Reach,
    first: int,
    second: int,
    at_once: int,
    # Layouts in: qpos, bodies*
    layouts: LayoutsView,
    # ReachSearch in: column, tried, tier, first, rows, candidates, row, grasp, ik_start, grasp_qpos, pregrasp_qpos;
    #   both: failed, qpos, body_pos, body_quat
    reach_search: ReachSearch,
):
    num = candidate_num(reach_search)
    for i in range(wp.tid(), 2 * num, lanes):
        c = i % num
        pose = i // num
        if not takes_step(reach_search, c, wp.where(pose == 0, first, second)):
            continue
        if first == ReachStep.SELF_AT_GRASP and pose == 0:
            # the lane of the other pose may pose a deferred candidate in vain
            if _is_deferred(reach_search, at_once, c):
                reach_search.failed[c] = ReachStep.DEFERRED
                continue
        row = reach_search.row[c]
        grasp = reach_search.grasp[c]
        from_qpos = layouts.qpos[row]
        at = pose_index(reach_search, c, pose)
        qpos = reach_search.qpos[at]
        pos = reach_search.body_pos[at]
        quat = reach_search.body_quat[at]
        if first < ReachStep.IK_AT_GRASP:
            back = float(pose) * wp.static(PREGRASP_DISTANCE)
            target_pos = layouts.body_pos[row]
            pose_hand(program, reach, grasp, back, target_pos, layouts.body_quat[row], from_qpos, qpos, pos, quat)
        else:
            joints = reach_search.grasp_qpos[c]
            if pose == 1:
                joints = reach_search.pregrasp_qpos[c]
            take_joints(program, reach.arm_body, from_qpos, qpos)
            open_gripper(reach, grasp, qpos)
            pose_arm(program, reach, layouts, row, joints, qpos, pos, quat)


def launch_pose(
    work: Workspace, reach: Reach, first: ReachStep, second: ReachStep | None, reach_search: ReachSearch
) -> None:
    """Pose the robot of each candidate for the step `first`, and in the pre-grasp for the step `second` unless None.

    Steps before the inverse kinematics pose only the hand. Tests that can wait are deferred, see `_is_deferred`.
    """
    # On an H200, 1,000 more candidates take 0.1 ms longer. In scenes with starts, the first joints hardly ever fail.
    at_once = work.size.blocks // (2 if work.compiled.starts is None else 8)
    steps = [int(first), int(ReachStep.PASSED) + 1 if second is None else int(second)]
    work.launch_lanes(_pose, work.program, reach, *steps, at_once, work.layouts, reach_search)
