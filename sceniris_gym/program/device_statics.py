"""Feet, contacts and loads as device code reads them; only scenes with objects that may fall have them.

The *levels* of an object are itself, the free object that carries it, and so on down to one that stands on something
which cannot move.
"""

import warp as wp

DIRECTIONS = 16
"""Number of directions in which patches are measured."""
MOST_MOVE = 6.5e-3
"""Greatest move [m] of an object until it is at rest."""
RISE = 0.9
"""Share of the rise after a lean that is enough on a curved foot: what neither rises nor falls rolls."""
ROLL = 2.2
"""How far [m per rad] a ball rolls down a slope in 0.8 s, from rest; in a second it gets 1.5 times as far."""
LawVector = wp.types.vector(length=7, dtype=float)
"""The numbers of a `program.standing.Law`."""


@wp.struct
class Statics:
    """The feet, contacts and loads of the objects of a scene; never written after `compile_scene`.

    Where the scene draws masses, generators have copies in which bodies have a row for each world.
    """

    direction: wp.array[wp.vec2]  # `DIRECTIONS`, counter-clockwise

    # Objects in placement order, and the stable poses of `Program`.
    obj_leveladr: wp.array[int]
    obj_levelnum: wp.array[int]  # 0: it needs no test
    obj_give: wp.array[float]  # sink for each kilogram of load [m/kg], where masses are drawn
    obj_tilt: wp.array[float]  # tangent of the angle by which it may be pulled away from straight down
    obj_touch: wp.array[float]  # distance from which on its support carries it [m]
    stable_footadr: wp.array[int]
    stable_footnum: wp.array[int]
    stable_law: wp.array[LawVector]  # see `Law`
    stable_center: wp.array[wp.vec2]  # around the pivot, at heading 0; see `Roll`
    stable_axis: wp.array[wp.vec2]
    stable_reach: wp.array[wp.vec2]
    stable_radius: wp.array[float]  # of its foot around its pivot; 1e30 if that does not hold it by itself
    foot_corneradr: wp.array[int]  # a foot has convex parts
    foot_cornernum: wp.array[int]
    corner: wp.array[wp.vec2]  # around the pivot, at heading 0, counter-clockwise

    # Levels, the object itself first: the object of each, and the others that it carries beside the levels above.
    level_obj: wp.array[int]
    level_sink: wp.array[float]  # [m], under the greatest load with the object itself on it; 0 where masses are drawn
    level_loadadr: wp.array[int]
    level_loadnum: wp.array[int]
    load: wp.array[int]

    # Convex parts of the surfaces of `Program`: the ends of their edges, counter-clockwise; none where no foot leaves.
    surface_partadr: wp.array[int]
    surface_partnum: wp.array[int]
    part_sideadr: wp.array[int]
    part_sidenum: wp.array[int]
    side: wp.array[wp.vec4]  # from x, y, to x, y, in the frame of the body

    # Bodies.
    body_weight: wp.array2d[float]  # mass that gravity acts on [kg], a row for all worlds or for each
    body_center: wp.array2d[wp.vec3]  # of mass, in the body's frame
