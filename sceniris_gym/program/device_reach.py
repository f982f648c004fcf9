"""Arms, reach targets and kinds of starts as device code reads them.

Each arm has a separate `Reach`. The fields for the arm and its gripper differ between arms, and all other fields are
the same. Reach targets are in placement order, each with its column in `Layouts.grasp`. A grasp is a pose of the TCP in
the frame of one of the object's bodies. The TCP's +z axis is the approach axis, and its +y axis is the closing axis.
Kinds of starts are in the order of the scene file.
"""

from enum import IntEnum

import warp as wp

from sceniris_gym.reach.lookup import MapView
from sceniris_gym.reach.solve import ArmView

UNASKED = -1
"""Value of `obj_reach` for objects that are not reach targets."""
BASE = -2
"""Value of `obj_reach` for an arm's base that is placed after a target. The base is tested with the arm's targets."""


@wp.struct
class Reach:
    """One arm of a scene, and the reach targets of all arms. The fields do not change after `compile_scene`."""

    # The arm.
    number: int  # the first arm is 0
    last: int  # number of the last arm
    base_body: int
    base_obj: int  # the placed object that is its base, if the base is placed after a target of the arm, or -1
    arm_qposadr: wp.array[int]  # of the joints of `arm`
    arm_body: wp.array[int]  # all bodies of the robot except its root, parents before children
    hand_body: wp.array[int]  # the bodies that the arm's last joint moves, the joint's body first
    hand_pos: wp.vec3  # pose of that first body in the TCP's frame
    hand_quat: wp.vec4
    # Upper bounds of the motion [m] of each body's points if a joint of the arm turns by 1 rad or slides by 1 m.
    arm_moves: wp.array2d[float]
    arm_link: wp.array[int]  # number of the arm's joints that move each body
    mapped: bool  # the arm has a map. Without a map, placing accepts all candidates.
    map: MapView
    arm: ArmView

    # Its gripper: joint positions at the least and greatest gap, interpolated for other gaps, and the joints that
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
    obj_reach: wp.array[int]  # its reach target, UNASKED, or BASE for `base_obj`
    stable_graspadr: wp.array[int]
    stable_graspnum: wp.array[int]

    # Reach targets.
    reach_obj: wp.array[int]
    reach_slot: wp.array[int]
    reach_arm: wp.array[int]  # number of the arm that has to reach it
    reach_late: wp.array[bool]  # it is placed before the base of its arm
    reach_early: wp.array[bool]  # each object placed after it has to leave it a free grasp
    reach_tier: wp.array[int]
    reach_margin: wp.array[float]  # least distance [m] on its path
    reach_least: wp.array[int]  # the lowest Verdict of the map that placing accepts
    reach_below: wp.array[bool]  # it stands on a support, so grasps from below are not tried
    reach_graspadr: wp.array[int]
    reach_graspnum: wp.array[int]

    # Grasps.
    early_grasp: wp.array[int]  # the grasps of targets with `reach_early`
    grasp_reach: wp.array[int]  # the reach target
    grasp_body: wp.array[int]
    grasp_pos: wp.array[wp.vec3]
    grasp_quat: wp.array[wp.vec4]
    grasp_opening: wp.array[float]  # gap of the gripper

    # Lists of pairs of `Program` for an arm in a grasp, and the number of the list of each reach target.
    arm_pairadr: wp.array[int]
    arm_pairnum: wp.array[int]
    arm_broadadr: wp.array[int]
    arm_broadnum: wp.array[int]
    arm_self: wp.array[int]  # the robot with itself
    arm_scene: wp.array[int]  # the robot with all bodies except markers. Its hand may touch the target.
    arm_hand: wp.array[int]  # only the hand with all bodies except markers and the target
    arm_target: wp.array[int]  # the hand with the target
    arm_held: wp.array[int]  # the robot and the target with all bodies except markers. The hand may touch the target.
    # For each reach target and object, the number of broad-phase pairs in `arm_hand` with bodies that are not placed or
    # that are placed before the object, and last the number of all pairs. The pairs are in placement order.
    hand_before: wp.array[int]


class StartPose(IntEnum):
    """The pose of the arm in a kind of start. For an arm that holds an object, also the place of this object."""

    HOME = 0
    PREGRASP = 1
    PATH = 2
    """On the path to the grasp, with open fingers."""
    STANDING = 3
    """In the grasp, with the object in its placed pose."""
    LIFTED = 4
    """In the grasp, with the object straight above its placed pose."""
    HELD = 5
    """In the grasp, with the object wherever the drawn arm joints move the hand."""


@wp.struct
class Starts:
    """The kinds of starts (entries of `start`) of a scene. They do not change after `compile_scene`."""

    pose: wp.array[int]  # a StartPose
    pregrasp: wp.array[bool]  # the arm must also reach the pre-grasp
    arm: wp.array[int]  # number of the arm, or -1
    target: wp.array2d[bool]  # the kind's reach targets. A world uses one of them.
    grasp: wp.array2d[bool]  # the selected grasps, among all grasps of `Reach`
    press: wp.array2d[float]  # how firmly the controls close the fingers on each target, 0 for targets in no hand
    lift: wp.array[wp.vec2]
    share: wp.array[wp.vec2]  # of the path's length
    arm_range: wp.array2d[wp.vec2]  # of the arm's joints, with low > high for joints that the start does not draw
    draw_range: wp.array2d[wp.vec2]  # of the draws of `Program`, with low > high for draws that the start keeps
    marker: wp.array2d[int]  # for each object in placement order, the number of its marker in placement order, or -1
    robot_qposadr: wp.array[int]  # in qpos, of the joints of all arms and their fingers
    # Grasps of `Reach` with the fingers closed on the object.
    grip_share: wp.array[float]  # opening of the gripper
    grip_pos: wp.array[wp.vec3]


@wp.func
def is_drawn(interval: wp.vec2) -> bool:
    """Return True if a start draws a joint from this interval. If low > high, the joint stays as it is."""
    return interval[0] <= interval[1]


@wp.func
def reaches(starts: Starts, kind: int, column: int) -> bool:
    """Return True if a kind of start moves the arm to the reach target `column`, or holds the target above its place.

    This can only be true for the poses `PREGRASP`, `PATH`, `STANDING` and `LIFTED`. For `HOME` and `HELD`, the arm need
    not reach the place of the target.
    """
    pose = starts.pose[kind]
    return starts.target[kind, column] and pose != StartPose.HOME and pose != StartPose.HELD
