"""Feet, contacts and loads as device code reads them. They exist only if some object of the scene may fall.

Here, the *levels* of an object are the stack from this object down: the object, the free object that carries it, and so
on down to a free object on a support that stays in place.
"""

import warp as wp

DIRECTIONS = 16
"""Number of directions whose furthest points are the corners of a patch (the part of a foot on its support)."""
MOST_MOVE = 6.5e-3
"""Greatest move [m] of an object until it is at rest."""
RISE = 0.9
"""Fraction of the margin h tan(a / 2) that a curved foot needs, with the height h of the centre of mass.

At this margin, a lean by the angle a begins to raise the centre of mass. An object that does not rise rolls away.
"""
ROLL = 2.2
"""Distance [m per rad] that a ball rolls down a slope in 0.8 s from rest. In a second it rolls 1.5 times as far."""
LawVector = wp.types.vector(length=7, dtype=float)
"""The numbers of a `program.standing.Law`."""


@wp.struct
class Statics:
    """The feet, contacts and loads of the objects of a scene. They do not change after `compile_scene`.

    If the scene draws masses, each generator of layouts has a copy with a row of body weights for each world.
    """

    direction: wp.array[wp.vec2]  # `DIRECTIONS`, counter-clockwise

    # Objects in placement order, and the stable poses of `Program`.
    obj_leveladr: wp.array[int]
    obj_levelnum: wp.array[int]  # 0 if it needs no test
    obj_give: wp.array[float]  # sink for each kilogram of load [m/kg], if masses are drawn
    obj_tilt: wp.array[float]  # tangent of the greatest angle by which gravity and wind pull away from straight down
    obj_touch: wp.array[float]  # distance at which its support begins to carry it [m]
    stable_footadr: wp.array[int]
    stable_footnum: wp.array[int]
    stable_law: wp.array[LawVector]  # see `Law`
    stable_center: wp.array[wp.vec2]  # around the pivot, at heading 0, as in `Roll`
    stable_axis: wp.array[wp.vec2]
    stable_reach: wp.array[wp.vec2]
    stable_radius: wp.array[float]  # of its foot around its pivot, or 1e30 if the foot needs a test even on one part
    foot_corneradr: wp.array[int]  # a foot has convex parts
    foot_cornernum: wp.array[int]
    corner: wp.array[wp.vec2]  # around the pivot, at heading 0, counter-clockwise

    # Levels, starting with the object itself: the object of each, and its loads that are not levels above.
    level_obj: wp.array[int]
    level_sink: wp.array[float]  # [m], under the greatest load that includes the object itself, 0 if masses are drawn
    level_loadadr: wp.array[int]
    level_loadnum: wp.array[int]
    load: wp.array[int]

    # Convex parts of the surfaces of `Program`: the ends of their edges, counter-clockwise. A surface that keeps every
    # foot whole has one part without edges.
    surface_partadr: wp.array[int]
    surface_partnum: wp.array[int]
    part_sideadr: wp.array[int]
    part_sidenum: wp.array[int]
    side: wp.array[wp.vec4]  # from x, y, to x, y, in the frame of the body

    # Bodies.
    body_weight: wp.array2d[float]  # mass under gravity [kg], a row for all worlds or for each
    body_center: wp.array2d[wp.vec3]  # of mass, in the body's frame
