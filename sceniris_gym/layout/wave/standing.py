"""Statics of a wave's candidates: each is to stand, and to leave everything below it standing."""

import warp as wp

from sceniris_gym.config.limits import MAX_LEVELS
from sceniris_gym.device.transforms import pose_of
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.collision import collides_alone
from sceniris_gym.layout.wave.search import Search, Workspace, candidate_num
from sceniris_gym.placement.standing import (
    MOST_CORNERS,
    Level,
    find_patch,
    lies_on_a_part,
    loads_stand,
    measure,
    softness_of,
    weigh,
)
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_statics import Statics

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def _around(total: wp.vec4) -> wp.vec4:
    """Return a weight and its centre from a weight and the sum of weights times places."""
    share = 1.0 / wp.max(total[0], 1.0e-30)
    return wp.vec4(total[0], total[1] * share, total[2] * share, total[3] * share)


@wp.func
def _moments(load: wp.vec4, by: wp.vec3) -> wp.vec4:
    """Return a weight, and the sum of weights times places around a point, from its centre and that point's offset."""
    return load[0] * wp.vec4(1.0, load[1] - by[0], load[2] - by[1], load[3] - by[2])


@wp.func
def _level_of(
    program: Program,
    statics: Statics,
    layouts: LayoutsView,
    search: Search,
    c: int,
    row: int,
    number: int,
    above: Level,
) -> Level:
    """Return level `number` of `Statics`, on which `above` stands, without what its patch says."""
    obj = statics.level_obj[number]
    worldid = search.row_world[row]
    level = Level()
    own = wp.vec4(0.0)
    if obj == search.obj[c]:
        place = search.place[c]
        level.pivot = wp.vec3(place[0], place[1], place[2] - program.obj_gap[obj])
        own = weigh(program, statics, obj, worldid, search.body_pos[c], search.body_quat[c], level.pivot)
    else:
        place = layouts.place[row, program.obj_slot[obj]]
        level.pivot = wp.vec3(place[0], place[1], place[2] - program.obj_gap[obj])
        own = weigh(program, statics, obj, worldid, layouts.body_pos[row], layouts.body_quat[row], level.pivot)
    for i in range(statics.level_loadnum[number]):
        other = statics.load[statics.level_loadadr[number] + i]
        if layouts.present[row, program.obj_slot[other]] != 0:
            own += weigh(program, statics, other, worldid, layouts.body_pos[row], layouts.body_quat[row], level.pivot)
    level.own = _around(own)
    level.load = _around(own + _moments(above.load, level.pivot - above.pivot))
    level.gap = program.obj_gap[obj]
    level.law = statics.obj_law[obj]
    level.soft = softness_of(program, statics, obj, worldid)
    return level


@wp.func
def _stands_alone(program: Program, statics: Statics, layouts: LayoutsView, search: Search, c: int, row: int) -> bool:
    """Return True if a candidate is carried by what cannot fall, and stands there with all of its foot."""
    obj = search.obj[c]
    variant = search.turn[c].variant
    if statics.obj_levelnum[obj] > 1 or not statics.variant_holds[variant]:
        return False
    place = search.place[c]
    body = program.obj_ground[obj]
    pivot = wp.vec3(place[0], place[1], place[2] - program.obj_gap[obj])
    ground = pose_of(layouts.body_pos[row, body] - pivot, layouts.body_quat[row, body])
    return lies_on_a_part(statics, variant, place[3], search.surface[c], ground)


@wp.func
def _stands(program: Program, statics: Statics, layouts: LayoutsView, search: Search, c: int, row: int) -> bool:
    """Return True if a candidate stands, and all levels below it with it."""
    levels = wp.zeros(shape=(wp.static(MAX_LEVELS),), dtype=Level)
    patch = wp.zeros(shape=(wp.static(MOST_CORNERS),), dtype=wp.vec2)
    adr = statics.obj_leveladr[search.obj[c]]
    num = statics.obj_levelnum[search.obj[c]]
    above = Level()
    for j in range(num):
        obj = statics.level_obj[adr + j]
        surface = search.surface[c]
        variant = search.turn[c].variant
        heading = search.place[c][3]
        if j > 0:
            surface = search.row_surface[row, obj]
            variant = search.row_variant[row, obj]
            heading = layouts.place[row, program.obj_slot[obj]][3]
        above = _level_of(program, statics, layouts, search, c, row, adr + j, above)
        body = program.obj_ground[obj]
        ground = pose_of(layouts.body_pos[row, body] - above.pivot, layouts.body_quat[row, body])
        corners = find_patch(statics, obj, variant, heading, surface, ground, patch)
        if corners == 0:
            return False
        above = measure(statics, above, obj, variant, patch, corners)
        if above.margin <= 0.0:
            return False
        levels[j] = above
    return loads_stand(levels, num)


@wp.func
def _falls(program: Program, statics: Statics, layouts: LayoutsView, search: Search, c: int) -> bool:
    """Return True if a candidate would fall, or make what it is put on fall."""
    if statics.obj_levelnum[search.obj[c]] == 0:
        return False
    if _stands_alone(program, statics, layouts, search, c, search.row[c]):
        return False
    return not _stands(program, statics, layouts, search, c, search.row[c])


@wp.kernel(grid_stride=False)
def _test_standing(
    program: Program,
    statics: Statics,
    lanes: int,
    # Layouts in: present, place, body_pos, body_quat
    layouts: LayoutsView,
    # Search in: row_world, row_surface, row_variant, candidates, any_overflowed, row, obj, cause, turn, surface, place,
    #   overflowed, body_pos, body_quat
    # Search out: cause
    search: Search,
):
    # Most waves have nothing to test for either reason, so two launches would cost more than the tests do.
    for c in range(wp.tid(), candidate_num(search), lanes):
        if search.any_overflowed[0] != 0:
            if search.cause[c] == Cause.NONE and search.overflowed[c] != 0:
                if collides_alone(program, layouts, search, c):
                    search.cause[c] = Cause.COLLISION
        if search.cause[c] == Cause.NONE:
            if _falls(program, statics, layouts, search, c):
                search.cause[c] = Cause.FALLS


def launch_test_standing(work: Workspace) -> None:
    """Reject candidates that would fall, or make what they are put on fall; repeat collision tests that overflowed."""
    lanes = work.size.lanes
    work.launch(_test_standing, lanes, [work.program, work.statics, lanes, work.layouts, work.search])
