"""The point of the support that an object goes to: uniform by area in the region that its relations leave.

Without relations the region is the same in every world and its triangles are cut once, on the host. With relations
`region_pieces.py` cuts them in the world at hand and has a race choose a piece by area; here a point of that piece is
drawn, and drawn again, from the next race, where it turns out not to hold.
"""

import warp as wp

from sceniris_gym.config.limits import MAX_CORNERS
from sceniris_gym.device.blocks import block_any
from sceniris_gym.device.transforms import Pose, apply
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.posing import pose_candidate
from sceniris_gym.layout.wave.race import NO_PIECE, finish, numbers_of, point_numbers, winner_index
from sceniris_gym.layout.wave.region_pieces import LEAST_AREA, cut_triangle, is_point, posed_triangle
from sceniris_gym.layout.wave.search import Search, SearchSize
from sceniris_gym.layout.wave.sides import support_pose
from sceniris_gym.placement.footprint import outline_distance
from sceniris_gym.placement.orientations import facing
from sceniris_gym.placement.placed import Placed, placed
from sceniris_gym.placement.polygons import draw_in_polygon
from sceniris_gym.placement.relations import relation_holds
from sceniris_gym.program.device import Cause, OrientationType, Program

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# A slice holds at most twice what it should, so 64 redraws of a whole one in vain have a probability of 1e-19. Many may
# be needed where the support or another relation leaves of it little more than what lies outside of the ring, and where
# bounds are measured, of which the circles around them say little.
_REDRAWS = wp.constant(64)


@wp.func
def draw_triangle(program: Program, variant: int, u: float) -> int:
    """The triangle of the region of an object's pose that holds the share `u` of its area."""
    low = program.variant_triadr[variant]
    high = low + program.variant_trinum[variant] - 1
    while low < high:
        middle = (low + high) // 2
        if u < program.tri_cdf[middle]:
            high = middle
        else:
            low = middle + 1
    return low


@wp.func
def draw_in_triangle(program: Program, tri: int, u: float, v: float) -> wp.vec2:
    """A uniform point of a triangle. R. Osada et al., "Shape distributions", ACM Trans. Graphics 21(4), 2002."""
    if is_point(program, tri):
        return program.tri_a[tri]
    s = wp.sqrt(u)
    return (1.0 - s) * program.tri_a[tri] + (s * (1.0 - v)) * program.tri_b[tri] + (s * v) * program.tri_c[tri]


@wp.func
def _on_surface(frame: Pose, height: float, at: wp.vec2) -> wp.vec3:
    """The point of a surface that is seen at `at` from above: level to 0.1 degree is not level to 0.1 mm."""
    ground = apply(frame, wp.vec3(0.0, 0.0, height))
    n = wp.vec3(frame.rot[0, 2], frame.rot[1, 2], frame.rot[2, 2])
    return wp.vec3(at[0], at[1], ground[2] - (n[0] * (at[0] - ground[0]) + n[1] * (at[1] - ground[1])) / n[2])


@wp.func
def _keeps_off(program: Program, obj: int, tri: int, frame: Pose, own: Placed) -> bool:
    """Does the pivot keep its distance from the outline of the surface, in the bounds that were drawn?"""
    size = own.high - own.low
    surface = program.tri_surface[tri]
    p = wp.transpose(frame.rot) * (_on_surface(frame, program.surface_height[surface], own.at) - frame.pos)
    distance = outline_distance(program, surface, wp.vec2(p[0], p[1]))
    return distance >= program.obj_erosion[obj] * wp.min(size[0], size[1])


@wp.func
def _all_hold(
    program: Program,
    layouts: LayoutsView,
    search: Search,
    c: int,
    row: int,
    obj: int,
    tri: int,
    frame: Pose,
    own: Placed,
) -> bool:
    """Do all relations hold exactly at the drawn point, and does the pivot keep off the outline?"""
    for i in range(program.obj_relnum[obj]):
        resolved = search.relations[c, i]
        rel = program.obj_reladr[obj] + i
        if not relation_holds(program, rel, resolved, own, layouts.place[row], layouts.bounds[row]):
            return False
    return program.obj_erosion[obj] <= 0.0 or _keeps_off(program, obj, tri, frame, own)


