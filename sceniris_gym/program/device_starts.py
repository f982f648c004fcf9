"""Kinds of starts as device code reads them, by the number of the kind in the scene file."""

from enum import IntEnum

import warp as wp


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
