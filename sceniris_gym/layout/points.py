"""The point of the support that an object goes to: uniform by area in the region that its relations leave.

Without relations the region is the same in every world and its triangles are cut once, on the host. With relations
each triangle is clipped against the relations' pieces in the world at hand; what is left is chosen by area in one pass
without any sum: piece i runs an exponential race at the rate of its area, and the first one wins (P(i) = area_i /
total), so the choice does not depend on how many lanes share the work.
"""

import warp as wp

from sceniris_gym.layout.orientations import Turn, facing
from sceniris_gym.layout.placed import Placed
from sceniris_gym.layout.polygons import Polygon, area, draw_in_polygon, triangle
from sceniris_gym.layout.random import uniforms
from sceniris_gym.layout.relations import clip_to, holds, look
from sceniris_gym.layout.transforms import Pose, apply
from sceniris_gym.scene.device import Cause, Program, TurnType

_NONE = wp.constant(int(Cause.NONE))
_EMPTY = wp.constant(int(Cause.EMPTY))
_REGION = wp.constant(int(Cause.REGION))
_ANY = wp.constant(int(TurnType.ANY))
_FACE_TO = wp.constant(int(TurnType.FACE_TO))
# Draws of a trial from here on belong to the region: a block of them for each redraw, one number for each piece.
_FIRST_DRAW = wp.constant(1 << 16)
_DRAWS = wp.constant(1 << 20)
# A slice holds at most 4% too much, so 32 redraws in vain have a probability of 1e-45; where bounds are measured, of
# which the circles around them say little, more are needed.
_REDRAWS = wp.constant(64)
# Pieces below this area [m^2] are rounding: a line of 1 mm, drawn 40 um wide, has 4e-8.
_LEAST_AREA = wp.constant(1.0e-10)
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
def draw_triangle(program: Program, obj: int, u: float) -> int:
    """The triangle of the object's region that holds the share `u` of its area."""
    low = program.obj_triadr[obj]
    high = low + program.obj_trinum[obj] - 1
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
def _xy(frame: Pose, p: wp.vec2, height: float) -> wp.vec2:
    w = apply(frame, wp.vec3(p[0], p[1], height))
    return wp.vec2(w[0], w[1])


@wp.func
def _piece(
    program: Program,
    obj: int,
    index: int,
    frame: Pose,
    own: Placed,
    support_heading: float,
    place: wp.array(dtype=wp.vec4),
    bounds: wp.array(dtype=wp.vec4),
    present: wp.array(dtype=int),
) -> Polygon:
    """Piece `index` of the region: a triangle of the support within one convex piece of every relation."""
    num = program.obj_trinum[obj]
    tri = program.obj_triadr[obj] + index % num
    rest = index // num
    height = program.surface_height[program.tri_surface[tri]]
    p = triangle(
        _xy(frame, program.tri_a[tri], height),
        _xy(frame, program.tri_b[tri], height),
        _xy(frame, program.tri_c[tri], height),
    )
    for i in range(program.obj_relnum[obj]):
        rel = program.obj_reladr[obj] + i
        pieces = program.rel_piecenum[rel]
        sight = look(program, rel, own, support_heading, place, bounds, present)
        # a relation that is not active has one piece, the whole plane
        if not sight.active and rest % pieces != 0:
            p.num = 0
        p = clip_to(program, rel, rest % pieces, sight, p)
        rest = rest // pieces
    return p


@wp.func
def _all_hold(
    program: Program,
    obj: int,
    own: Placed,
    support_heading: float,
    place: wp.array(dtype=wp.vec4),
    bounds: wp.array(dtype=wp.vec4),
    present: wp.array(dtype=int),
) -> bool:
    for i in range(program.obj_relnum[obj]):
        rel = program.obj_reladr[obj] + i
        sight = look(program, rel, own, support_heading, place, bounds, present)
        if not holds(program, rel, sight, own, place, bounds):
            return False
    return True


@wp.func
def draw_related(
    program: Program,
    obj: int,
    lane: int,
    turn: Turn,
    frame: Pose,
    support_heading: float,
    seed: wp.uint64,
    episode: int,
    stream: wp.uint32,
    trial: int,
    place: wp.array(dtype=wp.vec4),
    bounds: wp.array(dtype=wp.vec4),
    present: wp.array(dtype=int),
) -> Spot:
    """A uniform point of the region in this world. All lanes of the block must call it together; all get the same."""
    spot = Spot()
    spot.surface = int(-1)
    spot.cause = _EMPTY
    if frame.rot[2, 2] < _LEVEL:
        return spot
    own = Placed()
    own.heading = turn.yaw
    if program.obj_turn[obj] != _ANY:
        own.heading += support_heading
    own.low = wp.vec2(turn.bounds[0], turn.bounds[1])
    own.high = wp.vec2(turn.bounds[2], turn.bounds[3])
    total = program.obj_regionnum[obj]
    for redraw in range(_REDRAWS):
        first_draw = _FIRST_DRAW + redraw * _DRAWS
        best = _NOBODY
        for i in range(lane, total, wp.block_dim()):
            size = area(_piece(program, obj, i, frame, own, support_heading, place, bounds, present))
            if size > _LEAST_AREA:
                race = uniforms(seed, episode, stream, trial, first_draw + 1 + i // 4)
                finish = -wp.log(1.0 - race[i % 4]) / size
                best = wp.min(best, (wp.uint64(wp.cast(finish, wp.uint32)) << wp.uint64(32)) | wp.uint64(i))
        best = wp.tile_extract(wp.tile_min(wp.tile(best)), 0)
        if best == _NOBODY:
            spot.cause = _EMPTY
            return spot
        index = int(best & wp.uint64(0xFFFFFFFF))
        u = uniforms(seed, episode, stream, trial, first_draw)
        p = _piece(program, obj, index, frame, own, support_heading, place, bounds, present)
        own.at = draw_in_polygon(p, u[0], u[1], u[2])
        if program.obj_turn[obj] == _FACE_TO:
            target = place[program.obj_target[obj]]
            if present[program.obj_target[obj]] != 0:
                own.heading = turn.yaw + facing(own.at, wp.vec2(target[0], target[1]))
        spot.surface = program.tri_surface[program.obj_triadr[obj] + index % program.obj_trinum[obj]]
        ground = apply(frame, wp.vec3(0.0, 0.0, program.surface_height[spot.surface]))
        # the surface's height over the point: what is level to 0.1 degree is not level to 0.1 mm
        n = wp.vec3(frame.rot[0, 2], frame.rot[1, 2], frame.rot[2, 2])
        z = ground[2] - (n[0] * (own.at[0] - ground[0]) + n[1] * (own.at[1] - ground[1])) / n[2]
        spot.at = wp.vec3(own.at[0], own.at[1], z)
        if _all_hold(program, obj, own, support_heading, place, bounds, present):
            spot.cause = _NONE
            return spot
        spot.cause = _REGION
    return spot
