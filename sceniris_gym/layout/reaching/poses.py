"""Poses of a candidate's robot in its grasp or pre-grasp: the hand alone, or all of it."""

import warp as wp

from sceniris_gym.device.blocks import block_sync
from sceniris_gym.device.quaternions import mul_quat, neg_quat, rot_vec_quat, z_axis
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.search import PREGRASP_DISTANCE, ReachSearch, ReachStep
from sceniris_gym.placement.grasps import tcp_of
from sceniris_gym.placement.kinematics import follow_joint, pose_body
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.reach.solve import vec8

wp.set_module_options({"enable_backward": False})

OPENING_MARGIN = 0.01
"""Gap [m] by which the gripper opens beyond what the grasp needs, within its range."""


@wp.func
def take_joints(program: Program, bodies: wp.array[int], from_qpos: wp.array[float], qpos: wp.array[float]):
    """Copy the joints of bodies from the layout."""
    for i in range(bodies.shape[0]):
        body = bodies[i]
        for joint in range(program.body_jntadr[body], program.body_jntadr[body] + program.body_jntnum[body]):
            adr = program.jnt_qposadr[joint]
            qpos[adr] = from_qpos[adr]


@wp.func
def open_gripper(reach: Reach, grasp: int, qpos: wp.array[float]):
    """Open the gripper to the gap [m] that a grasp needs, plus the margin."""
    gap = wp.min(reach.grasp_opening[grasp] + wp.static(OPENING_MARGIN), reach.gap_open)
    share = (gap - reach.gap_closed) / wp.max(reach.gap_open - reach.gap_closed, 1.0e-6)
    set_gripper(reach, share, qpos)


@wp.func
def set_gripper(reach: Reach, share: float, qpos: wp.array[float]):
    """Open the gripper by a share: 0 is closed, 1 open."""
    for i in range(reach.grip_qposadr.shape[0]):
        joint = reach.grip_closed[i] + wp.clamp(share, 0.0, 1.0) * (reach.grip_open[i] - reach.grip_closed[i])
        qpos[reach.grip_qposadr[i]] = joint
    for i in range(reach.follow_qposadr.shape[0]):
        follow_joint(reach.follow_driveradr, reach.follow_qposadr, reach.follow_coef, i, qpos)


@wp.func
def hand_at(reach: Reach, grasp: int, back: float, target_pos: wp.array[wp.vec3], target_quat: wp.array[wp.vec4]):
    """Return the pose of the hand's first body at a grasp of a posed target, or `back` [m] along the approach axis."""
    pos, quat = tcp_of(reach, grasp, target_pos, target_quat)
    pos = pos - back * z_axis(quat) + rot_vec_quat(reach.hand_pos, quat)
    return pos, wp.normalize(mul_quat(quat, reach.hand_quat))


@wp.func
def in_base(reach: Reach, layouts: LayoutsView, row: int, pos: wp.vec3, quat: wp.vec4):
    """Return a pose of the TCP, which is given in the world, in the frame of the arm's base."""
    back = neg_quat(layouts.body_quat[row, reach.base_body])
    return rot_vec_quat(pos - layouts.body_pos[row, reach.base_body], back), wp.normalize(mul_quat(back, quat))


@wp.func
def place_arm(reach: Reach, layouts: LayoutsView, row: int, joints: vec8, reach_search: ReachSearch, c: int):
    """Give a candidate joints of its arm, and the base where its row has it."""
    for i in range(MAX_JOINTS):
        if i < reach.arm.njoint:
            reach_search.qpos[c, reach.arm_qposadr[i]] = joints[i]
    reach_search.body_pos[c, reach.base_body] = layouts.body_pos[row, reach.base_body]
    reach_search.body_quat[c, reach.base_body] = layouts.body_quat[row, reach.base_body]


@wp.func
def pose_in_order(
    program: Program, bodies: wp.array[int], first: int, reach_search: ReachSearch, c: int, lane: int, lanes: int
):
    """Pose bodies of a candidate from number `first` of a list on; it has parents before children.

    A lane does so alone, or the lanes of a block together: they pose all bodies at once, as often as there are bodies,
    and each time one more body of a chain gets its pose.
    """
    num = bodies.shape[0]
    for _ in range(wp.where(lanes > 1, num - first, 1)):
        if lanes > 1:
            block_sync()
        for i in range(first + lane, num, lanes):
            pose_body(program, bodies[i], reach_search.qpos[c], reach_search.body_pos[c], reach_search.body_quat[c])
    if lanes > 1:
        block_sync()


@wp.func
def pose_for(
    program: Program, reach: Reach, layouts: LayoutsView, reach_search: ReachSearch, c: int, step: int, lane: int
):
    """Pose the robot of a candidate for a step and those that follow, the hand alone before there are joints.

    All lanes of a block call it together. Steps that have the pose of the one before them change nothing.
    """
    if (
        step == ReachStep.HAND_AND_TARGET
        or step == ReachStep.SCENE_AT_GRASP
        or step == ReachStep.SCENE_AT_PREGRASP
        or step == ReachStep.TARGET_AT_PREGRASP
    ):
        return
    row = reach_search.row[c]
    grasp = reach_search.grasp[c]
    block_sync()  # no lane reads the pose before
    if lane == 0:
        if step < ReachStep.IK_AT_GRASP:
            take_joints(program, reach.hand_body, layouts.qpos[row], reach_search.qpos[c])
            back = wp.where(step == ReachStep.HAND_AT_GRASP, 0.0, wp.static(PREGRASP_DISTANCE))
            pos, quat = hand_at(reach, grasp, back, layouts.body_pos[row], layouts.body_quat[row])
            reach_search.body_pos[c, reach.hand_body[0]] = pos
            reach_search.body_quat[c, reach.hand_body[0]] = quat
        else:
            take_joints(program, reach.arm_body, layouts.qpos[row], reach_search.qpos[c])
            joints = reach_search.pregrasp_qpos[c]
            if step == ReachStep.SELF_AT_GRASP:
                joints = reach_search.grasp_qpos[c]
            place_arm(reach, layouts, row, joints, reach_search, c)
        open_gripper(reach, grasp, reach_search.qpos[c])
    if step < ReachStep.IK_AT_GRASP:
        pose_in_order(program, reach.hand_body, 1, reach_search, c, lane, wp.block_dim())
    else:
        pose_in_order(program, reach.arm_body, 0, reach_search, c, lane, wp.block_dim())
