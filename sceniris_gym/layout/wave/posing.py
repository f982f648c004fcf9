"""Poses of a candidate's bodies at its drawn point."""

import warp as wp

from sceniris_gym.collide.leaves import PairPoses, pair_poses
from sceniris_gym.device.transforms import mul_quat, quat_mat, quat_z
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.search import NO_GRASP, Search
from sceniris_gym.placement.kinematics import pose_bodies
from sceniris_gym.placement.measure import facing
from sceniris_gym.placement.placed import is_there
from sceniris_gym.program.device import OrientationType, Program
from sceniris_gym.program.placed_object import COS_MAX_TILT_32


@wp.func
def heading_at(
    program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, at: wp.vec2
) -> float:
    """Return the heading [rad] of a candidate at a point: as drawn, or the direction to the object that it faces."""
    target = program.obj_target[obj]
    if program.obj_orientation[obj] == OrientationType.FACE_TO and is_there(layouts.present[row], target):
        pivot_pose = layouts.pivot_pose[row, target]
        return search.stable_draw[c].yaw + facing(at, wp.vec2(pivot_pose[0], pivot_pose[1]))
    return search.heading[c]


@wp.func
def pose_candidate(program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int):
    """Pose the bodies of a candidate's object, with the pivot above the drawn point."""
    drawn = search.stable_draw[c]
    point = search.point[c]
    heading = heading_at(program, layouts, search, c, row, obj, wp.vec2(point[0], point[1]))
    pivot = point
    if program.obj_ground[obj] >= 0:
        pivot = point + wp.vec3(0.0, 0.0, program.obj_gap[obj])
    root = program.obj_body[obj]
    quat = wp.normalize(mul_quat(quat_z(heading), drawn.quat))
    if program.obj_upright[obj] < wp.static(COS_MAX_TILT_32):  # the object leans with its support
        up = quat_mat(layouts.body_quat[row, program.obj_ground[obj]]) * wp.vec3(0.0, 0.0, 1.0)
        # the shortest rotation from the world's z axis to the support's z axis
        quat = wp.normalize(mul_quat(wp.vec4(1.0 + up[2], -up[1], up[0], 0.0), quat))
    search.body_pos[c, root] = pivot - quat_mat(quat) * drawn.pivot
    search.body_quat[c, root] = quat
    pose_bodies(program, obj, 1, search.qpos[c], search.body_pos[c], search.body_quat[c])
    search.pivot_pose[c] = wp.vec4(pivot[0], pivot[1], pivot[2], heading)
    search.bounds[c] = drawn.bounds
    search.grasp[c] = NO_GRASP
    search.covered[c] = 0
    search.overhanging[c] = 0


@wp.func
def candidate_poses(program: Program, layouts: LayoutsView, search: Search, c: int, row: int, pair: int) -> PairPoses:
    """Return the poses of a pair's bodies, from the candidate and from the objects already placed in its row."""
    own_pos = search.body_pos[c]
    own_quat = search.body_quat[c]
    return pair_poses(program, pair, own_pos, own_quat, layouts.body_pos[row], layouts.body_quat[row])
