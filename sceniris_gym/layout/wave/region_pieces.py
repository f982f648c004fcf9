"""Clip the support's triangles to the areas that the relations allow, and measure the pieces.

Each relation allows one or several convex areas. A *combination* takes one of these areas from every relation. A piece
is the part of a triangle inside a combination, and its number is combination * triangles + triangle. Several lanes
share the pieces of a region. The fewer regions there are, the more lanes share one.
"""

import warp as wp

from sceniris_gym.config.bounds import MAX_CORNERS
from sceniris_gym.device.transforms import Pose, apply
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.search import Search, Workspace, lanes_for_each
from sceniris_gym.layout.wave.sides import Regions, support_pose
from sceniris_gym.placement.polygons import HalfPlane, area, clip, set_triangle
from sceniris_gym.placement.relations import INACTIVE
from sceniris_gym.program.device import Program

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# A triangle outside of a half-plane by more than this [m] is dropped, and a triangle inside by more is not clipped. The
# value is ten times the rounding error within a few metres. At 100 m, the rounding error is 0.03 mm, and cuts move by
# at most 0.03 mm.
_SURE = wp.constant(1.0e-5)


@wp.struct
class Triangle:
    """A triangle of a region in the world frame, projected onto the ground plane [m]."""

    a: wp.vec2
    b: wp.vec2
    c: wp.vec2


@wp.func
def is_point(program: Program, tri: int) -> bool:
    """Return True if a triangle of the region represents a single point by three equal corners."""
    a = program.tri_a[tri]
    return program.tri_b[tri] == a and program.tri_c[tri] == a


@wp.func
def _xy(frame: Pose, p: wp.vec2, height: float) -> wp.vec2:
    w = apply(frame, wp.vec3(p[0], p[1], height))
    return wp.vec2(w[0], w[1])


@wp.func
def posed_triangle(program: Program, tri: int, frame: Pose) -> Triangle:
    """Return triangle `tri` of a support with pose `frame`."""
    height = program.surface_height[program.tri_surface[tri]]
    a = _xy(frame, program.tri_a[tri], height)
    b = _xy(frame, program.tri_b[tri], height)
    return Triangle(a, b, _xy(frame, program.tri_c[tri], height))


@wp.func
def _is_out_of_reach(program: Program, regions: Regions, c: int, obj: int, t: Triangle) -> bool:
    """Return True if a triangle's bounding box lies outside the circle that encloses the areas of one relation."""
    low = wp.min(wp.min(t.a, t.b), t.c)
    high = wp.max(wp.max(t.a, t.b), t.c)
    for i in range(program.obj_relnum[obj]):
        resolved = regions.relations[c, i]
        if resolved.active:
            off = wp.max(wp.max(low - resolved.apex, resolved.apex - high), wp.vec2(0.0))
            if wp.length(off) > resolved.reach:
                return True
    return False


@wp.func
def _depth(h: HalfPlane, t: Triangle) -> wp.vec2:
    """Return the least and the greatest signed distance of a triangle's corners from a half-plane, positive outside.

    Both distances are multiplied by the length of the normal.
    """
    limit = h.offset + wp.dot(h.normal, h.origin)
    a = wp.dot(h.normal, t.a)
    b = wp.dot(h.normal, t.b)
    c = wp.dot(h.normal, t.c)
    return wp.vec2(wp.min(wp.min(a, b), c) - limit, wp.max(wp.max(a, b), c) - limit)


@wp.func
def _is_surely_empty(program: Program, regions: Regions, c: int, obj: int, combination: int, t: Triangle) -> bool:
    """Return True if a triangle lies outside a half-plane of a combination. This cheap test drops most pieces.

    `combination` is the number of a combination, which takes one convex area from each relation.
    """
    rest = int(combination)
    for i in range(program.obj_relnum[obj]):
        rel = program.obj_reladr[obj] + i
        piece = rest % program.rel_piecenum[rel]
        rest = rest // program.rel_piecenum[rel]
        sides = regions.side_num[c, i]
        # an inactive relation has one piece, the whole plane
        if sides == INACTIVE and piece > 0:
            return True
        adr = program.rel_sideadr[rel] + piece * sides
        for k in range(adr, adr + sides):
            if _depth(regions.sides[c, k], t)[0] > _SURE:
                return True
    return False


