"""`stands`: test by statics on MuJoCo's soft contacts whether a candidate and all free objects below it stand.

The *load* of an object in a stack is this object and everything on it, each as a rigid body. The *patch* of an object
is the hull of the part of its foot on its support. The *margin* of a load is the distance of its centre of mass from
the edge of the patch, seen from above. Outside the patch, the margin is negative. A load stands if its margin exceeds a
limit, which depends on the coefficients in `Law`.

Contacts give way, as if each corner of the patch were a spring. A load sinks by d. If the centre of mass of the load is
e away from the centre of the patch, the load leans by d K^-1 e. Here K is the mean of the outer products of the patch's
corners around their mean. All objects above move with the load, so the leans are computed in several passes. For a
top-heavy stack, the leans do not converge. A load that falls by f until its support carries it is shaken by the
impact. Its margin therefore has to exceed t sqrt(f h). Here h is the height of its centre of mass above the foot, and
`Law.shake` and `Law.lean` determine t.

MuJoCo keeps four contacts of a face: the largest quadrilateral of its corners. If a round support has more corners, a
load near the rim is outside these four contacts, and tips until other contacts take over. This adds at most s sqrt(d h)
to the limit, where s is `Law.swap`.

A load on a curved foot may lean by an angle a. If its margin is above h tan(a / 2), this lean raises its centre of
mass, so the load rolls back. It rolls until its centre of mass is above the point of contact. With a radius of
curvature R, it rotates by (R v + e) / (R - h), where v is the lean of the object that carries it. Its centre of mass
moves by h times this angle, and then swings on by the same distance. If R is about h, the motion is slow.

The corners of a patch are the furthest points in each of 16 directions, so the hull of these corners is a little
smaller than the exact hull.
"""

import warp as wp

from sceniris_gym.config.bounds import MAX_FOOT, MAX_LEVELS
from sceniris_gym.device.transforms import Pose, apply, pose_of, unit_circle
from sceniris_gym.placement.polygons import HalfPlane, area, clip, cross2
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_statics import DIRECTIONS, MOST_MOVE, RISE, ROLL, LawVector, Statics

# A convex part of a support adds a corner for each of its sides.
_MOST_CORNERS = 2 * MAX_FOOT
_PASSES = 8
# A part of a foot counts if at least this fraction of its area is on the support. A smaller fraction has only one
# contact, which may be lost.
_SLIVER = wp.constant(0.5)
# The same fraction for a curved foot, which may have a piece at each end and a gap between them.
_ALL = wp.constant(0.99)
# The largest quadrilateral of corners of a circle leaves out 0.29 of its radius.
_LOST = wp.constant(0.35)
# The extent of a patch in each direction before the first corner is found.
_NO_CORNER = wp.constant(-1.0e30)
# Greatest move [m] of the uppermost object until it is at rest.
_MOVE = wp.constant(MOST_MOVE)


_Corners = wp.types.vector(length=DIRECTIONS, dtype=float)


@wp.struct
class Patch:
    """The corners of a patch [m], counter-clockwise: the furthest point in each direction."""

    x: _Corners
    y: _Corners


@wp.struct
class Level:
    """An object of a stack, with its load and its patch.

    Positions [m] are relative to the candidate's pivot, along the world's axes. `load` is the weight [kg] and the
    centre of mass (x, y, z) of the object and everything on it. For `own`, the next object above in the stack and
    everything on that next object are left out.
    """

    foot: float  # height of the foot
    own: wp.vec4
    load: wp.vec4
    middle: wp.vec2  # mean of the patch's corners
    softness: wp.mat22  # lean [rad] per metre between the load's centre and `middle`
    margin: float  # distance of the load's centre from the edge where contacts hold it, negative outside
    inner: float  # radius of the patch around `middle`
    sink: float  # depth of its contacts
    gap: float  # height of its fall until its support carries it
    lean: wp.vec2  # [rad]
    law: LawVector
    center: wp.vec2  # of the rectangle around a curved foot
    axis: wp.vec2  # first axis of the rectangle
    reach: wp.vec2  # half of its sides


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
    """Return the weight [kg] of an object, and the sum over its bodies of weight times centre of mass [kg m].

    The centres of mass are relative to `origin`.
    """
    total = wp.vec4(0.0)
    for i in range(program.obj_bodynum[obj]):
        body = program.body_list[program.obj_bodyadr[obj] + i]
        row = worldid % statics.body_weight.shape[0]
        weight = statics.body_weight[row, body]
        at = apply(pose_of(body_pos[body], body_quat[body]), statics.body_center[row, body]) - origin
        total += wp.vec4(weight, weight * at[0], weight * at[1], weight * at[2])
    return total


