"""Arms and reach targets as device code reads them.

Each arm has a `Reach` of its own; they differ in the fields of the arm and its gripper. Reach targets are in placement
order, each with its column in `Layouts.grasp`. A grasp is a frame of the TCP, +z the approach axis and +y the closing
axis, in the frame of one of the object's bodies.
"""

import warp as wp

from sceniris_gym.reach.lookup import MapView
from sceniris_gym.reach.solve import ArmView

UNASKED, BASE = -1, -2
"""Values of `obj_reach` for objects that are no reach targets: an arm's base is tested for the targets of the arm."""


@wp.struct
class Reach:
    """An arm of a scene with the reach targets of all arms; never written after `compile_scene`."""

    # The arm.
    number: int  # the first arm is 0
    last: int  # number of the last arm
    base_body: int
    base_obj: int  # the placed object that is its base, if it is placed after some of its targets; else -1
    arm_qposadr: wp.array[int]  # of the joints of `arm`
    arm_body: wp.array[int]  # all bodies of the robot but its root, parents before children
    hand_body: wp.array[int]  # those that the arm's last joint carries, the joint's own body first
    hand_pos: wp.vec3  # pose of that first body in the TCP's frame
    hand_quat: wp.vec4
    mapped: bool  # `map` is the arm's; without a map placing accepts all candidates
    map: MapView
    arm: ArmView

    # Its gripper: joint positions at the least and greatest gap, between which they are interpolated, and joints that
    # follow them, as in `Program`.
    grip_qposadr: wp.array[int]
    grip_closed: wp.array[float]
    grip_open: wp.array[float]
    gap_closed: float
    gap_open: float
    follow_driveradr: wp.array[int]
    follow_qposadr: wp.array[int]
    follow_coef: wp.array2d[wp.float64]

    # Objects in placement order, and the variants of `Program`.
    obj_reach: wp.array[int]  # its reach target, or UNASKED, or BASE for `base_obj`
    variant_graspadr: wp.array[int]
    variant_graspnum: wp.array[int]

    # Reach targets.
    reach_obj: wp.array[int]
    reach_slot: wp.array[int]
    reach_arm: wp.array[int]  # number of the arm that is to reach it
    reach_late: wp.array[bool]  # it is placed before the base of that arm
    reach_early: wp.array[bool]  # each object placed after it has to leave it a free grasp
    reach_tier: wp.array[int]
    reach_least: wp.array[int]  # the lowest Verdict of the map that placing accepts
    reach_below: wp.array[bool]  # it stands on something, so grasps from below are not tried
    reach_graspadr: wp.array[int]
    reach_graspnum: wp.array[int]

    # Grasps.
    early_grasp: wp.array[int]  # those of targets with `reach_early`
    grasp_reach: wp.array[int]  # the reach target
    grasp_body: wp.array[int]
    grasp_pos: wp.array[wp.vec3]
    grasp_quat: wp.array[wp.vec4]
    grasp_opening: wp.array[float]  # gap of the gripper

    # Lists of pairs of `Program` for an arm in a grasp, and for each reach target the number of its list.
    arm_pairadr: wp.array[int]
    arm_pairnum: wp.array[int]
    arm_broadadr: wp.array[int]
    arm_broadnum: wp.array[int]
    arm_self: wp.array[int]  # the robot with itself
    arm_scene: wp.array[int]  # the robot with all but markers; its hand may touch the target
    arm_hand: wp.array[int]  # the hand alone with all but markers and the target
    arm_target: wp.array[int]  # the hand with the target
    arm_held: wp.array[int]  # the robot and the target, which its hand may touch, with all but markers
    # How many broad-phase pairs in `arm_hand` of each reach target are with bodies of no placed object, or of one
    # before each object, and how many there are; they are in that order.
    hand_before: wp.array[int]
