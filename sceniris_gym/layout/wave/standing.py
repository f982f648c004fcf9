"""Statics of a wave's candidates: test whether each candidate stands, and whether all objects below still stand."""

import warp as wp

from sceniris_gym.config.bounds import MAX_LEVELS
from sceniris_gym.device.transforms import pose_of
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.prefilter import reject_cause
from sceniris_gym.layout.wave.search import Search, Workspace, candidate_num
from sceniris_gym.placement.placed import rotated
from sceniris_gym.placement.standing import Level, find_patch, lies_on_a_part, loads_stand, measure, weigh
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.program.device_statics import Statics

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def _centered(total: wp.vec4) -> wp.vec4:
    """Divide a sum of weights times positions by the total weight. The components are (weight, x, y, z)."""
    share = 1.0 / wp.max(total[0], 1.0e-30)
    return wp.vec4(total[0], total[1] * share, total[2] * share, total[3] * share)


@wp.func
def _stands_alone(program: Program, statics: Statics, layouts: LayoutsView, search: Search, c: int, row: int) -> bool:
    """Return True if a candidate's support cannot fall, and the candidate stands on it with its whole foot."""
    obj = search.obj[c]
    if statics.obj_levelnum[obj] > 1:
        return False
    pivot_pose = search.pivot_pose[c]
    body = program.obj_ground[obj]
    ground = pose_of(layouts.body_pos[row, body], layouts.body_quat[row, body])
    at = wp.vec2(pivot_pose[0], pivot_pose[1])
    return lies_on_a_part(statics, search.stable_draw[c].stable, at, search.surface[c], ground)


@wp.func
def _stands(program: Program, statics: Statics, layouts: LayoutsView, search: Search, c: int, row: int) -> bool:
    """Return True if a candidate stands, and all objects of the stack below it still stand when they carry it."""
    levels = wp.zeros(shape=(wp.static(MAX_LEVELS),), dtype=Level)
    adr = statics.obj_leveladr[search.obj[c]]
    num = statics.obj_levelnum[search.obj[c]]
    worldid = search.row_world[row]
    origin = wp.vec3(search.pivot_pose[c][0], search.pivot_pose[c][1], search.pivot_pose[c][2])
    total = wp.vec4(0.0)
    for j in range(num):
        number = adr + j
        obj = statics.level_obj[number]
        surface = search.surface[c]
        stable = search.stable_draw[c].stable
        pivot_pose = search.pivot_pose[c]
        own = wp.vec4(0.0)
        if j == 0:
            own = weigh(program, statics, obj, worldid, search.body_pos[c], search.body_quat[c], origin)
        else:
            surface = search.row_surface[row, obj]
            if surface < 0:  # this object is held, so it carries all objects above
                return loads_stand(levels, j)
            stable = search.row_stable[row, obj]
            pivot_pose = layouts.pivot_pose[row, program.obj_column[obj]]
            own = weigh(program, statics, obj, worldid, layouts.body_pos[row], layouts.body_quat[row], origin)
        for i in range(statics.level_loadnum[number]):
            other = statics.load[statics.level_loadadr[number] + i]
            if layouts.present[row, program.obj_slot[other]] != 0:
                own += weigh(program, statics, other, worldid, layouts.body_pos[row], layouts.body_quat[row], origin)
        total += own
        level = Level()  # pyrefly: ignore[missing-argument]
        level.own = _centered(own)
        level.load = _centered(total)
        level.sink = statics.level_sink[number] + statics.obj_give[obj] * level.load[0]
        level.gap = program.obj_gap[obj] - statics.obj_touch[obj]
        level.foot = pivot_pose[2] - program.obj_gap[obj] - origin[2]
        level.law = statics.stable_law[stable]
        body = program.obj_ground[obj]
        ground = pose_of(layouts.body_pos[row, body] - origin, layouts.body_quat[row, body])
        at = wp.vec2(pivot_pose[0] - origin[0], pivot_pose[1] - origin[1])
        level.reach = statics.stable_reach[stable]
        if level.reach[0] > 0.0:
            level.axis = rotated(statics.stable_axis[stable], pivot_pose[3])
            level.center = at + rotated(statics.stable_center[stable], pivot_pose[3])
        patch, is_on = find_patch(statics, stable, at, pivot_pose[3], surface, ground)
        if not is_on:
            return False
        level = measure(level, patch)
        level.margin -= statics.obj_tilt[obj] * (level.load[3] - level.foot)
        if level.margin <= 0.0:
            return False
        levels[j] = level
    return loads_stand(levels, num)


@wp.kernel(grid_stride=False)
def _test_standing(
    lanes: int,
    program: Program,
    reach: Reach,
    statics: Statics,
    # Layouts in: present, pivot_pose, bodies*
    layouts: LayoutsView,
    # Search in: row_world, placed*, candidates, row, obj, stable_draw, surface, grasp, pivot_pose, flags*, body_pos,
    #   body_quat; both: cause
    search: Search,
):
    for c in range(wp.tid(), candidate_num(search), lanes):
        obj = search.obj[c]
        if statics.obj_levelnum[obj] == 0 or search.cause[c] != Cause.NONE:
            continue
        # the collision test may not have written the prefilter's verdict yet
        if reject_cause(program, reach, search, c, obj) == Cause.NONE:
            row = search.row[c]
            if not _stands_alone(program, statics, layouts, search, c, row):
                if not _stands(program, statics, layouts, search, c, row):
                    wp.atomic_cas(search.cause, c, int(Cause.NONE), int(Cause.FALLS))


def launch_test_standing(work: Workspace) -> None:
    """Reject candidates that would fall or would topple the objects below, unless another test rejects them."""
    reach = work.reaches[0]
    work.launch_lanes(_test_standing, work.program, reach, work.statics, work.layouts, work.search)
