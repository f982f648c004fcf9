"""The point of the support that an object goes to: uniform by area in the region that its relations leave.

Without relations the region is the same in every world and its triangles are cut once, on the host. With relations
each triangle is clipped against the relations' pieces in the world at hand; what is left is chosen by area in one pass
without any sum: piece i runs an exponential race at the rate of its area, and the first one wins (P(i) = area_i /
total).
"""

import warp as wp

from sceniris_gym.config.limits import MAX_ANCHORS, MAX_CORNERS
from sceniris_gym.layout.blocks import block_any, block_sync
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.orientations import facing
from sceniris_gym.layout.placed import Placed
from sceniris_gym.layout.polygons import HalfPlane, area, clip, draw_in_polygon, set_triangle
from sceniris_gym.layout.posing import pose_candidate
from sceniris_gym.layout.random import uniforms
from sceniris_gym.layout.regions import outline_distance
from sceniris_gym.layout.relations import piece_side, relation_holds, resolve, side_num
from sceniris_gym.layout.search import Search, SearchSize, candidate_num, stream_of, trial_of
from sceniris_gym.layout.transforms import Pose, apply, pose_of
from sceniris_gym.program.device import Cause, ObjectKind, OrientationType, Program

wp.set_module_options({"enable_backward": False})

_MAX_ANCHORS = wp.constant(MAX_ANCHORS)
_MAX_CORNERS = wp.constant(MAX_CORNERS)
_NONE = wp.constant(int(Cause.NONE))
_EMPTY = wp.constant(int(Cause.EMPTY))
_REGION = wp.constant(int(Cause.REGION))
_FACE_TO = wp.constant(int(OrientationType.FACE_TO))
_STATIC = wp.constant(int(ObjectKind.STATIC))
# Draws of a trial from here on belong to the region: a block of them for each redraw, one number for each piece.
_FIRST_DRAW = wp.constant(1 << 16)
_DRAWS = wp.constant(1 << 20)
# A slice holds at most twice what it should, so 64 redraws of a whole one in vain have a probability of 1e-19. Many may
# be needed where the support or another relation leaves of it little more than what lies outside of the ring, and where
# bounds are measured, of which the circles around them say little.
_REDRAWS = wp.constant(64)
# Pieces below this area [m^2] are rounding: a line of 1 mm, drawn 40 um wide, has 4e-8.
_LEAST_AREA = wp.constant(1.0e-10)
# A triangle further beyond a side than this [m] has nothing left, however the cut rounds.
_SURE = wp.constant(1.0e-5)
_HALF_STEP = wp.constant(2.0**-25)
_NOBODY = wp.constant(wp.uint64(0xFFFFFFFFFFFFFFFF))
# A surface carries as long as it is level to 0.1 degree.
_LEVEL = wp.constant(0.9999985)


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
def _resolve_relations(program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, own: Placed):
    """What each of the object's relations comes to in this row, into `search.relations` and `search.hulls`."""
    support_heading = _support_heading(program, layouts, row, obj)
    for i in range(program.obj_relnum[obj]):
        search.relations[c, i] = resolve(
            program,
            program.obj_reladr[obj] + i,
            own,
            support_heading,
            layouts.place[row],
            layouts.bounds[row],
            layouts.present[row],
            search.hulls[c],
            i * _MAX_ANCHORS,
        )


