"""Evaluate the relations of each candidate in its world, and bound the resulting region by half-planes.

One lane works on one relation of one candidate. Candidates whose region differs between worlds are listed. If several
candidates of a row have the same region, it is cut into pieces once, for the first of these candidates: their *holder*.
"""

import warp as wp

from sceniris_gym.config.bounds import MAX_ANCHORS, MAX_RELATIONS
from sceniris_gym.device.transforms import Pose, angle_of, pose_of
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.search import Search, Workspace, candidate_num
from sceniris_gym.placement.placed import placed
from sceniris_gym.placement.polygons import HalfPlane
from sceniris_gym.placement.relations import ResolvedRelation, depends_on_heading, resolve, side_num, write_sides
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Cause, Measure, ObjectKind, Program, allocate

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Regions:
    """The regions of a wave's candidates. Used only in scenes whose regions differ between worlds."""

    # Counts
    cuts: wp.array[int]  # number of candidates in `cut`
    regions: wp.array[int]  # number of candidates in `region`
    # Candidates
    relations: wp.array2d[ResolvedRelation]
    sides: wp.array2d[HalfPlane]  # half-planes that bound the pieces of the relations
    side_num: wp.array2d[int]  # number of half-planes per piece of a relation, or INACTIVE
    pieces: wp.array[int]  # number of pieces of the region that may have positive area
    piece: wp.array2d[int]  # numbers of these pieces
    piece_area: wp.array2d[float]  # [m^2]
    cut: wp.array[int]  # candidates whose region differs between worlds
    region: wp.array[int]  # holders, one candidate for each region of a row
    holder: wp.array[int]  # the holder of the candidate's region


def create_regions(compiled: CompiledScene, ncand: int) -> Regions:
    """Allocate regions of `ncand` candidates. They have no arrays if regions are the same in every world."""
    if not compiled.related:
        return Regions()  # pyrefly: ignore[missing-argument]
    shapes = {
        "cuts regions": 1,
        "relations side_num": (ncand, MAX_RELATIONS),
        "sides": (ncand, compiled.sides),
        "piece piece_area": (ncand, compiled.pieces),
        "pieces cut region holder": ncand,
    }
    return allocate(Regions, Regions(), shapes, compiled.device)  # pyrefly: ignore[missing-argument]


@wp.func
def support_pose(program: Program, layouts: LayoutsView, row: int, obj: int) -> Pose:
    """Return the pose of the body that supports an object, or the identity for an object without a support."""
    frame = pose_of(wp.vec3(0.0), wp.vec4(1.0, 0.0, 0.0, 0.0))
    ground = program.obj_ground[obj]
    if ground >= 0:
        frame = pose_of(layouts.body_pos[row, ground], layouts.body_quat[row, ground])
    return frame


@wp.func
def _resolve(program: Program, layouts: LayoutsView, search: Search, regions: Regions, c: int, i: int, frame: Pose):
    """Evaluate relation `i` of a candidate, and write the half-planes that bound the areas that the relation allows.

    `frame` is the pose of the body that supports the candidate's object.
    """
    row = search.row[c]
    worldid = search.row_world[row]
    rel = program.obj_reladr[search.obj[c]] + i
    own = placed(wp.vec2(0.0), search.heading[c], search.stable_draw[c].bounds)
    heading = angle_of(frame.rot[0, 0], frame.rot[1, 0])
    pivots, bounds, present = layouts.pivot_pose[row], layouts.bounds[row], layouts.present[row]
    hull = wp.zeros(shape=(MAX_ANCHORS,), dtype=wp.vec2)
    resolved = resolve(program, worldid, rel, own, heading, pivots, bounds, present, hull)
    regions.relations[c, i] = resolved
    regions.side_num[c, i] = side_num(resolved)
    write_sides(program, rel, resolved, hull, regions.sides[c], program.rel_sideadr[rel])


@wp.func
def _holder(program: Program, search: Search, c: int, row: int, obj: int) -> int:
    """Return the first candidate in the row of `c` that has the same region as `c`.

    Trials with the same stable pose have the same region, unless the region depends on the drawn joints or heading.
    """
    if program.obj_measured[obj] == Measure.WHOLE:
        return c
    for rel in range(program.obj_reladr[obj], program.obj_reladr[obj] + program.obj_relnum[obj]):
        if depends_on_heading(program, rel):
            return c
    holder = search.row_first[row]
    while search.stable_draw[holder].stable != search.stable_draw[c].stable:
        holder += 1
    return holder


@wp.kernel(grid_stride=False)
def _build_sides(
    lanes: int,
    program: Program,
    # Layouts in: present, pivots*, bodies*
    layouts: LayoutsView,
    # Search in: row_world, row_first, candidates, row, obj, stable_draw, heading; both: cause
    search: Search,
    # Regions out: relations, sides, side_num, pieces, cut, region, holder; both: counts*
    regions: Regions,
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
                regions.cut[wp.atomic_add(regions.cuts, 0, 1)] = c
                regions.holder[c] = holder
                if holder == c:
                    regions.pieces[c] = 0
                    regions.region[wp.atomic_add(regions.regions, 0, 1)] = c
            if holder == c and program.obj_relnum[obj] > 0:
                _resolve(program, layouts, search, regions, c, i, frame)


def launch_build_sides(work: Workspace, regions: Regions) -> None:
    """List the candidates of this wave whose region differs between worlds, and bound their regions by half-planes."""
    work.launch_lanes(_build_sides, work.program, work.layouts, work.search, regions)
