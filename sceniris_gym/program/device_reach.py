"""What device code sees of `reachable`: an arm, its map, and the grasps of all reach targets.

Every arm has a `Reach` of its own; they differ in what is above the lists of reach targets, and in the gripper. Reach
targets are in placement order; each has its column in `Layouts.grasp`. Grasps are frames of the TCP, +z the
approach axis and +y the closing axis, in the frame of one of the object's bodies.
"""

import warp as wp

from sceniris_gym.reach.lookup import MapView
from sceniris_gym.reach.solve import ArmView

UNASKED, BASE = -1, -2
"""What stands for the reach target of an object that is none."""


@wp.struct
class Reach:
    """An arm of a scene, and the reach targets of all arms; never written after `compile_scene`."""

    number: int  # of this arm, the first one is 0
    last: int  # number of the last arm
    base_body: int
    base_obj: int  # the placed object that is its base, if it is placed after some of its targets; else -1
    arm_qposadr: wp.array[int]  # of the joints of `arm`
    arm_body: wp.array[int]  # all bodies of the robot but its root, parents before children
    hand_body: wp.array[int]  # those that the arm's last joint carries, the joint's own body first
    hand_pos: wp.vec3  # pose of that first one in the TCP's frame
    hand_quat: wp.vec4
    mapped: int  # 0: there is no map, and placing accepts all candidates
    map: MapView
    arm: ArmView
    # For objects in placement order, and for the variants of `Program`:
    obj_reach: wp.array[int]  # its reach target, UNASKED, or BASE for the base of an arm as in `base_obj`
    variant_graspadr: wp.array[int]
    variant_graspnum: wp.array[int]
    # For reach targets:
    reach_obj: wp.array[int]
    reach_slot: wp.array[int]
    reach_arm: wp.array[int]  # number of the arm that is to reach it
    reach_late: wp.array[int]  # 1: it is placed before the base of that arm
    reach_tier: wp.array[int]
    reach_least: wp.array[int]  # the lowest Verdict of the map that placing accepts
    reach_below: wp.array[int]  # 1: it stands on something, so grasps from below are not tried
    reach_graspadr: wp.array[int]
    reach_graspnum: wp.array[int]
    # For grasps:
    grasp_body: wp.array[int]
    grasp_pos: wp.array[wp.vec3]
    grasp_quat: wp.array[wp.vec4]
    grasp_opening: wp.array[float]
    # The gripper's joints where its gap is least and widest; in between they are interpolated.
    grip_qposadr: wp.array[int]
    grip_closed: wp.array[float]
    grip_open: wp.array[float]
    grip_driveradr: wp.array[int]  # joints that follow them, as in `Program`
    grip_followadr: wp.array[int]
    grip_coef: wp.array2d[wp.float64]
    gap_closed: float
    gap_open: float
    # Lists of pairs of `Program` for an arm in a grasp, and which of them is what, for reach targets:
    arm_pairadr: wp.array[int]
    arm_pairnum: wp.array[int]
    arm_broadadr: wp.array[int]
    arm_broadnum: wp.array[int]
    arm_self: wp.array[int]  # the robot with itself
    arm_scene: wp.array[int]  # the robot with all but markers; its hand may touch the target
    arm_hand: wp.array[int]  # the hand alone with all but markers and the target
    arm_target: wp.array[int]  # the hand with the target
    # The bank of valid layouts, its rows as in `Program`; by reach targets.
    bank_grasp: wp.array2d[int]
    bank_grasp_qpos: wp.array3d[float]
    bank_pregrasp_qpos: wp.array3d[float]
