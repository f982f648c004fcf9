"""Prefilter of posed candidates, the cheap tests first: the arm's map, overhead obstacles and the footprint."""

from collections.abc import Sequence

import warp as wp

from sceniris_gym.device.transforms import pose_of
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.search import NO_GRASP, Search, SearchSize, candidate_num
from sceniris_gym.placement.cover import is_covered
from sceniris_gym.placement.footprint import overhangs
from sceniris_gym.placement.grasps import approaches, first_through, passes_map
from sceniris_gym.program.device import Cause, Cover, ObjectKind, Program
from sceniris_gym.program.device_reach import UNASKED, Reach

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def _look_up(reach: Reach, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, part: int, parts: int):
    """Find the first of a candidate's grasps that the map lets through, if the base is where it will be."""
    column = reach.obj_reach[obj]
    late = reach.reach_late[column]
    base = pose_of(layouts.body_pos[row, reach.base_body], layouts.body_quat[row, reach.base_body])
    variant = search.turn[c].variant
    adr = reach.variant_graspadr[variant]
    for grasp in range(adr + part, adr + reach.variant_graspnum[variant], parts):
        if search.grasp[c] > grasp - reach.reach_graspadr[column]:
            through = bool(False)
            if late != 0:
                through = approaches(reach, column, grasp, search.body_quat[c])
            else:
                through = passes_map(reach, column, grasp, base, search.body_pos[c], search.body_quat[c])
            if through:
                wp.atomic_min(search.grasp, c, grasp - reach.reach_graspadr[column])


@wp.func
def _look_up_from_base(reach: Reach, layouts: LayoutsView, search: Search, c: int, row: int):
    """Find whether the map lets a grasp through of each target that was placed before a candidate base."""
    base = pose_of(search.body_pos[c, reach.base_body], search.body_quat[c, reach.base_body])
    for column in range(reach.reach_arm.shape[0]):
        if reach.reach_arm[column] == reach.number and reach.reach_late[column] != 0:
            if layouts.present[row, reach.reach_slot[column]] != 0:
                variant = layouts.variant[row, column]
                if first_through(reach, column, variant, base, layouts.body_pos[row], layouts.body_quat[row]) < 0:
                    return
    search.grasp[c] = 0


@wp.func
def _look_at_map(reach: Reach, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, part: int, parts: int):
    """Look up what the arm is to reach; for a base one lane does it."""
    column = reach.obj_reach[obj]
    if column >= 0:
        if reach.reach_arm[column] == reach.number:
            _look_up(reach, layouts, search, c, row, obj, part, parts)
    elif obj == reach.base_obj and part == 0:
        _look_up_from_base(reach, layouts, search, c, row)


@wp.func
def _look_overhead(
    program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, part: int, parts: int
):
    """Find whether anything is above the candidate's point."""
    for i in range(part, program.obj_overheadnum[obj], parts):
        entry = program.overhead_list[program.obj_overheadadr[obj] + i]
        if search.covered[c] == 0:
            if is_covered(program, entry, search.point[c], layouts.body_pos[row], layouts.body_quat[row]):
                search.covered[c] = 1


@wp.func
def _look_at_footprint(
    program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, part: int, parts: int
):
    """Find whether any of the posed object's footprint lies off its support."""
    surface = search.surface[c]
    ground = program.obj_ground[obj]
    frame = pose_of(layouts.body_pos[row, ground], layouts.body_quat[row, ground])
    for i in range(part, program.obj_shadownum[obj] * program.surface_edgenum[surface], parts):
        if search.off[c] == 0:
            if overhangs(program, obj, surface, i, frame, search.body_pos[c], search.body_quat[c]):
                search.off[c] = 1


# Registers for fewer warps at a time make it slower.
@wp.kernel(grid_stride=False, cuda_max_registers=128)
def _look(
    program: Program,
    reach: Reach,
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
        if search.cause[c] == Cause.NONE and program.obj_kind[obj] != ObjectKind.STATIC:
            if reach.obj_reach.shape[0] > 0:
                if reach.obj_reach[obj] != UNASKED:
                    _look_at_map(reach, layouts, search, c, row, obj, i % parts, parts)
                    if parts == 1 and search.grasp[c] == NO_GRASP:
                        continue
            if program.obj_cover[obj] != Cover.EITHER:
                _look_overhead(program, layouts, search, c, row, obj, i % parts, parts)
                if parts == 1 and (search.covered[c] != 0) != (program.obj_cover[obj] == Cover.COVERED):
                    continue
            if program.obj_footprint[obj] != 0 and search.surface[c] >= 0:
                _look_at_footprint(program, layouts, search, c, row, obj, i % parts, parts)


@wp.kernel(grid_stride=False)
def _look_at_map_of(
    reach: Reach,
    lanes: int,
    parts: int,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    for i in range(wp.tid(), parts * candidate_num(search), lanes):
        c = i // parts
        obj = search.obj[c]
        if search.cause[c] == Cause.NONE and reach.obj_reach[obj] != UNASKED:
            _look_at_map(reach, layouts, search, c, search.row[c], obj, i % parts, parts)


@wp.func
def reject_cause(program: Program, reach: Reach, search: Search, c: int, obj: int) -> int:
    """Return the cause that the prefilter rejects a candidate for, or NONE."""
    if program.obj_kind[obj] == ObjectKind.STATIC:
        return Cause.NONE
    if reach.obj_reach.shape[0] > 0:
        if reach.obj_reach[obj] != UNASKED and search.grasp[c] == NO_GRASP:
            return Cause.UNREACHABLE
    rule = program.obj_cover[obj]
    if rule != Cover.EITHER:
        if (search.covered[c] != 0) != (rule == Cover.COVERED):
            return Cause.OVERHEAD
    if search.off[c] != 0:
        return Cause.FOOTPRINT
    return Cause.NONE


def launch_prefilter(
    program: Program, reaches: Sequence[Reach], size: SearchSize, layouts: LayoutsView, search: Search, device: str
) -> None:
    """Prefilter the candidates of this wave by maps, overhead obstacles and footprints, for `reject_cause`."""
    sizes = [size.lanes, size.parts, layouts, search]
    for reach in reaches[1:]:
        wp.launch(_look_at_map_of, dim=size.lanes, inputs=[reach, *sizes], device=device)
    wp.launch(_look, dim=size.lanes, inputs=[program, reaches[0], *sizes], device=device)
