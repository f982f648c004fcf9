"""Poses, quaternions, and functions of angles on the device.

Quaternions are in MuJoCo's order (w, x, y, z), stored in a `wp.vec4`. Warp's `wp.quat` is (x, y, z, w). Device code
here does not compute with it, so the two orders are never mixed up.

Sines, cosines, arc tangents, logarithms and exponentials have the same bits on every device. CUDA's functions and C
libraries differ in the last bit of a float. Regions clipped at small angles magnify this bit to tens of micrometres.
All kernels also switch `fuse_fp` off, because inverse kinematics magnifies the last bit to radians if an arm has
redundant joints. Only sums, products, quotients and square roots then remain, and IEEE 754 defines them to the bit.
"""

import math

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_TWO_OVER_PI = wp.constant(wp.float64(2.0 / math.pi))
_HALF_PI = wp.constant(wp.float64(0.5 * math.pi))
_ONE = wp.constant(wp.float64(1.0))
_LOG_2 = wp.constant(wp.float64(math.log(2.0)))

# Minimax polynomials on [-pi/4, pi/4], for results that are rounded to floats: sin r = r + r^3 (S1 + S2 r^2 + ...) and
# cos r = 1 + r^2 (C1 + C2 r^2 + ...). They come from Arm's "optimized routines", which glibc has used since 2.28, so
# layouts are the same as with `wp.sin` on a CPU.
_S1 = wp.constant(wp.float64(-0.16666654943701084))
_S2 = wp.constant(wp.float64(0.008332178146138854))
_S3 = wp.constant(wp.float64(-0.00019517298981385725))
_C1 = wp.constant(wp.float64(-0.49999999725108224))
_C2 = wp.constant(wp.float64(0.041666623324344516))
_C3 = wp.constant(wp.float64(-0.001388676379437604))
_C4 = wp.constant(wp.float64(2.4390450703564542e-05))

# atan(t) for t >= 0: near 0 it is t - t (E + O), with even and odd terms E and O. For larger t it is atan(c) plus the
# arc tangent of a small remainder, for c of 1/2, 1, 3/2 or infinity. From Sun's fdlibm, which glibc used up to 2.40.
_ATAN = wp.constant(wp.vec4(0.46364760399, 0.78539812565, 0.98279368877, 1.5707962513))
_ATAN_REST = wp.constant(wp.vec4(5.0121582440e-09, 3.7748947079e-08, 3.4473217170e-08, 7.5497894159e-08))
_UPRIGHT = wp.constant(2.0**25)
_PI = wp.constant(3.1415927410)
_PI_REST = wp.constant(-8.7422776573e-08)


# Not inlined: it has too many instructions for a copy at every use.
@wp.func(inline=False)
def unit_circle(angle: float) -> wp.vec2:
    """Return cosine and sine of an angle [rad], correct to 0.57 units in the last place for angles up to 100."""
    x = wp.float64(angle)
    turns = wp.rint(x * _TWO_OVER_PI)
    r = x - turns * _HALF_PI
    r2 = r * r
    r3 = r * r2
    r4 = r2 * r2
    sine = (r + r3 * _S1) + (r3 * r2) * (_S2 + r2 * _S3)
    cosine = ((_ONE + r2 * _C1) + r4 * _C2) + (r4 * r2) * (_C3 + r2 * _C4)
    quarter = int(turns) & 3
    c = float(wp.where((quarter & 1) == 0, cosine, sine))
    s = float(wp.where((quarter & 1) == 0, sine, cosine))
    return wp.vec2(wp.where(quarter == 1 or quarter == 2, -c, c), wp.where(quarter >= 2, -s, s))


@wp.func
def _atan(slope: float) -> float:
    """Return the arc tangent [rad] of a slope of at least 0."""
    if slope >= _UPRIGHT:
        return 0.5 * _PI
    t = slope
    part = int(-1)
    if slope >= 2.4375:
        part = 3
        t = -1.0 / slope
    elif slope >= 1.1875:
        part = 2
        t = (slope - 1.5) / (1.0 + 1.5 * slope)
    elif slope >= 0.6875:
        part = 1
        t = (slope - 1.0) / (slope + 1.0)
    elif slope >= 0.4375:
        part = 0
        t = (2.0 * slope - 1.0) / (2.0 + slope)
    z = t * t
    w = z * z
    even = z * (
        0.33333334327
        + w * (0.14285714924 + w * (0.090908870101 + w * (0.066610731184 + w * (0.049768779427 + w * 0.016285819933))))
    )
    odd = w * (
        -0.20000000298 + w * (-0.11111110449 + w * (-0.076918758452 + w * (-0.058335702866 + w * -0.036531571299)))
    )
    if part < 0:
        return t - t * (even + odd)
    return _ATAN[part] - ((t * (even + odd) - _ATAN_REST[part]) - t)


@wp.func(inline=False)
def angle_of(x: float, y: float) -> float:
    """Return the angle [rad] from the x axis to a vector, from -pi to pi, or 0 for the zero vector."""
    if y == 0.0:
        return wp.where(x < 0.0, _PI, y)
    angle = _atan(wp.abs(y / x))
    if x < 0.0:
        angle = _PI - (angle - _PI_REST)
    return wp.where(y < 0.0, -angle, angle)


