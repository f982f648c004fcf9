"""`stands`: test if all free objects below a candidate still stand with it, by statics on MuJoCo's soft contacts.

At each level the load is all that the level carries, itself included, as one rigid body for each level. It stands if
its centre of mass is inside of the patch, the hull of its foot as far as that is on the support, by a margin. Contacts
give way: the load sinks by d, and if its centre is e away from that of the patch it leans by d K^-1 e, where K is the
mean of the outer products of the patch's corners around their mean, as each corner is a spring. All that is above moves
with it, so leaning is worked out in passes; what is top-heavy does not come to rest. A load that falls by f until it is
carried is shaken, so that the margin is to be above t sqrt(f h), with h the height of its centre; `Law` has t.

Corners of a patch of several parts are looked for in 32 directions, or in 12 if the whole foot is on the support, so
its hull is a little smaller than the exact one. MuJoCo keeps four contacts of two convex geoms that are not both boxes;
a patch then has the four corners of the largest area.
"""

import warp as wp

from sceniris_gym.config.limits import MAX_FOOT, MAX_LEVELS
from sceniris_gym.device.angles import unit_circle
from sceniris_gym.device.transforms import Pose, apply, pose_of
from sceniris_gym.placement.polygons import area, clip, cross2, half_plane
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_statics import FEW_CORNERS, Statics

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

MOST_DIRECTIONS = 32
# A convex part of a support adds a corner for each of its sides.
MOST_CORNERS = 2 * MAX_FOOT
_PASSES = 8
# A part of a foot of which less than this share is on the support has one contact there, which it may lose.
_SLIVER = wp.constant(0.3)
# Contacts that sink by more than this [m] are too soft.
_SINK = wp.constant(5.0e-3)
# MuJoCo sees two faces up to 5.1 degrees as parallel, and keeps fewer contacts beyond.
_LEAN = wp.constant(0.089)
FEW_CORNERSS = 6


@wp.struct
class Level:
    """An object and what it carries, on its patch.

    Lengths are in metres, in the world's axes around `pivot`, the point of the support under the object's pivot. `load`
    is (weight [kg], centre); `own` is that of the object with all that it carries beside the level above.
    """

    pivot: wp.vec3
    own: wp.vec4
    load: wp.vec4
    middle: wp.vec2
    softness: wp.mat22  # lean [rad] for each metre between the load's centre and `middle`
    margin: float
    sink: float
    lean: wp.vec2
    gap: float
    law: wp.vec4
    soft: float  # factor of its contacts' spring by the masses of its world


@wp.func
def weigh(
    program: Program,
    statics: Statics,
    obj: int,
    worldid: int,
    body_pos: wp.array[wp.vec3],
    body_quat: wp.array[wp.vec4],
    origin: wp.vec3,
) -> wp.vec4:
    """Return the weight [kg] of an object, and the sum of weights times places around `origin` [kg m]."""
    total = wp.vec4(0.0)
    for i in range(program.obj_bodynum[obj]):
        body = program.body_list[program.obj_bodyadr[obj] + i]
        row = worldid % statics.body_weight.shape[0]
        weight = statics.body_weight[row, body]
        at = apply(pose_of(body_pos[body], body_quat[body]), statics.body_center[row, body]) - origin
        total += wp.vec4(weight, weight * at[0], weight * at[1], weight * at[2])
    return total


@wp.func
def _lightness(program: Program, statics: Statics, obj: int, worldid: int) -> float:
    """Return the weight of an object in the model over that in a world, as inverse weights change by it."""
    weight = float(0.0)
    for i in range(program.obj_bodynum[obj]):
        weight += statics.body_weight[worldid, program.body_list[program.obj_bodyadr[obj] + i]]
    return statics.obj_weight[obj] / wp.max(weight, 1.0e-30)


@wp.func
def softness_of(program: Program, statics: Statics, obj: int, worldid: int) -> float:
    """Return the factor of the spring of an object's contacts by the masses of a world, its own and its carrier's."""
    if statics.obj_share.shape[0] == 0:
        return 1.0
    share = statics.obj_share[obj]
    soft = share * _lightness(program, statics, obj, worldid)
    if statics.obj_levelnum[obj] < 2:
        return soft + 1.0 - share
    carrier = statics.level_obj[statics.obj_leveladr[obj] + 1]
    return soft + (1.0 - share) * _lightness(program, statics, carrier, worldid)


