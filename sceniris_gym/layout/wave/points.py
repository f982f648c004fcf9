"""Draw an object's point on its support, uniform by area in the region that satisfies its relations.

Without relations, the region is the same in every world, and the host clips its triangles once. With relations,
`region_pieces.py` clips them in each world. This module samples a piece by its area in an exponential race, and draws a
point in this piece. If the point fails the exact test of the relations, the module runs another race and draws another
point.

The race takes one pass and no sum. Each piece draws an arrival time at the rate of its area, and the least time wins:
P(i) = area_i / total. P. Efraimidis, P. Spirakis, "Weighted random sampling with a reservoir", Information Processing
Letters 97, 2006.
"""

import warp as wp

from sceniris_gym.config.bounds import MAX_CORNERS
from sceniris_gym.device.blocks import block_any
from sceniris_gym.device.random import uniforms
from sceniris_gym.device.transforms import Pose, apply, log_of
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.posing import heading_at, pose_candidate
from sceniris_gym.layout.wave.region_pieces import cut_triangle, is_point, launch_cut_regions, posed_triangle
from sceniris_gym.layout.wave.search import Search, Workspace, stream_of, trial_of
from sceniris_gym.layout.wave.sides import Regions, launch_build_sides, support_pose
from sceniris_gym.placement.footprint import outline_distance
from sceniris_gym.placement.placed import Placed, placed
from sceniris_gym.placement.polygons import draw_in_polygon
from sceniris_gym.placement.relations import relation_holds
from sceniris_gym.program.device import Cause, Program

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# A slice covers at most twice the area of its part of the ring, so for a whole slice all 64 redraws fail with a
# probability of 1e-19. More redraws are needed if the support or another relation cuts away most of the ring's part, or
# if distances are measured between bounds, because the circles around bounds are a poor approximation.
_REDRAWS = wp.constant(64)
# The draws of a trial from this number on belong to the region. Each redraw has a block of draws. The first draw of a
# block gives the random numbers of the point, and each further draw gives the random numbers of four pieces.
_FIRST_DRAW = wp.constant(1 << 16)
_DRAWS = wp.constant(1 << 20)
_HALF_STEP = wp.constant(2.0**-25)
# Pieces below this area [m^2] are rounding errors: a line of 1 mm, drawn 40 um wide, has 4e-8.
_LEAST_AREA = wp.constant(1.0e-10)
NO_PIECE = wp.constant(wp.uint64(0xFFFFFFFFFFFFFFFF))
"""Sentinel: no piece has positive area."""


@wp.struct
class PointCounter:
    """Seed, episode, stream and trial, which together with the index of a draw determine a point's random numbers.

    A candidate has one PointCounter for all draws of its point.
    """

    seed: wp.uint64
    episode: int
    stream: wp.uint32
    trial: int


@wp.func
def _point_counter(program: Program, split: wp.uint32, layouts: LayoutsView, search: Search, c: int) -> PointCounter:
    """Return the seed, episode, stream and trial that determine the random numbers of a candidate's point."""
    worldid = search.row_world[search.row[c]]
    seed, episode = layouts.pending_seed[worldid], layouts.pending_episode[worldid]
    return PointCounter(seed, episode, stream_of(program, split, search.obj[c]), trial_of(program, search, c))


@wp.func
def arrival_time(u: float, size: float) -> float:
    """Return the time [1/m^2] at which a piece with the area `size` [m^2] arrives, from the uniform number `u`.

    Pieces race to be chosen: the times are exponentially distributed, and the piece that arrives first is chosen with a
    probability proportional to its area. The number 0 represents all numbers below 2^-24 and is replaced by their
    midpoint. Otherwise the time would be 0 for every area.
    """
    return wp.where(u == 0.0, _HALF_STEP, -log_of(1.0 - u)) / size


