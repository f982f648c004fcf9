"""Containment: test whether points of one collider lie inside the mesh of the other, by its winding number.

If two surfaces do not intersect, one may still enclose the other.
"""

import warp as wp

from sceniris_gym.collide.leaves import PairPoses, pair_poses
from sceniris_gym.device.blocks import block_any
from sceniris_gym.device.transforms import Pose, relative
from sceniris_gym.program.device import Program


@wp.func
def in_solid(program: Program, collider: int, p: wp.vec3) -> bool:
    """Test whether a point, in the frame of a collider's body, lies inside the solid of the collider."""
    mesh = program.collider_mesh[collider]
    query = wp.mesh_query_point_sign_winding_number(mesh, p, program.collider_depth[collider])
    return query.result and query.sign < 0.0


@wp.func
def in_bounds(program: Program, collider: int, p: wp.vec3) -> bool:
    """Test whether a point, in the frame of a collider's body, lies inside the bounding box of the collider."""
    root = program.collider_root[collider]
    d = p - program.node_center[root]
    half = program.node_half[root]
    return wp.abs(d[0]) <= half[0] and wp.abs(d[1]) <= half[1] and wp.abs(d[2]) <= half[2]


@wp.func
def _has_points_inside(program: Program, a: int, b: int, rel: Pose) -> bool:
    """Test whether a component of collider a lies inside b's solid. `rel` is the pose of b's body in a's body frame."""
    at = wp.transpose(rel.rot)
    for i in range(program.collider_pointnum[a]):
        p = at * (program.point[program.collider_pointadr[a] + i] - rel.pos)
        if in_bounds(program, b, p):
            if in_solid(program, b, p):
                return True
    return False


@wp.func
def is_one_inside(program: Program, pair: int, poses: PairPoses) -> bool:
    """Test whether one collider of a pair lies inside the other."""
    a = program.pair_a[pair]
    b = program.pair_b[pair]
    if program.collider_plane[b] >= 0:
        return False
    if _has_points_inside(program, a, b, relative(poses.a, poses.b)):
        return True
    return _has_points_inside(program, b, a, relative(poses.b, poses.a))


@wp.func
def encloses(
    program: Program,
    pairadr: int,
    pairnum: int,
    lane: int,
    own_pos: wp.array[wp.vec3],
    own_quat: wp.array[wp.vec4],
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
) -> bool:
    """Test whether, in any pair of a list, one collider lies inside the other.

    All lanes of a block call it together, with the same poses as `collides`.
    """
    inside = int(0)
    for pair in range(pairadr + lane, pairadr + pairnum, wp.block_dim()):
        if is_one_inside(program, pair, pair_poses(program, pair, own_pos, own_quat, body_pos, body_quat)):
            inside = 1
            break
    return block_any(inside) != 0