@wp.func
def _side(statics: Statics, number: int, ground: Pose) -> HalfPlane:
    """Return the half-plane on the inner side of edge `number`, an edge of a convex part of a surface."""
    ends = statics.side[number]
    a = apply(ground, wp.vec3(ends[0], ends[1], 0.0))
    b = apply(ground, wp.vec3(ends[2], ends[3], 0.0))
    return HalfPlane(wp.vec2(b[1] - a[1], a[0] - b[0]), wp.vec2(a[0], a[1]), 0.0)


@wp.func
def lies_on_a_part(statics: Statics, stable: int, at: wp.vec2, surface: int, ground: Pose) -> bool:
    """Return True if the circle around a foot lies on a single convex part of a surface.

    The circle is around the pivot `at` [m], seen from above. `stable` is the number of the object's stable pose, which
    determines the radius of the circle. `ground` is the pose of the body that has the surface.
    """
    for i in range(statics.surface_partnum[surface]):
        part = statics.surface_partadr[surface] + i
        nearest = float(1.0e30)
        for s in range(statics.part_sidenum[part]):
            side = _side(statics, statics.part_sideadr[part] + s, ground)
            nearest = wp.min(nearest, wp.dot(wp.normalize(side.normal), side.origin - at))
        if nearest > statics.stable_radius[stable]:
            return True
    return False


@wp.func
def find_patch(statics: Statics, stable: int, at: wp.vec2, heading: float, surface: int, ground: Pose):
    """Return the patch of an object, and whether its foot is on the surface.

    The patch is the hull of the part of the foot on the surface. If this part is too small, the foot counts as off the
    surface.

    Args:
        statics: The feet and contacts of all objects.
        stable: Number of the object's stable pose.
        at: Position of the object's pivot [m], seen from above.
        heading: Heading of the object [rad].
        surface: Number of the surface on which the object stands.
        ground: Pose of the body that has this surface.
    """
    # Fixed vectors stay in registers. With arrays, each direction would wait for a store of the direction before.
    patch = Patch()  # pyrefly: ignore[missing-argument]
    best = _Corners(_NO_CORNER)
    along_x = _Corners()
    along_y = _Corners()
    for d in range(DIRECTIONS):
        along_x[d] = statics.direction[d][0]
        along_y[d] = statics.direction[d][1]
    points = wp.zeros(shape=(wp.static(_MOST_CORNERS),), dtype=wp.vec2)
    x = unit_circle(heading)
    parts = statics.surface_partnum[surface]
    feet = statics.stable_footnum[stable]
    for i in range(feet * parts):
        foot = statics.stable_footadr[stable] + i // parts
        part = statics.surface_partadr[surface] + i % parts
        num = int(statics.foot_cornernum[foot])
        for k in range(num):
            corner = statics.corner[statics.foot_corneradr[foot] + k]
            points[k] = at + corner[0] * x + corner[1] * wp.vec2(-x[1], x[0])
        least = float(0.0)
        if feet > 1:
            least = _SLIVER * area(points, num)
        elif statics.stable_law[stable][5] > 0.0:
            least = _ALL * area(points, num)
        for s in range(statics.part_sidenum[part]):
            num = clip(points, num, _side(statics, statics.part_sideadr[part] + s, ground))
        if num > 0 and area(points, num) >= least:
            for k in range(num):
                point = points[k]
                for d in range(DIRECTIONS):
                    far = point[0] * along_x[d] + point[1] * along_y[d]
                    if far > best[d]:
                        best[d] = far
                        patch.x[d] = point[0]
                        patch.y[d] = point[1]
    return patch, best[0] > _NO_CORNER