@wp.func
def _keep_point(program: Program, search: Search, c: int, obj: int, tri: int, frame: Pose, at: wp.vec2):
    """Write the candidate's point: on the surface, or where nothing carries the object at the drawn height over it."""
    surface = program.tri_surface[tri]
    if program.obj_ground[obj] >= 0:
        search.surface[c] = surface
        search.point[c] = _on_surface(frame, program.surface_height[surface], at)
    else:
        search.point[c] = wp.vec3(at[0], at[1], program.surface_height[surface] + search.point[c][2])


@wp.func
def _draw_in_piece(
    program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, index: int, u: wp.vec4
) -> bool:
    """Draw a point of a piece of a candidate's region from three uniform numbers, and keep it where all holds."""
    frame = support_pose(program, layouts, row, obj)
    turn = search.turn[c]
    triangles = program.variant_trinum[turn.variant]
    tri = program.variant_triadr[turn.variant] + index % triangles
    t = posed_triangle(program, tri, frame)
    at = t.a
    if not is_point(program, tri):
        polygon = wp.zeros(shape=(MAX_CORNERS,), dtype=wp.vec2)
        num = cut_triangle(program, search, c, obj, index // triangles, t, polygon)
        at = draw_in_polygon(polygon, num, u[0], u[1], u[2])
    heading = search.heading[c]
    if program.obj_orientation[obj] == OrientationType.FACE_TO:
        target = program.obj_target[obj]
        if layouts.present[row, target] != 0:
            place = layouts.place[row, target]
            heading = turn.yaw + facing(at, wp.vec2(place[0], place[1]))
    own = placed(at, heading, turn.bounds)
    if not _all_hold(program, layouts, search, c, row, obj, tri, frame, own):
        return False
    _keep_point(program, search, c, obj, tri, frame, at)
    return True


@wp.func
def _race_again(
    program: Program,
    split: wp.uint32,
    layouts: LayoutsView,
    search: Search,
    c: int,
    needs: int,
    lane: int,
    redraw: int,
) -> wp.uint64:
    """The piece that wins the race of a redraw, for each lane whose candidate needs one.

    Lists may have hundreds of pieces, so all lanes of the block run the race of one candidate after the other.
    """
    own = NO_PIECE
    wanted = wp.tile(wp.where(needs != 0, c, -1))
    for other in range(wp.block_dim()):
        racing = wp.tile_extract(wanted, other)
        if racing >= 0:
            numbers = numbers_of(program, split, layouts, search, racing)
            best = NO_PIECE
            for k in range(lane, search.pieces[racing], wp.block_dim()):
                size = search.piece_area[racing, k]
                if size > LEAST_AREA:
                    best = wp.min(best, finish(numbers, redraw, search.piece[racing, k], size))
            best = wp.tile_extract(wp.tile_min(wp.tile(best)), 0)
            if lane == other:
                own = best
    return own


@wp.kernel(grid_stride=False)
def _draw_points(
    program: Program,
    split: wp.uint32,
    blocks: int,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    block, lane = wp.tid()
    num = search.cuts[0]
    for base in range(block * wp.block_dim(), num, blocks * wp.block_dim()):
        needs = wp.where(base + lane < num, 1, 0)
        c = search.cut[wp.min(base + lane, num - 1)]
        row = search.row[c]
        obj = search.obj[c]
        winner = search.winner[c]
        if winner == NO_PIECE and needs != 0:
            search.cause[c] = Cause.EMPTY
            needs = 0
        redraw = int(0)
        while redraw < _REDRAWS and block_any(needs) != 0:
            if redraw > 0:
                winner = _race_again(program, split, layouts, search, c, needs, lane, redraw)
            if needs != 0:
                u = point_numbers(numbers_of(program, split, layouts, search, c), redraw)
                if _draw_in_piece(program, layouts, search, c, row, obj, winner_index(winner), u):
                    needs = 0
                    pose_candidate(program, layouts, search, c, row, obj)
            redraw += 1
        if needs != 0:
            search.cause[c] = Cause.REGION


def launch_draw_points(
    program: Program, split: int, size: SearchSize, layouts: LayoutsView, search: Search, device: str
) -> None:
    """Draw the points of the candidates that are listed, a lane for each."""
    wp.launch_tiled(
        _draw_points,
        dim=[size.blocks],
        inputs=[program, split, size.blocks, layouts],
        outputs=[search],
        block_dim=size.block_dim,
        device=device,
    )