@wp.func
def arrival_key(n: PointCounter, redraw: int, index: int, size: float) -> wp.uint64:
    """Return the key by which piece `index` competes to be chosen, in proportion to its area `size` [m^2].

    The piece with the least key wins the race and is chosen. `redraw` counts the earlier races of the candidate, one
    for each point that failed the exact test. The upper word of the key is the arrival time, because the bits of
    positive floats are ordered like the floats. The lower word is the index of the piece.
    """
    u = uniforms(n.seed, n.episode, n.stream, n.trial, _FIRST_DRAW + redraw * _DRAWS + 1 + index // 4)
    which = index % 4
    own = wp.where(which < 2, wp.where(which == 0, u[0], u[1]), wp.where(which == 2, u[2], u[3]))
    return (wp.uint64(wp.cast(arrival_time(own, size), wp.uint32)) << wp.uint64(32)) | wp.uint64(index)


@wp.func
def _first_arrival(regions: Regions, holder: int, n: PointCounter, redraw: int, lane: int, lanes: int) -> wp.uint64:
    """Return the least arrival key of a region's pieces, among the pieces that lane `lane` of `lanes` covers.

    `redraw` is as in `arrival_key`.
    """
    best = NO_PIECE
    for k in range(lane, regions.pieces[holder], lanes):
        size = regions.piece_area[holder, k]
        if size > _LEAST_AREA:
            best = wp.min(best, arrival_key(n, redraw, regions.piece[holder, k], size))
    return best


@wp.func
def piece_of(key: wp.uint64) -> int:
    """Return the index of the piece to which an arrival key belongs."""
    return int(key & wp.uint64(0xFFFFFFFF))


@wp.func
def draw_triangle(program: Program, stable: int, u: float) -> int:
    """Return the first triangle of a stable pose's region at which the cumulative fraction of the area exceeds `u`."""
    low = program.stable_triadr[stable]
    high = low + program.stable_trinum[stable] - 1
    while low < high:
        middle = (low + high) // 2
        if u < program.tri_cdf[middle]:
            high = middle
        else:
            low = middle + 1
    return low


@wp.func
def draw_in_triangle(program: Program, tri: int, u: float, v: float) -> wp.vec2:
    """Draw a uniform point of a triangle. R. Osada et al., "Shape distributions", ACM Trans. Graphics 21(4), 2002."""
    if is_point(program, tri):
        return program.tri_a[tri]
    s = wp.sqrt(u)
    return (1.0 - s) * program.tri_a[tri] + (s * (1.0 - v)) * program.tri_b[tri] + (s * v) * program.tri_c[tri]


@wp.func
def _on_surface(frame: Pose, height: float, at: wp.vec2) -> wp.vec3:
    """Return the point of a surface that is vertically above or below `at` [m], in the world frame.

    The height is computed exactly, because surfaces may lean by up to 0.1 degree.
    """
    ground = apply(frame, wp.vec3(0.0, 0.0, height))
    n = wp.vec3(frame.rot[0, 2], frame.rot[1, 2], frame.rot[2, 2])
    return wp.vec3(at[0], at[1], ground[2] - (n[0] * (at[0] - ground[0]) + n[1] * (at[1] - ground[1])) / n[2])


@wp.func
def _clears_outline(program: Program, obj: int, tri: int, frame: Pose, own: Placed) -> bool:
    """Return True if the pivot is far enough from the outline of the surface for the candidate's bounds."""
    size = own.high - own.low
    surface = program.tri_surface[tri]
    p = wp.transpose(frame.rot) * (_on_surface(frame, program.surface_height[surface], own.at) - frame.pos)
    distance = outline_distance(program, surface, wp.vec2(p[0], p[1]))
    return distance >= program.obj_erosion[obj] * wp.min(size[0], size[1])


@wp.func
def _point_holds(
    program: Program, layouts: LayoutsView, search: Search, regions: Regions, c: int, tri: int, frame: Pose, own: Placed
) -> bool:
    """Return True if all relations hold exactly at the drawn point, and the pivot is far enough from the outline."""
    row = search.row[c]
    obj = search.obj[c]
    worldid = search.row_world[row]
    for i in range(program.obj_relnum[obj]):
        resolved = regions.relations[regions.holder[c], i]
        rel = program.obj_reladr[obj] + i
        if not relation_holds(program, worldid, rel, resolved, own, layouts.pivot_pose[row], layouts.bounds[row]):
            return False
    return program.obj_erosion[obj] <= 0.0 or _clears_outline(program, obj, tri, frame, own)


@wp.func
def _keep_point(program: Program, search: Search, c: int, obj: int, tri: int, frame: Pose, at: wp.vec2):
    """Write a candidate's point: on the surface, or at the drawn height above it if the object has no support."""
    surface = program.tri_surface[tri]
    if program.obj_ground[obj] >= 0:
        search.surface[c] = surface
        search.point[c] = _on_surface(frame, program.surface_height[surface], at)
    else:
        search.point[c] = wp.vec3(at[0], at[1], program.surface_height[surface] + search.point[c][2])


@wp.func
def _draw_in_piece(
    program: Program, layouts: LayoutsView, search: Search, regions: Regions, c: int, index: int, u: wp.vec4
) -> bool:
    """Draw a point in a piece from three uniform numbers. If it passes the exact test, write it and return True."""
    row = search.row[c]
    obj = search.obj[c]
    frame = support_pose(program, layouts, row, obj)
    drawn = search.stable_draw[c]
    triangles = program.stable_trinum[drawn.stable]
    tri = program.stable_triadr[drawn.stable] + index % triangles
    t = posed_triangle(program, tri, frame)
    at = t.a
    if not is_point(program, tri):
        polygon = wp.zeros(shape=(MAX_CORNERS,), dtype=wp.vec2)
        num = cut_triangle(program, regions, regions.holder[c], obj, index // triangles, t, polygon)
        at = draw_in_polygon(polygon, num, u[0], u[1], u[2])
    own = placed(at, heading_at(program, layouts, search, c, row, obj, at), drawn.bounds)
    if not _point_holds(program, layouts, search, regions, c, tri, frame, own):
        return False
    _keep_point(program, search, c, obj, tri, frame, at)
    return True


@wp.func
def _race(
    program: Program,
    split: wp.uint32,
    layouts: LayoutsView,
    search: Search,
    regions: Regions,
    c: int,
    lane: int,
    most: int,
    redraw: int,
) -> wp.uint64:
    """Return the arrival key of the piece that wins the race of a lane's candidate, or NO_PIECE.

    `redraw` is as in `arrival_key`. `c` is the candidate, or -1 for a lane without a candidate. Only the first `most`
    lanes can have a candidate. A region may have hundreds of pieces, so all lanes of the block share each race, one
    candidate after the other.
    """
    own = NO_PIECE
    wanted = wp.tile(c)
    for other in range(most):
        racing = wp.tile_extract(wanted, other)
        if racing >= 0:
            numbers = _point_counter(program, split, layouts, search, racing)
            best = _first_arrival(regions, regions.holder[racing], numbers, redraw, lane, wp.block_dim())
            best = wp.tile_extract(wp.tile_min(wp.tile(best)), 0)
            if lane == other:
                own = best
    return own


@wp.kernel(grid_stride=False)
def _draw_points(
    blocks: int,
    program: Program,
    split: wp.uint32,
    # Layouts in: present, pending*, pivots*, bodies*
    layouts: LayoutsView,
    # Search in: restarts*, trials*, stable_draw, heading, qpos; out: cause, surface, grasp, pivots*, flags*; both:
    #   point, body_pos, body_quat
    search: Search,
    # Regions in: cuts, relations, sides, side_num, pieces, piece, piece_area, cut, holder
    regions: Regions,
):
    block, lane = wp.tid()
    num = regions.cuts[0]
    # A block per candidate is faster for few candidates, and a lane per candidate for many.
    most = wp.clamp((num + blocks - 1) // blocks, 1, wp.block_dim())
    for base in range(block * most, num, blocks * most):
        needs = wp.where(lane < wp.min(most, num - base), 1, 0)
        c = regions.cut[wp.min(base + lane, num - 1)]
        redraw = int(0)
        while redraw < _REDRAWS and block_any(needs) != 0:
            winner = _race(program, split, layouts, search, regions, wp.where(needs != 0, c, -1), lane, most, redraw)
            if winner == NO_PIECE and needs != 0:
                search.cause[c] = Cause.EMPTY
                needs = 0
            if needs != 0:
                n = _point_counter(program, split, layouts, search, c)
                u = uniforms(n.seed, n.episode, n.stream, n.trial, _FIRST_DRAW + redraw * _DRAWS)
                if _draw_in_piece(program, layouts, search, regions, c, piece_of(winner), u):
                    needs = 0
                    pose_candidate(program, layouts, search, c, search.row[c], search.obj[c])
            redraw += 1
        if needs != 0:
            search.cause[c] = Cause.REGION


def launch_draw_points(work: Workspace, regions: Regions) -> None:
    """Cut the regions of this wave that differ between worlds, and draw the points of their candidates."""
    launch_build_sides(work, regions)
    launch_cut_regions(work, regions)
    work.launch_blocks(_draw_points, work.program, work.split, work.layouts, work.search, regions)