@wp.func(inline=False)
def log_of(x: float) -> float:
    """Return the natural logarithm of a normal positive number, correct to 0.51 units in the last place."""
    power = (wp.cast(x, int) - 0x3F3504F3) >> 23  # of 2, so that m is from sqrt(1/2) to sqrt(2)
    m = wp.float64(wp.cast(wp.cast(x, int) - (power << 23), float))
    t = (m - _ONE) / (m + _ONE)
    tail = wp.float64(0.0)
    for k in range(6):  # log m = 2 (t + t^3 / 3 + t^5 / 5 + ...)
        tail = tail * t * t + wp.float64(2.0) / wp.float64(11 - 2 * k)
    return float(wp.float64(power) * _LOG_2 + t * tail)


@wp.func(inline=False)
def exp_of(x: float) -> float:
    """Return the exponential of a number from -700 to 700, correct to 0.51 units in the last place."""
    power = wp.rint(wp.float64(x) / _LOG_2)  # of 2
    rest = wp.float64(x) - power * _LOG_2
    series = _ONE
    for k in range(10):
        series = _ONE + series * rest / wp.float64(10 - k)
    return float(series * wp.cast((wp.int64(power) + wp.int64(1023)) << wp.int64(52), wp.float64))


@wp.func
def mul_quat(a: wp.vec4, b: wp.vec4) -> wp.vec4:
    """Return the Hamilton product of two wxyz quaternions."""
    return wp.vec4(
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@wp.func
def neg_quat(q: wp.vec4) -> wp.vec4:
    """Return the inverse of a unit wxyz quaternion."""
    return wp.vec4(q[0], -q[1], -q[2], -q[3])


@wp.func
def rot_vec_quat(v: wp.vec3, q: wp.vec4) -> wp.vec3:
    """Return `v` rotated by the unit wxyz quaternion `q`."""
    u = wp.vec3(q[1], q[2], q[3])
    t = 2.0 * wp.cross(u, v)
    return v + q[0] * t + wp.cross(u, t)


@wp.func
def z_axis(q: wp.vec4) -> wp.vec3:
    """Return the z axis of a frame with the unit wxyz orientation `q`."""
    return wp.vec3(
        2.0 * (q[1] * q[3] + q[0] * q[2]),
        2.0 * (q[2] * q[3] - q[0] * q[1]),
        1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2]),
    )


@wp.func
def turn_z(q: wp.vec4, angle: float) -> wp.vec4:
    """Return orientation `q` after a further rotation by `angle` [rad] about the z axis of the rotated frame."""
    to = unit_circle(0.5 * angle)
    c = to[0]
    s = to[1]
    return wp.vec4(q[0] * c - q[3] * s, q[1] * c + q[2] * s, q[2] * c - q[1] * s, q[3] * c + q[0] * s)


@wp.func
def rotation_vector(q: wp.vec4) -> wp.vec3:
    """Return axis times angle [rad] of the unit wxyz quaternion `q`, with an angle from 0 to pi."""
    v = wp.vec3(q[1], q[2], q[3])
    w = q[0]
    if w < 0.0:
        v = -v
        w = -w
    s = wp.length(v)
    return wp.where(s > 1.0e-6, 2.0 * angle_of(w, s) / s, 2.0) * v


@wp.struct
class Pose:
    """A rigid pose: `x = pos + rot @ y` maps a point y of the posed frame to its parent frame."""

    pos: wp.vec3
    rot: wp.mat33


@wp.func
def quat_z(angle: float) -> wp.vec4:
    """Return the quaternion of a rotation by `angle` [rad] about z."""
    to = unit_circle(0.5 * angle)
    return wp.vec4(to[0], 0.0, 0.0, to[1])


@wp.func
def axis_angle_quat(axis: wp.vec3, angle: float) -> wp.vec4:
    """Return the quaternion of a rotation by `angle` [rad] about the unit vector `axis`."""
    to = unit_circle(0.5 * angle)
    return wp.vec4(to[0], axis[0] * to[1], axis[1] * to[1], axis[2] * to[1])


@wp.func
def quat_mat(q: wp.vec4) -> wp.mat33:
    """Return the rotation matrix of the unit wxyz quaternion `q`."""
    w = q[0]
    x = q[1]
    y = q[2]
    z = q[3]
    return wp.mat33(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


@wp.func
def pose_of(pos: wp.vec3, quat: wp.vec4) -> Pose:
    """Return the pose with position `pos` and unit wxyz orientation `quat`."""
    return Pose(pos, quat_mat(quat))


@wp.func
def compose(a: Pose, b: Pose) -> Pose:
    """Convert the pose `b` from the frame of `a` to the parent frame of `a`."""
    return Pose(a.pos + a.rot * b.pos, a.rot * b.rot)


@wp.func
def relative(a: Pose, b: Pose) -> Pose:
    """Convert the pose `b` to the frame of `a`. `a` and `b` have the same parent frame."""
    at = wp.transpose(a.rot)
    return Pose(at * (b.pos - a.pos), at * b.rot)


@wp.func
def apply(a: Pose, v: wp.vec3) -> wp.vec3:
    """Convert the point `v` from the frame of `a` to the parent frame of `a`."""
    return a.pos + a.rot * v
