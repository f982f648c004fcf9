"""Prefilter of posed candidates by cheap tests: the arm's map, overhead obstacles, and the footprint."""

import warp as wp

from sceniris_gym.device.transforms import pose_of
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.search import NO_GRASP, Search, Workspace, candidate_num, lanes_for_each
from sceniris_gym.placement.footprint import is_covered, overhangs
from sceniris_gym.placement.grasps import approaches, first_accepted, passes_map
from sceniris_gym.program.device import Cause, Cover, ObjectKind, Program
from sceniris_gym.program.device_reach import UNASKED, Reach

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def _find_grasp(reach: Reach, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, part: int, parts: int):
    """Find the first grasp of a candidate that the map accepts.

    If the arm's base is placed later, test only the direction of approach. The grasps are divided among `parts` lanes.
    This is lane number `part`.
    """
    column = reach.obj_reach[obj]
    late = reach.reach_late[column]
    base = pose_of(layouts.body_pos[row, reach.base_body], layouts.body_quat[row, reach.base_body])
    stable = search.stable_draw[c].stable
    adr = reach.stable_graspadr[stable]
    for grasp in range(adr + part, adr + reach.stable_graspnum[stable], parts):
        # other lanes may have found a lower one already
        if search.grasp[c] > grasp - reach.reach_graspadr[column]:
            through = bool(False)
            if late != 0:
                through = approaches(reach, column, grasp, search.body_quat[c])
            else:
                through = passes_map(reach, column, grasp, base, search.body_pos[c], search.body_quat[c])
            if through:
                wp.atomic_min(search.grasp, c, grasp - reach.reach_graspadr[column])


@wp.func
def _find_grasps_from_base(reach: Reach, layouts: LayoutsView, search: Search, c: int, row: int):
    """Accept a candidate of a robot base if the map accepts a grasp of every target placed before the base."""
    base = pose_of(search.body_pos[c, reach.base_body], search.body_quat[c, reach.base_body])
    for column in range(reach.reach_arm.shape[0]):
        if reach.reach_arm[column] == reach.number and reach.reach_late[column] != 0:
            if layouts.present[row, reach.reach_slot[column]] != 0:
                stable = layouts.stable[row, column]
                if first_accepted(reach, column, stable, base, layouts.body_pos[row], layouts.body_quat[row]) < 0:
                    return
    search.grasp[c] = 0


@wp.func
def _test_map(reach: Reach, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, part: int, parts: int):
    """Test the grasps of a reach target, or all grasps that a base has to reach.

    A target's grasps are divided among `parts` lanes, and this is lane number `part`. Only lane 0 tests a base.
    """
    column = reach.obj_reach[obj]
    if column >= 0:
        if reach.reach_arm[column] == reach.number:
            _find_grasp(reach, layouts, search, c, row, obj, part, parts)
    elif obj == reach.base_obj and part == 0:
        _find_grasps_from_base(reach, layouts, search, c, row)


@wp.func
def _test_cover(
    program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, part: int, parts: int
):
    """Mark a candidate as covered if an obstacle is above its point.

    The obstacles are divided among `parts` lanes. This is lane number `part`.
    """
    for i in range(part, program.obj_overheadnum[obj], parts):
        entry = program.overhead_list[program.obj_overheadadr[obj] + i]
        if search.covered[c] == 0:
            if is_covered(program, entry, search.point[c], layouts.body_pos[row], layouts.body_quat[row]):
                search.covered[c] = 1


@wp.func
def _test_footprint(
    program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, part: int, parts: int
):
    """Mark a candidate as overhanging if part of its footprint lies off its support.

    The pairs of a piece and an edge are divided among `parts` lanes. This is lane number `part`.
    """
    surface = search.surface[c]
    ground = program.obj_ground[obj]
    frame = pose_of(layouts.body_pos[row, ground], layouts.body_quat[row, ground])
    for i in range(part, program.obj_shadownum[obj] * program.surface_edgenum[surface], parts):
        if search.overhanging[c] == 0:
            if overhangs(program, obj, surface, i, frame, search.body_pos[c], search.body_quat[c]):
                search.overhanging[c] = 1


@wp.func
def reject_cause(program: Program, reach: Reach, search: Search, c: int, obj: int) -> int:
    """Return the cause for which the prefilter rejects a candidate, or NONE if it passes."""
    if program.obj_kind[obj] == ObjectKind.STATIC:
        return Cause.NONE
    if reach.obj_reach.shape[0] > 0:
        if reach.obj_reach[obj] != UNASKED and search.grasp[c] == NO_GRASP:
            return Cause.UNREACHABLE
    rule = program.obj_cover[obj]
    if rule != Cover.EITHER:
        if (search.covered[c] != 0) != (rule == Cover.COVERED):
            return Cause.OVERHEAD
    if search.overhanging[c] != 0:
        return Cause.FOOTPRINT
    return Cause.NONE


# With more registers per lane, fewer warps fit on a multiprocessor, which is slower (measured).
@wp.kernel(grid_stride=False, cuda_max_registers=128)
def _prefilter(
    lanes: int,
    program: Program,
    reach: Reach,
    least_parts: int,
    # Layouts in: present, stable, bodies*
    layouts: LayoutsView,
    # Search in: candidates, row, obj, cause, stable_draw, point, surface, body_pos, body_quat; out: opened, cutting;
    #   both: grasp, flags*
    search: Search,
):
    if wp.tid() == 0:
        search.opened[0] = 0  # all opened candidates are drawn by now
        search.cutting[0] = 0
    num = candidate_num(search)
    parts = lanes_for_each(lanes, num, least_parts)
    for i in range(wp.tid(), parts * num, lanes):
        c = i // parts
        row = search.row[c]
        obj = search.obj[c]
        if search.cause[c] == Cause.NONE and program.obj_kind[obj] != ObjectKind.STATIC:
            if reach.obj_reach.shape[0] > 0:
                if reach.obj_reach[obj] != UNASKED:
                    _test_map(reach, layouts, search, c, row, obj, i % parts, parts)
                    if parts == 1 and search.grasp[c] == NO_GRASP:
                        continue
            if reach.number > 0:  # the launch for the first arm makes the other tests
                continue
            if program.obj_cover[obj] != Cover.EITHER:
                _test_cover(program, layouts, search, c, row, obj, i % parts, parts)
                if parts == 1 and (search.covered[c] != 0) != (program.obj_cover[obj] == Cover.COVERED):
                    continue
            if program.obj_footprint[obj] != 0 and search.surface[c] >= 0:
                _test_footprint(program, layouts, search, c, row, obj, i % parts, parts)


def launch_prefilter(work: Workspace) -> None:
    """Prefilter the candidates of this wave. `reject_cause` reads the result."""
    for reach in reversed(work.reaches):
        work.launch_lanes(_prefilter, work.program, reach, work.size.parts, work.layouts, work.search)
