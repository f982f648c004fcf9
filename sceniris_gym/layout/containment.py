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
def _has_points_inside(program: Program, a: int, b: int, rel: Pose) -> bool:
    """Is a component of collider a inside the solid of b? `rel` is b in a's frame."""
    root = program.collider_root[b]
    at = wp.transpose(rel.rot)
    for i in range(program.collider_pointnum[a]):
        p = at * (program.point[program.collider_pointadr[a] + i] - rel.pos)
        d = p - program.node_center[root]
        half = program.node_half[root]
        if wp.abs(d[0]) <= half[0] and wp.abs(d[1]) <= half[1] and wp.abs(d[2]) <= half[2]:
            query = wp.mesh_query_point_sign_winding_number(program.collider_mesh[b], p, program.collider_depth[b])
            if query.result and query.sign < 0.0:
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


@wp.kernel(grid_stride=False)
def _test_containment(
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
        tests = search.obj[c]
        adr = program.obj_pairadr[tests]
        for pair in range(adr + i % parts, adr + program.obj_pairnum[tests], parts):
            if search.cause[c] == _NONE:
                if _is_one_inside(program, pair, candidate_poses(program, layouts, search, c, row, pair)):
                    search.cause[c] = _COLLISION  # other lanes write the same


def launch_test_containment(
    program: Program, size: SearchSize, layouts: LayoutsView, search: Search, device: str
) -> None:
    """Test whether a candidate encloses, or is enclosed by, what stands; for `geometry: visual`."""
    inputs = [program, size.lanes, size.parts, layouts, search]
    wp.launch(_test_containment, dim=size.lanes, inputs=inputs, device=device)
