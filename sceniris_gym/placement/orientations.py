"""`orientation`: draw a yaw, a stable pose or any rotation, and face another object.

Every orientation is a rotation with heading 0, which decides the pivot, the bounds and the lowest point, followed by a
yaw about the vertical. The heading of an object is the direction of its root's x axis, seen from above; where that axis
points straight up or down, it is the direction of its y axis minus 90 degrees.
"""

import math

import warp as wp

from sceniris_gym.device.angles import angle_of, unit_circle
from sceniris_gym.device.quaternions import mul_quat
from sceniris_gym.device.transforms import quat_mat, quat_z
from sceniris_gym.placement.placed import turned
from sceniris_gym.program.device import OrientationType, Program

# An x axis points straight up or down if its shadow is shorter than this, as in `scene/poses.py`.
_UPRIGHT = wp.constant(1.0e-3)
_TWO_PI = wp.constant(2.0 * math.pi)


@wp.struct
class DrawnVariant:
    """A drawn orientation of heading 0, its yaw [rad], and the pivot and bounds that an object has in it.

    `variant` is the number of the pose in `Program` from which it was drawn. `pivot` is in the root's frame [m].
    `bounds` is (low x, low y, high x, high y) around the pivot [m].
    """

    variant: int
    quat: wp.vec4
    yaw: float
    pivot: wp.vec3
    bounds: wp.vec4


@wp.func
def heading_of(quat: wp.vec4) -> float:
    """Return the heading [rad] of a root with orientation `quat`."""
    mat = quat_mat(quat)
    if wp.abs(mat[0, 0]) + wp.abs(mat[1, 0]) < _UPRIGHT:
        return angle_of(mat[1, 1], -mat[0, 1])
    return angle_of(mat[0, 0], mat[1, 0])


@wp.func
def _any_quat(u: wp.vec4) -> wp.vec4:
    """Return a uniform rotation. K. Shoemake, "Uniform random rotations", Graphics Gems III, 1992."""
    a = wp.sqrt(1.0 - u[0])
    b = wp.sqrt(u[0])
    first = unit_circle(_TWO_PI * u[1])
    second = unit_circle(_TWO_PI * u[2])
    return wp.vec4(b * second[0], a * first[1], a * first[0], b * second[1])


@wp.func
def draw_variant(program: Program, obj: int, u: wp.vec4, w: wp.vec4) -> DrawnVariant:
    """Draw an orientation from two draws of uniform numbers; of `u` only the first number is used."""
    variant = program.obj_variantadr[obj]
    last = variant + program.obj_variantnum[obj] - 1
    while variant < last and w[3] >= program.variant_cdf[variant]:
        variant += 1
    quat = program.variant_quat[variant]
    yaw = program.obj_yaw[obj][0] + u[0] * (program.obj_yaw[obj][1] - program.obj_yaw[obj][0])
    if program.obj_orientation[obj] == OrientationType.ANY:
        turn = _any_quat(w)
        yaw = heading_of(turn)
        quat = mul_quat(quat_z(-yaw), turn)
    return DrawnVariant(variant, quat, yaw, program.variant_pivot[variant], program.variant_bounds[variant])


@wp.func
def facing(at: wp.vec2, target: wp.vec2) -> float:
    """Return the heading [rad] that points an object's front (-y) from `at` to `target`."""
    d = turned(target - at, 0.5 * wp.static(math.pi))
    return angle_of(d[0], d[1])
