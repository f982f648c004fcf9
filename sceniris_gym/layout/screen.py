"""Candidates are posed and screened, the cheap tests first: the arm's map, roofs, and the footprint."""

import warp as wp

from sceniris_gym.layout.blocks import block_any, block_sync
from sceniris_gym.layout.grasps import first_on_map
from sceniris_gym.layout.kinematics import pose_bodies
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.orientations import facing
from sceniris_gym.layout.regions import is_under_roof, overhangs
from sceniris_gym.layout.search import Search, SearchSize, row_of
from sceniris_gym.layout.transforms import pose_of, quat_mat, quat_z
from sceniris_gym.program.device import Cause, ObjectKind, OrientationType, Program, Roof
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.reach.quaternions import mul_quat

wp.set_module_options({"enable_backward": False})

_STATIC = wp.constant(int(ObjectKind.STATIC))
_FACE_TO = wp.constant(int(OrientationType.FACE_TO))
_EITHER = wp.constant(int(Roof.EITHER))
_COVERED = wp.constant(int(Roof.COVERED))
_NONE = wp.constant(int(Cause.NONE))
_ROOF = wp.constant(int(Cause.ROOF))
_FOOTPRINT = wp.constant(int(Cause.FOOTPRINT))
_UNREACHABLE = wp.constant(int(Cause.UNREACHABLE))


@wp.func
def _pose(program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int):
    """Pose the object's bodies with its pivot over the candidate's point."""
    turn = search.turn[c]
    heading = search.heading[c]
    point = search.point[c]
    if program.obj_orientation[obj] == _FACE_TO:
        target = program.obj_target[obj]
        if layouts.present[row, target] != 0:
            at = layouts.place[row, target]
            heading = turn.yaw + facing(wp.vec2(point[0], point[1]), wp.vec2(at[0], at[1]))
    pivot = point
    if program.obj_ground[obj] >= 0:
        pivot = point + wp.vec3(0.0, 0.0, program.obj_gap[obj])
    root = program.obj_body[obj]
    quat = wp.normalize(mul_quat(quat_z(heading), turn.quat))
    search.body_pos[c, root] = pivot - quat_mat(quat) * turn.pivot
    search.body_quat[c, root] = quat
    pose_bodies(program, obj, 1, search.qpos[c], search.body_pos[c], search.body_quat[c])
    search.place[c] = wp.vec4(pivot[0], pivot[1], pivot[2], heading)
    search.bounds[c] = turn.bounds


@wp.func
def _has_its_roof(
    program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, lane: int
) -> bool:
    """Is the candidate's point covered or open, as the object is to be?"""
    rule = program.obj_roof[obj]
    if rule == _EITHER:
        return True
    covered = int(0)
    for i in range(lane, program.obj_roofnum[obj], wp.block_dim()):
        roof = program.roof_list[program.obj_roofadr[obj] + i]
        if is_under_roof(program, roof, search.point[c], layouts.body_pos[row], layouts.body_quat[row]):
            covered = 1
            break
    return (block_any(covered) != 0) == (rule == _COVERED)


@wp.func
def _is_within_reach(reach: Reach, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, lane: int) -> bool:
    """Whether the map lets a grasp of the posed object through, which is kept; true for what need not be reachable."""
    column = reach.obj_reach[obj]
    if column < 0:
        return True
    base = pose_of(layouts.body_pos[row, reach.base_body], layouts.body_quat[row, reach.base_body])
    variant = search.turn[c].variant
    grasp = first_on_map(reach, column, variant, lane, base, search.body_pos[c], search.body_quat[c])
    if lane == 0:
        search.grasp[c] = grasp
    return grasp >= 0


@wp.func
def _screen_one(
    program: Program, reach: Reach, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, lane: int
) -> int:
    """Why a posed candidate is rejected, or NONE; the same on all lanes of the block."""
    if program.obj_kind[obj] == _STATIC:
        return _NONE
    if reach.obj_reach.shape[0] > 0:
        if not _is_within_reach(reach, layouts, search, c, row, obj, lane):
            return _UNREACHABLE
    if not _has_its_roof(program, layouts, search, c, row, obj, lane):
        return _ROOF
    surface = search.surface[c]
    if program.obj_footprint[obj] != 0 and surface >= 0:
        ground = program.obj_ground[obj]
        frame = pose_of(layouts.body_pos[row, ground], layouts.body_quat[row, ground])
        if overhangs(program, obj, surface, lane, frame, search.body_pos[c], search.body_quat[c]):
            return _FOOTPRINT
    return _NONE


@wp.kernel(grid_stride=False)
def _pose_candidates(
    program: Program,
    lanes: int,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    for c in range(wp.tid(), search.candidates[0], lanes):
        row = row_of(search, c)
        obj = search.row_object[row]
        if search.cause[c] == _NONE and program.obj_kind[obj] != _STATIC:
            _pose(program, layouts, search, c, row, obj)


@wp.kernel(grid_stride=False, cuda_max_registers=128)
def _screen(
    program: Program,
    reach: Reach,
    blocks: int,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    block, lane = wp.tid()
    for c in range(block, search.candidates[0], blocks):
        cause = search.cause[c]
        block_sync()  # all lanes have read it
        if cause == _NONE:
            row = row_of(search, c)
            cause = _screen_one(program, reach, layouts, search, c, row, search.row_object[row], lane)
            if lane == 0:
                search.cause[c] = cause
                if cause == _NONE:
                    search.survivor[wp.atomic_add(search.screened, 0, 1)] = c


def launch_screen(
    program: Program, reach: Reach, size: SearchSize, layouts: LayoutsView, search: Search, device: str
) -> None:
    """Pose the candidates of this wave, and keep those that pass for the test of collision."""
    wp.launch(_pose_candidates, dim=size.lanes, inputs=[program, size.lanes, layouts, search], device=device)
    wp.launch_tiled(
        _screen,
        dim=[size.blocks],
        inputs=[program, reach, size.blocks, layouts, search],
        block_dim=size.block_dim,
        device=device,
    )