@wp.func
def cut_triangle(
    program: Program, regions: Regions, c: int, obj: int, combination: int, t: Triangle, polygon: wp.array[wp.vec2]
) -> int:
    """Clip a triangle to a combination. Write the result to `polygon`, and return its number of corners."""
    num = set_triangle(polygon, t.a, t.b, t.c)
    rest = int(combination)
    for i in range(program.obj_relnum[obj]):
        rel = program.obj_reladr[obj] + i
        piece = rest % program.rel_piecenum[rel]
        rest = rest // program.rel_piecenum[rel]
        sides = regions.side_num[c, i]
        adr = program.rel_sideadr[rel] + piece * sides
        for k in range(adr, adr + sides):
            plane = regions.sides[c, k]
            # a zero normal represents the whole plane
            if num > 0 and (plane.normal[0] != 0.0 or plane.normal[1] != 0.0):
                if _depth(plane, t)[1] > -_SURE:
                    num = clip(polygon, num, plane)
    return num


@wp.kernel(grid_stride=False)
def _find_pieces(
    lanes: int,
    program: Program,
    least_parts: int,
    # Layouts in: bodies*
    layouts: LayoutsView,
    # Search in: row, obj, stable_draw
    search: Search,
    # Regions in: regions, relations, sides, side_num, region; out: piece; both: pieces
    regions: Regions,
):
    num = regions.regions[0]
    parts = lanes_for_each(lanes, num, least_parts)
    for i in range(wp.tid(), parts * num, lanes):
        c = regions.region[i // parts]
        obj = search.obj[c]
        frame = support_pose(program, layouts, search.row[c], obj)
        stable = search.stable_draw[c].stable
        triangles = program.stable_trinum[stable]
        for tri in range(i % parts, triangles, parts):
            t = posed_triangle(program, program.stable_triadr[stable] + tri, frame)
            if _is_out_of_reach(program, regions, c, obj, t):
                continue
            single = is_point(program, program.stable_triadr[stable] + tri)
            for combination in range(program.obj_cutnum[obj]):
                if not _is_surely_empty(program, regions, c, obj, combination, t):
                    regions.piece[c, wp.atomic_add(regions.pieces, c, 1)] = combination * triangles + tri
                    if single:  # a point on the border of two combinations counts once
                        break


# A separate kernel, so that the pieces found above are spread evenly over its lanes.
@wp.kernel(grid_stride=False)
def _measure_pieces(
    lanes: int,
    program: Program,
    least_parts: int,
    # Layouts in: bodies*
    layouts: LayoutsView,
    # Search in: row, obj, stable_draw
    search: Search,
    # Regions in: regions, sides, side_num, pieces, piece, region; out: piece_area
    regions: Regions,
):
    num = regions.regions[0]
    parts = lanes_for_each(lanes, num, least_parts)
    polygon = wp.zeros(shape=(MAX_CORNERS,), dtype=wp.vec2)
    for i in range(wp.tid(), parts * num, lanes):
        c = regions.region[i // parts]
        obj = search.obj[c]
        frame = support_pose(program, layouts, search.row[c], obj)
        stable = search.stable_draw[c].stable
        triangles = program.stable_trinum[stable]
        for k in range(i % parts, regions.pieces[c], parts):
            index = regions.piece[c, k]
            tri = program.stable_triadr[stable] + index % triangles
            size = float(1.0)
            if not is_point(program, tri):
                t = posed_triangle(program, tri, frame)
                size = area(polygon, cut_triangle(program, regions, c, obj, index // triangles, t, polygon))
            regions.piece_area[c, k] = size


def launch_cut_regions(work: Workspace, regions: Regions) -> None:
    """List and measure the pieces of all regions, without pieces that a cheap test finds to be empty."""
    for kernel in (_find_pieces, _measure_pieces):
        work.launch_lanes(kernel, work.program, work.size.parts, work.layouts, work.search, regions)