@wp.func
def _widen(statics: Statics, points: wp.array[wp.vec2], num: int, best: wp.array[float], patch: wp.array[wp.vec2]):
    """Take a convex polygon into a patch: its corner in each direction is the one that is furthest along it."""
    k = int(0)
    for j in range(1, num):
        if wp.dot(points[j] - points[k], statics.direction[0]) > 0.0:
            k = j
    for i in range(statics.direction.shape[0] * wp.min(num, 1)):
        along = statics.direction[i]
        far = wp.dot(points[k], along)
        for _ in range(num):  # in all directions together once around
            ahead = wp.dot(points[(k + 1) % num], along)
            if ahead < far:
                break
            k = (k + 1) % num
            far = ahead
        if far > best[i]:
            best[i] = far
            patch[i] = points[k]


@wp.func
def _turn_foot(statics: Statics, foot: int, heading: float, points: wp.array[wp.vec2]) -> int:
    """Write the corners of one part of a foot at a heading, and return their number."""
    x = unit_circle(heading)
    num = statics.foot_cornernum[foot]
    for k in range(num):
        corner = statics.corner[statics.foot_corneradr[foot] + k]
        points[k] = corner[0] * x + corner[1] * wp.vec2(-x[1], x[0])
    return num


@wp.func
def _side(statics: Statics, number: int, ground: Pose) -> wp.vec4:
    """Return an edge of a part of a surface around the object's pivot: from x, y, to x, y."""
    ends = statics.side[number]
    a = apply(ground, wp.vec3(ends[0], ends[1], 0.0))
    b = apply(ground, wp.vec3(ends[2], ends[3], 0.0))
    return wp.vec4(a[0], a[1], b[0], b[1])


@wp.func
def _cut_foot(statics: Statics, part: int, ground: Pose, points: wp.array[wp.vec2], num: int) -> int:
    """Cut a part of a foot to one part of a surface, and return the number of corners that are left."""
    left = int(num)
    for s in range(statics.part_sidenum[part]):
        ends = _side(statics, statics.part_sideadr[part] + s, ground)
        if left > 0:
            outward = wp.vec2(ends[3] - ends[1], ends[0] - ends[2])
            left = clip(points, left, half_plane(outward, wp.vec2(ends[0], ends[1]), 0.0))
    return left


@wp.func
def _is_left(statics: Statics, variant: int, x: wp.vec2, ends: wp.vec4) -> bool:
    """Return True if all of a foot whose x axis is `x` is left of an edge."""
    a = wp.vec2(ends[0], ends[1])
    along = wp.vec2(ends[2], ends[3]) - a
    inward = wp.vec2(cross2(along, x), wp.dot(along, x))  # along the axes of the foot
    box = statics.variant_box[variant]
    least = wp.min(inward[0] * box[0], inward[0] * box[2]) + wp.min(inward[1] * box[1], inward[1] * box[3])
    if least > cross2(along, a):
        return True
    for f in range(statics.variant_footnum[variant]):
        foot = statics.variant_footadr[variant] + f
        for k in range(statics.foot_cornernum[foot]):
            corner = statics.corner[statics.foot_corneradr[foot] + k]
            if cross2(along, corner[0] * x + corner[1] * wp.vec2(-x[1], x[0]) - a) < 0.0:
                return False
    return True


@wp.func
def lies_on_a_part(statics: Statics, variant: int, heading: float, surface: int, ground: Pose) -> bool:
    """Return True if all of a foot is on one convex part of a surface; see `find_patch` for the arguments."""
    x = unit_circle(heading)
    for i in range(statics.surface_partnum[surface]):
        part = statics.surface_partadr[surface] + i
        inside = bool(True)
        s = int(0)
        while inside and s < statics.part_sidenum[part]:
            inside = _is_left(statics, variant, x, _side(statics, statics.part_sideadr[part] + s, ground))
            s += 1
        if inside:
            return True
    return False


