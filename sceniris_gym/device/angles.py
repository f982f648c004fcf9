"""Sines, cosines, arc tangents, logarithms and exponentials with the same bits on every device.

CUDA's functions and C libraries differ in the last bit of a float. Regions clipped at small angles magnify this bit to
tens of micrometres. All kernels also switch `fuse_fp` off, because inverse kinematics magnifies the last bit to radians
if an arm has redundant joints. Only sums, products, quotients and square roots then remain, and IEEE 754 defines them
to the bit.
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
