"""Surfaces that do not meet may still enclose one another: points of each against the winding number of the other."""

import warp as wp

from sceniris_gym.layout.blocks import block_any
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.leaves import PairPoses, candidate_poses, pair_poses
from sceniris_gym.layout.search import Search, SearchSize, candidate_num
from sceniris_gym.layout.transforms import Pose, relative
from sceniris_gym.program.device import Cause, Program

wp.set_module_options({"enable_backward": False})

_NONE = wp.constant(int(Cause.NONE))
_COLLISION = wp.constant(int(Cause.COLLISION))


@wp.func
def _in_solid(program: Program, collider: int, p: wp.vec3) -> bool:
    """Is a point, in the frame of a collider's body, inside its solid?"""
    query = wp.mesh_query_point_sign_winding_number(
        program.collider_mesh[collider], p, program.collider_depth[collider]
    )
    return query.result and query.sign < 0.0


@wp.func
def _in_bounds(program: Program, collider: int, p: wp.vec3) -> bool:
    """Is it inside its box?"""
    root = program.collider_root[collider]
    d = p - program.node_center[root]
    half = program.node_half[root]
    return wp.abs(d[0]) <= half[0] and wp.abs(d[1]) <= half[1] and wp.abs(d[2]) <= half[2]


@wp.func
def _has_points_inside(program: Program, a: int, b: int, rel: Pose) -> bool:
    """Is a component of collider a inside the solid of b? `rel` is b in a's frame."""
    at = wp.transpose(rel.rot)
    for i in range(program.collider_pointnum[a]):
        p = at * (program.point[program.collider_pointadr[a] + i] - rel.pos)
        if _in_bounds(program, b, p):
            if _in_solid(program, b, p):
                return True
    return False


@wp.func
def _is_one_inside(program: Program, pair: int, poses: PairPoses) -> bool:
    """Is one collider of a pair inside the other?"""
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
    own_pos: wp.array(dtype=wp.vec3),
    own_quat: wp.array(dtype=wp.vec4),
    body_pos: wp.array(dtype=wp.vec3),
    body_quat: wp.array(dtype=wp.vec4),
) -> bool:
    """Is one collider of any pair of a list inside the other? All lanes of a block call it together; see `collides`."""
    inside = int(0)
    for pair in range(pairadr + lane, pairadr + pairnum, wp.block_dim()):
        if _is_one_inside(program, pair, pair_poses(program, pair, own_pos, own_quat, body_pos, body_quat)):
            inside = 1
            break
    return block_any(inside) != 0


@wp.func
def _queue_points(program: Program, search: Search, c: int, a: int, b: int, rel: Pose):
    """Queue the components of collider a that are in the box of b. `rel` is b in a's frame."""
    at = wp.transpose(rel.rot)
    for i in range(program.collider_pointnum[a]):
        p = at * (program.point[program.collider_pointadr[a] + i] - rel.pos)
        if _in_bounds(program, b, p):
            slot = wp.atomic_add(search.enclosed, 0, 1)
            if slot >= 0 and slot < search.enclosed_point.shape[0]:
                search.enclosed_candidate[slot] = c
                search.enclosed_by[slot] = b
                search.enclosed_point[slot] = p
            elif _in_solid(program, b, p):  # no room for it
                search.cause[c] = _COLLISION


@wp.kernel(module="unique", enable_backward=False, grid_stride=False)
def _queue_enclosed(
    program: Program,
    lanes: int,
    parts: int,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    for i in range(wp.tid(), parts * candidate_num(search), lanes):
        c = i // parts
        row = search.row[c]
        obj = search.obj[c]
        adr = program.obj_pairadr[obj]
        for pair in range(adr + i % parts, adr + program.obj_pairnum[obj], parts):
            a = program.pair_a[pair]
            b = program.pair_b[pair]
            if search.cause[c] == _NONE and program.collider_plane[b] < 0:
                poses = candidate_poses(program, layouts, search, c, row, pair)
                _queue_points(program, search, c, a, b, relative(poses.a, poses.b))
                _queue_points(program, search, c, b, a, relative(poses.b, poses.a))


@wp.kernel(module="unique", enable_backward=False, grid_stride=False)
def _test_enclosed(
    program: Program,
    lanes: int,
    # Search in and out:
    search: Search,
):
    for i in range(wp.tid(), wp.min(search.enclosed[0], search.enclosed_point.shape[0]), lanes):
        c = search.enclosed_candidate[i]
        if search.cause[c] == _NONE:
            if _in_solid(program, search.enclosed_by[i], search.enclosed_point[i]):
                search.cause[c] = _COLLISION  # other lanes write the same


LANE_KERNELS = (_queue_enclosed, _test_enclosed)
"""What is launched, by lanes."""


def launch_test_containment(
    program: Program, size: SearchSize, layouts: LayoutsView, search: Search, device: str
) -> None:
    """Test whether a candidate encloses, or is enclosed by, what stands; for `geometry: visual`."""
    inputs = [program, size.lanes, size.parts, layouts, search]
    wp.launch(_queue_enclosed, dim=size.lanes, inputs=inputs, device=device)
    wp.launch(_test_enclosed, dim=size.lanes, inputs=[program, size.lanes, search], device=device)