@wp.func
def measure(level: Level, patch: Patch) -> Level:
    """Return `level` with the fields that describe its load on its patch: `middle`, `softness`, `margin` and `inner`.

    Args:
        level: An object of a stack, with the fields `load`, `law` and `sink`.
        patch: Its patch, from `find_patch`.
    """
    at = wp.vec2(level.load[1], level.load[2])
    middle = wp.vec2(0.0)
    for i in range(DIRECTIONS):
        middle += wp.vec2(patch.x[i], patch.y[i]) / float(DIRECTIONS)
    spread = wp.mat22(0.0)
    margin = float(1.0e30)
    inner = float(1.0e30)
    before = wp.vec2(patch.x[DIRECTIONS - 1], patch.y[DIRECTIONS - 1])
    for i in range(DIRECTIONS):
        after = wp.vec2(patch.x[i], patch.y[i])
        r = after - middle
        spread += wp.outer(r, r)
        side = after - before
        if wp.length_sq(side) > 1.0e-12:
            side = wp.normalize(side)
            margin = wp.min(margin, cross2(side, at - before))
            inner = wp.min(inner, cross2(side, middle - before))
        before = after
    margin = wp.min(margin, level.law[3] * inner - wp.length(at - middle))
    if inner > 1.0e29:  # a point
        margin = -1.0
    level.middle = middle
    level.margin = margin
    level.inner = inner
    size = level.law[2] * float(DIRECTIONS) * level.sink / wp.max(wp.determinant(spread), 1.0e-30)
    level.softness = size * wp.mat22(spread[1, 1], -spread[0, 1], -spread[0, 1], spread[0, 0])
    return level


@wp.func
def _leans(level: Level, off: wp.vec2) -> wp.vec2:
    """Return the lean [rad] of a load whose centre of mass is `off` [m] from the middle of its patch.

    If `off` is so large that a corner of a rectangular patch lifts, the load rests on the other three corners and leans
    further.
    """
    lean = level.softness * off
    far = wp.sqrt(2.0 * wp.max(wp.dot(lean, off), 0.0) / wp.max(level.sink, 1.0e-30))
    return lean * wp.max(1.0, 3.0 - 2.0 / wp.max(far, 1.0e-3))


@wp.func
def loads_stand(levels: wp.array[Level], num: int) -> bool:
    """Return True if all loads of a stack stay on their patches when contacts give way.

    If the candidate would move by `MOST_MOVE` or more until it is at rest, the result is False.

    Args:
        levels: The objects of the stack from the candidate down. The lowest object is last.
        num: Number of objects.
    """
    moved = wp.zeros(shape=(wp.static(MAX_LEVELS),), dtype=wp.vec2)
    shift = wp.zeros(shape=(wp.static(MAX_LEVELS),), dtype=wp.vec2)
    for _ in range(_PASSES):
        lean = wp.vec2(0.0)
        base = wp.vec2(0.0)
        for k in range(num):
            j = num - 1 - k
            if k > 0:
                base += (levels[j].foot - levels[j + 1].foot) * lean
            lean += levels[j].lean
            shift[j] = base
            moved[j] = base + (levels[j].own[3] - levels[j].foot) * lean
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
    roll = float(0.0)
    below = wp.vec2(0.0)  # the lean of the object's carrier
    for k in range(num):
        j = num - 1 - k
        level = levels[j]
        fall += level.gap + level.sink
        drop += wp.dot(level.lean, wp.vec2(level.load[1], level.load[2]) - level.middle)
        height = wp.max(level.load[3] - level.foot, 0.0)
        root = wp.sqrt(wp.max(fall * height, 0.0))
        swap = wp.min(level.law[4] * wp.sqrt(level.sink * height), _LOST * level.inner)
        share = level.law[0] + wp.max(level.law[1] * wp.length(level.lean), swap / wp.max(root, 1.0e-9))
        needed = share * root + level.law[5] * height
        if level.margin - wp.length(shift[j]) <= needed:
            return False
        if level.law[5] > 0.0:
            tan = level.law[5] / wp.static(RISE)
            eccentric = wp.vec2(level.load[1], level.load[2]) - level.center
            far = wp.vec2(0.0)
            for i in range(2):
                axis = level.axis
                if i == 1:
                    axis = wp.vec2(-axis[1], axis[0])
                reach = level.reach[i]
                rise = reach - height * tan
                if rise < level.law[6] * reach:
                    return False
                push = reach / tan * wp.abs(wp.dot(axis, below)) + wp.abs(wp.dot(axis, eccentric))
                far[i] = 2.0 * height * tan / wp.max(rise, 2.0 * height * reach / wp.static(ROLL)) * push
            roll += wp.length(far)
        below += level.lean
    drop += fall
    aside = wp.length(moved[0]) + roll
    return drop * drop + aside * aside < _MOVE * _MOVE