@wp.func
def find_patch(
    statics: Statics,
    obj: int,
    variant: int,
    heading: float,
    surface: int,
    ground: Pose,
    patch: wp.array[wp.vec2],
) -> int:
    """Write the corners of an object's patch, and return their number; 0 if none of its foot is on the surface.

    Args:
        statics: The feet and contacts of all objects.
        obj: The object.
        variant: Its variant.
        heading: Its heading [rad].
        surface: The surface that it stands on.
        ground: The pose of that surface's body, around the object's pivot.
        patch: The corners [m], around the pivot, counter-clockwise, shape (`MOST_CORNERS`,).
    """
    foot = statics.variant_footadr[variant]
    parts = statics.surface_partnum[surface] * statics.variant_footnum[variant]
    is_plain = statics.obj_four[obj] or statics.foot_cornernum[foot] <= FEW_CORNERS
    num = int(0)
    if statics.obj_whole[obj]:
        num = _turn_foot(statics, foot, heading, patch)
    elif is_plain and parts == 1:
        num = _turn_foot(statics, foot, heading, patch)
        num = _cut_foot(statics, statics.surface_partadr[surface], ground, patch, num)
    else:
        num = _join_parts(statics, variant, heading, surface, ground, patch)
    if statics.obj_four[obj] and num > 4:
        num = _take_four(patch, num)
    return num


@wp.func
def _join_parts(
    statics: Statics, variant: int, heading: float, surface: int, ground: Pose, patch: wp.array[wp.vec2]
) -> int:
    """Write the corners of a patch in several parts, those furthest in each direction; return their number."""
    best = wp.zeros(shape=(wp.static(MOST_DIRECTIONS),), dtype=float)
    points = wp.zeros(shape=(wp.static(MOST_CORNERS),), dtype=wp.vec2)
    for i in range(statics.direction.shape[0]):
        best[i] = -1.0e30
    parts = statics.surface_partnum[surface]
    feet = statics.variant_footnum[variant]
    for i in range(feet):
        foot = statics.variant_footadr[variant] + i
        least = float(0.0)
        if feet > 1:
            least = _SLIVER * area(points, _turn_foot(statics, foot, heading, points))
        on = float(0.0)
        for k in range(2 * parts):  # first how much of it is on the surface, then where
            left = _turn_foot(statics, foot, heading, points)
            left = _cut_foot(statics, statics.surface_partadr[surface] + k % parts, ground, points, left)
            if k < parts:
                on += area(points, left)
            elif on >= least:
                _widen(statics, points, left, best, patch)
    if best[0] == -1.0e30:
        return 0
    return statics.direction.shape[0]


@wp.func
def _take_four(patch: wp.array[wp.vec2], num: int) -> int:
    """Keep the four corners of a patch that span the largest area, as MuJoCo does of many contacts; return 4."""
    four = wp.zeros(shape=(4,), dtype=wp.vec2)
    most = float(-1.0)
    for i in range(num - 2):
        a = patch[i]
        left = int(i + 3)
        right = int(i + 1)
        for k in range(i + 2, num):
            diagonal = patch[k] - a
            while right + 1 < k and cross2(diagonal, patch[right + 1] - a) <= cross2(diagonal, patch[right] - a):
                right += 1
            left = wp.max(left, k + 1)
            while left + 1 < num + i and cross2(diagonal, patch[(left + 1) % num] - a) >= cross2(
                diagonal, patch[left % num] - a
            ):
                left += 1
            size = cross2(diagonal, patch[left % num] - a) - cross2(diagonal, patch[right] - a)
            if size > most:
                most = size
                four[0] = a
                four[1] = patch[right]
                four[2] = patch[k]
                four[3] = patch[left % num]
    for i in range(4):
        patch[i] = four[i]
    return 4