@wp.func
def _build_sides(program: Program, search: Search, c: int, obj: int, lane: int):
    """The half-planes around all pieces of the object's relations, into `search.sides`; the lanes share them."""
    nums = wp.vec4i(0)
    for i in range(program.obj_relnum[obj]):
        rel = program.obj_reladr[obj] + i
        resolved = search.relations[c, i]
        sides = side_num(program, rel, resolved)
        nums[i] = wp.where(resolved.active, sides, -1)
        for k in range(lane, program.rel_piecenum[rel] * sides, wp.block_dim()):
            side = piece_side(program, rel, k // sides, k % sides, resolved, search.hulls[c], i * _MAX_ANCHORS)
            search.sides[c, program.rel_sideadr[rel] + k] = side
    if lane == 0:
        search.side_num[c] = nums
        search.pieces[c] = 0


@wp.struct
class _Triangle:
    """A triangle of the region, seen from above in the world [m]."""

    a: wp.vec2
    b: wp.vec2
    c: wp.vec2


@wp.func
def _triangle(program: Program, tri: int, frame: Pose) -> _Triangle:
    """Triangle `tri` of the support that is posed at `frame`."""
    height = program.surface_height[program.tri_surface[tri]]
    t = _Triangle()
    t.a = _xy(frame, program.tri_a[tri], height)
    t.b = _xy(frame, program.tri_b[tri], height)
    t.c = _xy(frame, program.tri_c[tri], height)
    return t


@wp.func
def _is_out_of_reach(program: Program, search: Search, c: int, obj: int, t: _Triangle) -> bool:
    """Do the bounds of a triangle lie beyond the circle that holds all pieces of one of the relations?"""
    low = wp.min(wp.min(t.a, t.b), t.c)
    high = wp.max(wp.max(t.a, t.b), t.c)
    for i in range(program.obj_relnum[obj]):
        resolved = search.relations[c, i]
        if resolved.active:
            off = wp.max(wp.max(low - resolved.apex, resolved.apex - high), wp.vec2(0.0))
            if wp.length(off) > resolved.reach:
                return True
    return False


@wp.func
def _lies_beyond(h: HalfPlane, t: _Triangle) -> bool:
    """Are all corners of a triangle outside a half-plane?"""
    limit = h.offset + wp.dot(h.normal, h.origin)
    return wp.min(wp.min(wp.dot(h.normal, t.a), wp.dot(h.normal, t.b)), wp.dot(h.normal, t.c)) > limit + _SURE


@wp.func
def _cut(
    program: Program,
    search: Search,
    c: int,
    obj: int,
    combination: int,
    t: _Triangle,
    polygon: wp.array(dtype=wp.vec2),
) -> int:
    """What is left of a triangle within one convex piece of every relation: the number of corners of `polygon`.

    Most triangles lie wholly beyond a side of most pieces, so that is asked before anything is cut.
    """
    nums = search.side_num[c]
    for look in range(2):
        num = int(3)
        if look == 1:
            num = set_triangle(polygon, t.a, t.b, t.c)
        rest = int(combination)
        for i in range(program.obj_relnum[obj]):
            rel = program.obj_reladr[obj] + i
            piece = rest % program.rel_piecenum[rel]
            rest = rest // program.rel_piecenum[rel]
            sides = nums[i]
            # a relation that is not active has one piece, the whole plane
            if sides < 0:
                if piece > 0:
                    return 0
                continue
            adr = program.rel_sideadr[rel] + piece * sides
            for k in range(adr, adr + sides):
                plane = search.sides[c, k]
                if look == 0:
                    if _lies_beyond(plane, t):
                        return 0
                elif num > 0 and (plane.normal[0] != 0.0 or plane.normal[1] != 0.0):  # the whole plane cuts nothing
                    num = clip(polygon, num, plane)
    return num


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
def _measure_pieces(
    program: Program, search: Search, c: int, obj: int, lane: int, frame: Pose, polygon: wp.array(dtype=wp.vec2)
):
    """List the pieces of the candidate's region that have any area; the lanes of a block share the triangles."""
    variant = search.turn[c].variant
    triangles = program.variant_trinum[variant]
    for k in range(lane, triangles, wp.block_dim()):
        t = _triangle(program, program.variant_triadr[variant] + k, frame)
        if not _is_out_of_reach(program, search, c, obj, t):
            for combination in range(program.obj_cutnum[obj]):
                size = area(polygon, _cut(program, search, c, obj, combination, t, polygon))
                if size > _LEAST_AREA:
                    i = wp.atomic_add(search.pieces, c, 1)
                    search.piece[c, i] = combination * triangles + k
                    search.piece_area[c, i] = size


@wp.func
def _fastest_piece(search: Search, c: int, lane: int, seed: wp.uint64, counter: wp.vec4ui) -> wp.uint64:
    """The piece that wins the race among a lane's: its time in the upper word, its number in the lower."""
    best = _NOBODY
    for k in range(lane, search.pieces[c], wp.block_dim()):
        i = search.piece[c, k]
        race = uniforms(seed, int(counter[0]), counter[1], int(counter[2]), int(counter[3]) + 1 + i // 4)
        finish = race_time(race[i % 4], search.piece_area[c, k])
        best = wp.min(best, (wp.uint64(wp.cast(finish, wp.uint32)) << wp.uint64(32)) | wp.uint64(i))
    return best


@wp.func
def _keep_point(program: Program, search: Search, c: int, obj: int, tri: int, frame: Pose, at: wp.vec2):
    """Write the candidate's point: on the surface, or at the drawn height where nothing carries the object."""
    surface = program.tri_surface[tri]
    if program.obj_ground[obj] >= 0:
        search.surface[c] = surface
        search.point[c] = _on_surface(frame, program.surface_height[surface], at)
    else:
        search.point[c] = wp.vec3(at[0], at[1], search.point[c][2])


@wp.func
def _draw_related(
    program: Program,
    layouts: LayoutsView,
    search: Search,
    c: int,
    row: int,
    obj: int,
    lane: int,
    frame: Pose,
    stream: wp.uint32,
    trial: int,
) -> int:
    """Draw a uniform point of the region that is left in this row. Returns why there is none, or NONE.

    All lanes of a block call it together, and cut and measure; the first draws the point of the piece that wins.
    """
    seed = layouts.seed[search.row_world[row]]
    episode = layouts.episode[search.row_world[row]]
    turn = search.turn[c]
    own = Placed()
    own.heading = search.heading[c]
    own.low = wp.vec2(turn.bounds[0], turn.bounds[1])
    own.high = wp.vec2(turn.bounds[2], turn.bounds[3])
    polygon = wp.zeros(shape=(_MAX_CORNERS,), dtype=wp.vec2)
    if lane == 0:
        _resolve_relations(program, layouts, search, c, row, obj, own)
    block_sync()
    _build_sides(program, search, c, obj, lane)
    block_sync()
    _measure_pieces(program, search, c, obj, lane, frame, polygon)
    block_sync()
    for redraw in range(_REDRAWS):
        first_draw = _FIRST_DRAW + redraw * _DRAWS
        counter = wp.vec4ui(wp.uint32(episode), stream, wp.uint32(trial), wp.uint32(first_draw))
        best = _fastest_piece(search, c, lane, seed, counter)
        best = wp.tile_extract(wp.tile_min(wp.tile(best)), 0)
        if best == _NOBODY:
            return _EMPTY
        held = int(0)
        if lane == 0:
            index = int(best & wp.uint64(0xFFFFFFFF))
            triangles = program.variant_trinum[turn.variant]
            tri = program.variant_triadr[turn.variant] + index % triangles
            u = uniforms(seed, episode, stream, trial, first_draw)
            num = _cut(program, search, c, obj, index // triangles, _triangle(program, tri, frame), polygon)
            own.at = draw_in_polygon(polygon, num, u[0], u[1], u[2])
            target = program.obj_target[obj]
            if program.obj_orientation[obj] == _FACE_TO and layouts.present[row, target] != 0:
                at = layouts.place[row, target]
                own.heading = turn.yaw + facing(own.at, wp.vec2(at[0], at[1]))
            if _all_hold(program, layouts, search, c, row, obj, tri, frame, own):
                held = int(1)
                _keep_point(program, search, c, obj, tri, frame, own.at)
        if block_any(held) != 0:
            return _NONE
    return _REGION


@wp.func
def _frame(program: Program, layouts: LayoutsView, row: int, obj: int) -> Pose:
    """The pose of what carries the object; that of the world where nothing does."""
    frame = pose_of(wp.vec3(0.0), wp.vec4(1.0, 0.0, 0.0, 0.0))
    ground = program.obj_ground[obj]
    if ground >= 0:
        frame = pose_of(layouts.body_pos[row, ground], layouts.body_quat[row, ground])
    return frame


@wp.func
def _support_heading(program: Program, layouts: LayoutsView, row: int, obj: int) -> float:
    """The heading [rad] of what carries the object."""
    frame = _frame(program, layouts, row, obj)
    return wp.atan2(frame.rot[1, 0], frame.rot[0, 0])


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
    for c in range(block, candidate_num(search), blocks):
        row = search.row[c]
        obj = search.obj[c]
        if search.cause[c] == _NONE and program.obj_kind[obj] != _STATIC and program.obj_cutnum[obj] > 0:
            frame = _frame(program, layouts, row, obj)
            cause = _EMPTY
            if frame.rot[2, 2] >= _LEVEL:
                trial = trial_of(program, search, c)
                stream = stream_of(program, split, obj)
                cause = _draw_related(program, layouts, search, c, row, obj, lane, frame, stream, trial)
            block_sync()
            if lane == 0:
                search.cause[c] = cause
                if cause == _NONE:
                    pose_candidate(program, layouts, search, c, row, obj)


def launch_draw_points(
    program: Program, split: int, size: SearchSize, layouts: LayoutsView, search: Search, device: str
) -> None:
    """Draw the points of candidates whose region differs between worlds."""
    wp.launch_tiled(
        _draw_points,
        dim=[size.blocks],
        inputs=[program, split, size.blocks, layouts, search],
        block_dim=size.block_dim,
        device=device,
    )
