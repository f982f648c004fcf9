"""The point of the support that an object goes to: uniform by area in the region that its relations leave.

Without relations the region is the same in every world and its triangles are cut once, on the host. With relations
each triangle is clipped against the relations' pieces in the world at hand; what is left is chosen by area in one pass
without any sum: piece i runs an exponential race at the rate of its area, and the first one wins (P(i) = area_i /
total), so the choice does not depend on how many lanes share the work.
"""

import warp as wp

from sceniris_gym.config.limits import MAX_ANCHORS, MAX_CORNERS
from sceniris_gym.layout.blocks import block_sync
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.orientations import DrawnVariant, facing
from sceniris_gym.layout.placed import Placed
from sceniris_gym.layout.polygons import area, clip, draw_in_polygon, set_triangle
from sceniris_gym.layout.random import uniforms
from sceniris_gym.layout.regions import outline_distance
from sceniris_gym.layout.relations import holds, look, piece_side, side_num
from sceniris_gym.layout.transforms import Pose, apply
from sceniris_gym.program.device import Cause, OrientationType, Program

_MAX_ANCHORS = wp.constant(MAX_ANCHORS)
_MAX_CORNERS = wp.constant(MAX_CORNERS)
_NONE = wp.constant(int(Cause.NONE))
_EMPTY = wp.constant(int(Cause.EMPTY))
_REGION = wp.constant(int(Cause.REGION))
_ANY = wp.constant(int(OrientationType.ANY))
_FACE_TO = wp.constant(int(OrientationType.FACE_TO))
# Draws of a trial from here on belong to the region: a block of them for each redraw, one number for each piece.
_FIRST_DRAW = wp.constant(1 << 16)
_DRAWS = wp.constant(1 << 20)
# A slice holds at most twice what it should, so 64 redraws of a whole one in vain have a probability of 1e-19. Many may
# be needed where the support or another relation leaves of it little more than what lies outside of the ring, and where
# bounds are measured, of which the circles around them say little.
_REDRAWS = wp.constant(64)
# Pieces below this area [m^2] are rounding: a line of 1 mm, drawn 40 um wide, has 4e-8.
_LEAST_AREA = wp.constant(1.0e-10)
_HALF_STEP = wp.constant(2.0**-25)
_NOBODY = wp.constant(wp.uint64(0xFFFFFFFFFFFFFFFF))
# A surface carries as long as it is level to 0.1 degree.
_LEVEL = wp.constant(0.9999985)


@wp.struct
class Spot:
    """A point on a surface: its number, where in the world [m], and why there is none."""

    surface: int
    at: wp.vec3
    cause: int


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
    s = wp.sqrt(u)
    return (1.0 - s) * program.tri_a[tri] + (s * (1.0 - v)) * program.tri_b[tri] + (s * v) * program.tri_c[tri]


@wp.func
def race_time(u: float, size: float) -> float:
    """When a piece of this area [m^2] finishes the race that the smallest time wins, from a uniform number.

    The number 0 stands for all below 2^-24, and is taken for their middle: at a time of 0 area would decide nothing.
    """
    run = -wp.log(1.0 - u)
    if u == 0.0:
        run = _HALF_STEP
    return run / size


@wp.func
def _xy(frame: Pose, p: wp.vec2, height: float) -> wp.vec2:
    w = apply(frame, wp.vec3(p[0], p[1], height))
    return wp.vec2(w[0], w[1])


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
def _look_around(program: Program, layouts: LayoutsView, worldid: int, obj: int, own: Placed, support_heading: float):
    """What each of the object's relations comes to in this world, into `layouts.sights` and `layouts.hulls`."""
    for i in range(program.obj_relnum[obj]):
        layouts.sights[worldid, i] = look(
            program,
            program.obj_reladr[obj] + i,
            own,
            support_heading,
            layouts.place[worldid],
            layouts.bounds[worldid],
            layouts.present[worldid],
            layouts.hulls[worldid],
            i * _MAX_ANCHORS,
        )


@wp.func
def _cut(
    program: Program,
    layouts: LayoutsView,
    worldid: int,
    obj: int,
    variant: int,
    index: int,
    frame: Pose,
    polygon: wp.array(dtype=wp.vec2),
) -> int:
    """Piece `index` of the region: a triangle of the support within one convex piece of every relation.

    Returns the number of corners of `polygon`.
    """
    tri = program.variant_triadr[variant] + index % program.variant_trinum[variant]
    rest = index // program.variant_trinum[variant]
    height = program.surface_height[program.tri_surface[tri]]
    num = set_triangle(
        polygon,
        _xy(frame, program.tri_a[tri], height),
        _xy(frame, program.tri_b[tri], height),
        _xy(frame, program.tri_c[tri], height),
    )
    for i in range(program.obj_relnum[obj]):
        rel = program.obj_reladr[obj] + i
        sight = layouts.sights[worldid, i]
        piece = rest % program.rel_piecenum[rel]
        rest = rest // program.rel_piecenum[rel]
        # a relation that is not active has one piece, the whole plane
        if not sight.active and piece > 0:
            num = int(0)
        for side in range(side_num(program, rel, sight)):
            if num > 0:
                plane = piece_side(program, rel, piece, side, sight, layouts.hulls[worldid], i * _MAX_ANCHORS)
                if plane.normal[0] != 0.0 or plane.normal[1] != 0.0:  # the whole plane cuts nothing
                    num = clip(polygon, num, plane)
    return num