@wp.func
def measure(statics: Statics, level: Level, obj: int, variant: int, patch: wp.array[wp.vec2], num: int) -> Level:
    """Return a level with what the `num` corners of its patch say: its middle, its softness, the margin of its load."""
    at = wp.vec2(level.load[1], level.load[2])
    middle = wp.vec2(0.0)
    for i in range(num):
        middle += patch[i] / float(num)
    xx = float(0.0)
    xy = float(0.0)
    yy = float(0.0)
    corners = int(0)
    margin = float(1.0e30)
    inner = float(1.0e30)
    before = patch[num - 1]
    for i in range(num):
        after = patch[i]
        r = after - middle
        xx += r[0] * r[0]
        xy += r[0] * r[1]
        yy += r[1] * r[1]
        side = after - before
        if wp.length_sq(side) > 1.0e-12:
            corners += 1
            side = wp.normalize(side)
            margin = wp.min(margin, cross2(side, at - before))
            inner = wp.min(inner, cross2(side, middle - before))
        before = after
    if statics.obj_four[obj] and statics.foot_cornernum[statics.variant_footadr[variant]] > FEW_CORNERS:
        margin = wp.min(margin, inner - wp.length(at - middle))  # any four around it
    if corners < 3:
        margin = -1.0
    level.middle = middle
    level.margin = margin
    level.sink = _sink(statics.obj_spring[obj], level.soft * level.load[0] / float(wp.clamp(corners, 1, 8)))
    size = level.law[3] * float(num) * level.sink / wp.max(xx * yy - xy * xy, 1.0e-30)
    level.softness = size * wp.mat22(yy, -xy, -xy, xx)
    if statics.variant_curved[variant]:  # it rolls as it leans, and stays wherever it does not roll off
        level.softness = wp.mat22(0.0, 0.0, 0.0, 0.0)
        level.law = wp.vec4(0.0, 0.0, level.law[2], 1.0)
    return level


@wp.func
def _sink(spring: wp.vec4, load: float) -> float:
    """Return the depth [m] at which one contact carries a load [kg]; see `Stance.spring`."""
    depth = float(0.0)
    for _ in range(FEW_CORNERSS):
        x = wp.min(depth / spring[3], 1.0)
        share = wp.where(x < 0.5, 2.0 * x * x, 1.0 - 2.0 * (1.0 - x) * (1.0 - x))
        d = spring[1] + share * (spring[2] - spring[1])
        depth = 0.5 * (depth + spring[0] * load * (1.0 - d) / (d * d))
    return depth


@wp.func
def _leans(level: Level, off: wp.vec2) -> wp.vec2:
    """Return the lean [rad] of a load whose centre is `off` [m] from the middle of its patch.

    Beyond `far` = 1 a corner of a rectangle is lifted, so that the load rests on three.
    """
    lean = level.softness * off
    far = wp.sqrt(2.0 * wp.max(wp.dot(lean, off), 0.0) / wp.max(level.sink, 1.0e-30))
    return lean * wp.max(1.0, 3.0 - 2.0 / wp.max(far, 1.0e-3))


@wp.func
def loads_stand(levels: wp.array[Level], num: int) -> bool:
    """Return True if the loads of all levels stay on their patches as these give way; the lowest level is the last."""
    moved = wp.zeros(shape=(wp.static(MAX_LEVELS),), dtype=wp.vec2)
    shift = wp.zeros(shape=(wp.static(MAX_LEVELS),), dtype=wp.vec2)
    for _ in range(_PASSES):
        lean = wp.vec2(0.0)
        base = wp.vec2(0.0)
        for k in range(num):
            j = num - 1 - k
            if k > 0:
                base += (levels[j].pivot[2] - levels[j + 1].pivot[2]) * lean
            lean += levels[j].lean
            shift[j] = base
            moved[j] = base + levels[j].own[3] * lean
        load = wp.vec2(0.0)
        for j in range(num):
            level = levels[j]
            load += level.own[0] * moved[j]
            off = load / wp.max(level.load[0], 1.0e-30) - shift[j]
            shift[j] = off
            level.lean = _leans(level, wp.vec2(level.load[1], level.load[2]) + off - level.middle)
            levels[j] = level
    fall = float(0.0)
    drop = float(0.0)
    move = float(1.0)
    lean = wp.vec2(0.0)
    for k in range(num):
        j = num - 1 - k
        level = levels[j]
        fall += level.gap + level.sink
        lean += level.lean
        move = wp.min(move, level.law[2])
        drop += wp.dot(level.lean, wp.vec2(level.load[1], level.load[2]) - level.middle)
        share = level.law[0] + level.law[1] * wp.length(level.lean)
        needed = share * wp.sqrt(wp.max(fall * level.load[3], 0.0))
        if not (level.margin - wp.length(shift[j]) > needed) or level.sink > _SINK:
            return False
    drop += fall
    return drop * drop + wp.dot(moved[0], moved[0]) < move * move and wp.length(lean) < _LEAN
