"""Resolve the relations of each candidate in its world, and bound the region that they leave by half-planes.

One lane works on one relation of one candidate. Candidates whose region differs from world to world are listed. Where
candidates of a row have the same region, it is cut once, for the first of them: their *holder*.
"""

import warp as wp

from sceniris_gym.config.limits import MAX_ANCHORS, MAX_RELATIONS
from sceniris_gym.device.angles import angle_of
from sceniris_gym.device.transforms import Pose, pose_of
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.search import Search, Workspace, candidate_num
from sceniris_gym.placement.placed import placed
from sceniris_gym.placement.relations import depends_on_heading, resolve, side_num, write_sides
from sceniris_gym.program.device import Cause, Measure, ObjectKind, Program

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def support_pose(program: Program, layouts: LayoutsView, row: int, obj: int) -> Pose:
    """Return the pose of the body that supports an object, or the identity for an object without a support."""
    frame = pose_of(wp.vec3(0.0), wp.vec4(1.0, 0.0, 0.0, 0.0))
    ground = program.obj_ground[obj]
    if ground >= 0:
        frame = pose_of(layouts.body_pos[row, ground], layouts.body_quat[row, ground])
    return frame


@wp.func
def _resolve(program: Program, layouts: LayoutsView, search: Search, c: int, i: int, row: int, obj: int, frame: Pose):
    """Resolve relation `i` of a candidate's object in its row, and write the half-planes of its convex pieces."""
    rel = program.obj_reladr[obj] + i
    hull = wp.zeros(shape=(MAX_ANCHORS,), dtype=wp.vec2)
    resolved = resolve(
        program,
        search.row_world[row],
        rel,
        placed(wp.vec2(0.0), search.heading[c], search.turn[c].bounds),
        angle_of(frame.rot[0, 0], frame.rot[1, 0]),
        layouts.place[row],
        layouts.bounds[row],
        layouts.present[row],
        hull,
    )
    search.relations[c, i] = resolved
    search.side_num[c, i] = side_num(resolved)
    write_sides(program, rel, resolved, hull, search.sides[c], program.rel_sideadr[rel])


@wp.func
def _holder(program: Program, search: Search, c: int, row: int, obj: int) -> int:
    """Return the first candidate of the row of `c` that has the same region.

    Trials of the same stable pose have the same one, unless it depends on their drawn joints or headings.
    """
    if program.obj_measured[obj] == Measure.WHOLE:
        return c
    for rel in range(program.obj_reladr[obj], program.obj_reladr[obj] + program.obj_relnum[obj]):
        if depends_on_heading(program, rel):
            return c
    holder = search.row_first[row]
    while search.turn[holder].variant != search.turn[c].variant:
        holder += 1
    return holder


@wp.kernel(grid_stride=False)
def _build_sides(
    program: Program,
    lanes: int,
    # Layouts in: present, place, bounds, body_pos, body_quat
    layouts: LayoutsView,
    # Search in: row_world, row_first, candidates, cuts, regions, row, obj, cause, turn, heading
    # Search out: cuts, regions, cause, relations, sides, side_num, pieces, cut, region, holder
    search: Search,
):
    for k in range(wp.tid(), MAX_RELATIONS * candidate_num(search), lanes):
        c = k // MAX_RELATIONS
        i = k % MAX_RELATIONS
        obj = search.obj[c]
        if search.cause[c] == Cause.NONE and program.obj_kind[obj] != ObjectKind.STATIC and program.obj_cutnum[obj] > 0:
            if i >= wp.max(program.obj_relnum[obj], 1):
                continue
            row = search.row[c]
            frame = support_pose(program, layouts, row, obj)
            if frame.rot[2, 2] < program.obj_upright[obj]:
                search.cause[c] = Cause.EMPTY
                continue
            holder = _holder(program, search, c, row, obj)
            if i == 0:
                search.cut[wp.atomic_add(search.cuts, 0, 1)] = c
                search.holder[c] = holder
                if holder == c:
                    search.pieces[c] = 0
                    search.region[wp.atomic_add(search.regions, 0, 1)] = c
            if holder == c and program.obj_relnum[obj] > 0:
                _resolve(program, layouts, search, c, i, row, obj, frame)


def launch_build_sides(work: Workspace) -> None:
    """List the candidates of this wave whose region differs between worlds, and bound their regions by half-planes."""
    work.launch(_build_sides, work.size.lanes, [work.program, work.size.lanes, work.layouts], work.search)
