"""Arms, reach targets and kinds of starts as device code reads them.

Each arm has a `Reach` of its own; they differ in the fields of the arm and its gripper. Reach targets are in placement
order, each with its column in `Layouts.grasp`. A grasp is a frame of the TCP, +z the approach axis and +y the closing
axis, in the frame of one of the object's bodies. Kinds of starts have their number in the scene file.
"""

from enum import IntEnum

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

    # Objects in placement order, and the stable poses of `Program`.
    obj_reach: wp.array[int]  # its reach target, or UNASKED, or BASE for `base_obj`
    stable_graspadr: wp.array[int]
    stable_graspnum: wp.array[int]

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


class StartPose(IntEnum):
    """The pose of the arm at the start, and the place of the object that it holds."""

    HOME = 0
    PREGRASP = 1
    STANDING = 2
    """In the grasp; the object is where it was placed."""
    LIFTED = 3
    """In the grasp; the object is straight above where it was placed."""
    HELD = 4
    """In the grasp, wherever drawn joints bring the hand."""


@wp.struct
class Starts:
    """The kinds of starts of a scene; never written after `compile_scene`."""

    weight: wp.array[float]
    pose: wp.array[int]  # a StartPose
    arm: wp.array[int]  # number of the arm, -1 for none
    target: wp.array2d[bool]  # reach targets that it may hold, of which one is present
    grasp: wp.array2d[bool]  # grasps that count, of all grasps of `Reach`
    lift: wp.array[wp.vec2]
    arm_range: wp.array2d[wp.vec2]  # of the arm's joints; upside down for those that stay as they are
    draw_range: wp.array2d[wp.vec2]  # of the draws of `Program`; upside down for those that stay as they are
    marker: wp.array2d[int]  # for each object in placement order the number of the marker that it is placed at, or -1
    robot_qposadr: wp.array[int]  # in qpos, of the joints of all arms and their fingers
    # Grasps of `Reach` with the fingers closed on the object.
    grip_share: wp.array[float]  # opening of the gripper
    grip_pos: wp.array[wp.vec3]


@wp.func
def is_drawn(interval: wp.vec2) -> bool:
    """Return True if a start draws a joint from an interval of its own."""
    return interval[0] <= interval[1]


@wp.func
def reaches(starts: Starts, kind: int, column: int) -> bool:
    """Return True if the arm starts at a reach target where that was placed, or straight above."""
    pose = starts.pose[kind]
    return starts.target[kind, column] and pose != StartPose.HOME and pose != StartPose.HELD
