"""Containment: test whether one collider lies inside the other even if their surfaces do not intersect.

Each closed component of a collider has one test point. The winding number of the other collider's mesh around this
point decides whether the point is inside.
"""

import warp as wp

from sceniris_gym.collide.leaves import PairPoses, pair_poses
from sceniris_gym.device.blocks import block_any
from sceniris_gym.device.transforms import Pose, relative
from sceniris_gym.program.device import Program


@wp.func
def in_solid(program: Program, collider: int, p: wp.vec3) -> bool:
    """Test whether point `p` lies in the volume that the mesh of a collider encloses.

    `p` is in the frame of the collider's body.
    """
    mesh = program.collider_mesh[collider]
    query = wp.mesh_query_point_sign_winding_number(mesh, p, program.collider_depth[collider])
    return query.result and query.sign < 0.0


@wp.func
def in_bounds(program: Program, collider: int, p: wp.vec3) -> bool:
    """Test whether point `p` lies inside the bounding box of a collider. `p` is in the frame of the collider's body."""
    root = program.collider_root[collider]
    d = p - program.node_center[root]
    half = program.node_half[root]
    return wp.abs(d[0]) <= half[0] and wp.abs(d[1]) <= half[1] and wp.abs(d[2]) <= half[2]


@wp.func
def _has_points_inside(program: Program, a: int, b: int, rel: Pose) -> bool:
    """Test whether a closed component of collider a lies inside collider b. Each component has one test point.

    `rel` is the pose of b's body in the frame of a's body.
    """
    at = wp.transpose(rel.rot)
    for i in range(program.collider_pointnum[a]):
        p = at * (program.point[program.collider_pointadr[a] + i] - rel.pos)
        if in_bounds(program, b, p):
            if in_solid(program, b, p):
                return True
    return False


@wp.func
def is_one_inside(program: Program, pair: int, poses: PairPoses) -> bool:
    """Test whether one collider of a pair lies inside the other. If one of them is a plane, the result is False."""
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

    The list has `pairnum` pairs from index `pairadr`. All lanes of a block call this function together. `own_pos` and
    `own_quat` are the world poses of the tested bodies. All other bodies have the poses `body_pos` and `body_quat`.
    """
    inside = int(0)
    for pair in range(pairadr + lane, pairadr + pairnum, wp.block_dim()):
        if is_one_inside(program, pair, pair_poses(program, pair, own_pos, own_quat, body_pos, body_quat)):
            inside = 1
            break
    return block_any(inside) != 0