@wp.func
def draw_related(
    program: Program,
    layouts: LayoutsView,
    worldid: int,
    lane: int,
    obj: int,
    turn: DrawnVariant,
    frame: Pose,
    support_heading: float,
    stream: wp.uint32,
    trial: int,
) -> Spot:
    """A uniform point of the region in this world. All lanes of the block must call it together; all get the same.

    Lane 0 looks at the relations, all lanes cut and measure, and the lane that cut the winning piece draws the point: a
    polygon is memory of a lane's own, and 32 copies of the same one would be 32 times the traffic.
    """
    spot = Spot()
    spot.surface = int(-1)
    spot.cause = _EMPTY
    if frame.rot[2, 2] < _LEVEL:
        return spot
    seed = layouts.seed[worldid]
    episode = layouts.episode[worldid]
    own = Placed()
    own.heading = turn.yaw
    if program.obj_orientation[obj] != _ANY:
        own.heading += support_heading
    own.low = wp.vec2(turn.bounds[0], turn.bounds[1])
    own.high = wp.vec2(turn.bounds[2], turn.bounds[3])
    polygon = wp.zeros(shape=(_MAX_CORNERS,), dtype=wp.vec2)
    if lane == 0:
        _look_around(program, layouts, worldid, obj, own, support_heading)
    block_sync()
    pieces = program.variant_trinum[turn.variant] * program.obj_cutnum[obj]
    for redraw in range(_REDRAWS):
        first_draw = _FIRST_DRAW + redraw * _DRAWS
        best = _NOBODY
        cut = int(-1)
        num = int(0)
        for i in range(lane, pieces, wp.block_dim()):
            cut = i
            num = _cut(program, layouts, worldid, obj, turn.variant, i, frame, polygon)
            size = area(polygon, num)
            if size > _LEAST_AREA:
                race = uniforms(seed, episode, stream, trial, first_draw + 1 + i // 4)
                finish = race_time(race[i % 4], size)
                best = wp.min(best, (wp.uint64(wp.cast(finish, wp.uint32)) << wp.uint64(32)) | wp.uint64(i))
        best = wp.tile_extract(wp.tile_min(wp.tile(best)), 0)
        if best == _NOBODY:
            spot.cause = _EMPTY
            return spot
        index = int(best & wp.uint64(0xFFFFFFFF))
        tri = program.variant_triadr[turn.variant] + index % program.variant_trinum[turn.variant]
        if lane == index % wp.block_dim():
            u = uniforms(seed, episode, stream, trial, first_draw)
            if cut != index:  # the lane has cut another piece since
                num = _cut(program, layouts, worldid, obj, turn.variant, index, frame, polygon)
            own.at = draw_in_polygon(polygon, num, u[0], u[1], u[2])
            target = program.obj_target[obj]
            if program.obj_orientation[obj] == _FACE_TO and layouts.present[worldid, target] != 0:
                at = layouts.place[worldid, target]
                own.heading = turn.yaw + facing(own.at, wp.vec2(at[0], at[1]))
            held = int(1)
            for i in range(program.obj_relnum[obj]):
                sight = layouts.sights[worldid, i]
                rel = program.obj_reladr[obj] + i
                if not holds(program, rel, sight, own, layouts.place[worldid], layouts.bounds[worldid]):
                    held = int(0)
            if program.obj_erosion[obj] > 0.0:
                if not _keeps_off(program, obj, tri, frame, own):
                    held = int(0)
            layouts.drawn[worldid] = wp.vec3(own.at[0], own.at[1], float(held))
        block_sync()
        drawn = layouts.drawn[worldid]
        spot.cause = _REGION
        if drawn[2] > 0.0:
            spot.cause = _NONE
            spot.surface = program.tri_surface[tri]
            spot.at = _on_surface(frame, program.surface_height[spot.surface], wp.vec2(drawn[0], drawn[1]))
            return spot
    return spot


@wp.func
def draw_unrelated(
    program: Program,
    layouts: LayoutsView,
    worldid: int,
    lane: int,
    obj: int,
    turn: DrawnVariant,
    frame: Pose,
    support_heading: float,
    stream: wp.uint32,
    trial: int,
) -> Spot:
    """Stands for `draw_related` in scenes without relations, whose kernel need not carry it; never called there."""
    return Spot()
