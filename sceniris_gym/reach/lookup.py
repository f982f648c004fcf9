"""Looks up TCP poses in a reachability map, on the device.

Maps are for arms with a vertical first axis and a last joint that rotates about the approach axis. The verdict does not
change if the target rotates about the first axis or about the approach axis. Four of six coordinates remain
(M. Rudorfer, "RM4D: A Combined Reachability and Inverse Reachability Map for Common 6-/7-axis Robot Arms by
Dimensionality Reduction to 4D", 2024): the height, the tilt of the approach axis, and the horizontal position (u, v).
The u axis is the horizontal direction of the approach axis.
"""

import math

import warp as wp

from sceniris_gym.config.tier import Verdict
from sceniris_gym.device.transforms import angle_of, mul_quat, neg_quat, unit_circle, z_axis
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.reach.solve import vec8

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


POLE_TILT = math.radians(0.1)
"""For an approach axis this close to the vertical [rad], the lookup uses only height and radius."""

_TURN = wp.constant(2.0 * math.pi)
_POLE_SINE = wp.constant(math.sin(POLE_TILT))
# A four-bit code combines the label of a corner with the distance to the nearest change of label along the grid's axes.
# The label is the number of base and wrist rotations that reach the corner. See CODE_VALUES in map.py.
MOST_NEVER = wp.constant(5)
"""Codes from 0 to this value mark corners that are never reached."""
LEAST_ALWAYS = wp.constant(10)
"""Codes from this value to 15 mark corners that are reached in every rotation of base and wrist."""

vec8h = wp.types.vector(length=MAX_JOINTS, dtype=wp.float16)
"""Joint positions of a witness, in half precision."""


@wp.struct
class JointTurn:
    """The first or last joint of an arm: its limits [rad], and its sign.

    To rotate the TCP by an angle about the vertical or the approach axis, the joint turns by `sign * angle`.
    """

    lower: float
    upper: float
    sign: float


@wp.struct
class MapView:
    """A reachability map on the device: a code for each corner of a grid, as in `map.CODE_VALUES`.

    Corners are stored in rows along v. For one (z, u), the rows of all tilts have the same limits and are stored in
    sequence. The code of corner (iz, it, iu, iv) has the index `row[0] + it * row[2] + iv - row[1]`, where
    `row = rows[iz * nu + iu]` is (address, first iv, length). Each row begins and ends with a corner that is never
    reached. All corners outside the rows are out of reach.
    """

    axis_x: float  # intersection of the first axis with z = 0 [m]
    axis_y: float
    # Grid:
    nz: int
    ntilt: int
    nu: int
    z_low: float
    u_low: float  # the same for v
    per_meter: float
    per_radian: float
    rows: wp.array[wp.vec3i]
    codes: wp.array[wp.uint32]  # eight per word, the first in the lowest bits
    values: wp.array[float]  # signed distances of the 16 codes
    # Poles, approach axis up and down: codes by (pole, z, radius), packed in the same way:
    pole_nz: int
    pole_nr: int
    pole_z_low: float
    pole_per_meter: float
    poles: wp.array[wp.uint32]
    # Witnesses:
    wit_nz: int
    wit_ntilt: int
    wit_nu: int
    wit_per_meter: float
    wit_per_radian: float
    wit_cells: wp.array[wp.vec2i]  # (address, number) by (z, tilt, u, v)
    wit_joints: wp.array[vec8h]
    home: vec8
    njoint: int
    base: JointTurn
    wrist: JointTurn


@wp.func
def turned(turn: JointTurn, angle: float) -> float:
    """Return the smallest angle [rad] at or above the lower limit that equals `angle` modulo full rotations."""
    return angle + _TURN * wp.ceil((turn.lower - angle) / _TURN - 1.0e-6)


@wp.func
def _code(words: wp.array[wp.uint32], n: int) -> int:
    return int((words[n >> 3] >> wp.uint32(4 * (n & 7))) & wp.uint32(15))


@wp.func
def _decide(least: int, most: int, value: float) -> int:
    """Return the verdict on a pose from the smallest and largest code of its cell and the interpolated distance."""
    verdict = int(Verdict.MIXED_NO)
    if most <= MOST_NEVER:
        verdict = Verdict.NO
    elif least >= LEAST_ALWAYS:
        verdict = Verdict.YES
    elif value >= 0.0:
        verdict = Verdict.MIXED_YES
    return verdict


@wp.func
def _pole_verdict(view: MapView, z: float, radius: float, pole: int) -> int:
    fz = (z - view.pole_z_low) * view.pole_per_meter
    fr = radius * view.pole_per_meter
    verdict = int(Verdict.NO)
    if fz >= 0.0 and fr >= 0.0 and fz < float(view.pole_nz - 1) and fr < float(view.pole_nr - 1):
        iz = int(wp.floor(fz))
        ir = int(wp.floor(fr))
        dz = fz - float(iz)
        dr = fr - float(ir)
        least = int(15)
        most = int(0)
        value = float(0.0)
        k = int(0)
        while k < 4:
            a = k >> 1
            b = k & 1
            code = _code(view.poles, (pole * view.pole_nz + iz + a) * view.pole_nr + ir + b)
            weight = wp.where(a == 1, dz, 1.0 - dz) * wp.where(b == 1, dr, 1.0 - dr)
            k += 1
            least = wp.min(least, code)
            most = wp.max(most, code)
            value += weight * view.values[code]
        verdict = _decide(least, most, value)
    return verdict


@wp.func
def _cell_verdict(view: MapView, z: float, tilt: float, u: float, v: float) -> int:
    fz = (z - view.z_low) * view.per_meter
    ft = tilt * view.per_radian
    fu = (u - view.u_low) * view.per_meter
    fv = (v - view.u_low) * view.per_meter
    iz = int(wp.floor(fz))
    iu = int(wp.floor(fu))
    iv = int(wp.floor(fv))
    it = wp.clamp(int(wp.floor(ft)), 0, view.ntilt - 2)  # 180 degrees is the end of the last cell
    verdict = int(Verdict.NO)
    if iz >= 0 and iu >= 0 and iz < view.nz - 1 and iu < view.nu - 1:
        dz = fz - float(iz)
        dt = ft - float(it)
        du = fu - float(iu)
        dv = fv - float(iv)
        least = int(15)
        most = int(0)
        value = float(0.0)
        k = int(0)
        while k < 4:  # Warp does not unroll `while`: smaller placing kernels are faster on an H200
            a = k >> 1
            b = k & 1
            row = view.rows[(iz + a) * view.nu + iu + b]
            at = iv - row[1]
            weight = wp.where(a == 1, dz, 1.0 - dz) * wp.where(b == 1, du, 1.0 - du)
            k += 1
            if at >= 0 and at < row[2] - 1:
                n = row[0] + it * row[2] + at
                c = int(0)
                while c < 2:
                    low = _code(view.codes, n)
                    high = _code(view.codes, n + 1)
                    n += row[2]
                    share = weight * wp.where(c == 1, dt, 1.0 - dt)
                    c += 1
                    value += share * ((1.0 - dv) * view.values[low] + dv * view.values[high])
                    least = wp.min(least, wp.min(low, high))
                    most = wp.max(most, wp.max(low, high))
            else:
                least = int(0)
                value += weight * view.values[0]
        verdict = _decide(least, most, value)
    return verdict


@wp.func
def map_verdict(view: MapView, pos: wp.vec3, approach: wp.vec3) -> int:
    """Return the Verdict on a TCP position [m] and a unit approach axis (TCP +z), both in the base frame.

    The verdict is NO outside the map.
    """
    x = pos[0] - view.axis_x
    y = pos[1] - view.axis_y
    side = wp.sqrt(approach[0] * approach[0] + approach[1] * approach[1])
    verdict = int(Verdict.NO)
    if side < _POLE_SINE:
        verdict = _pole_verdict(view, pos[2], wp.sqrt(x * x + y * y), wp.where(approach[2] > 0.0, 0, 1))
    else:
        c = approach[0] / side
        s = approach[1] / side
        tilt = angle_of(approach[2], side)  # exact near the poles, where acos is not
        verdict = _cell_verdict(view, pos[2], tilt, c * x + s * y, c * y - s * x)
    return verdict


@wp.func
def witness(view: MapView, pos: wp.vec3, quat: wp.vec4, k: int) -> vec8:
    """Return joint positions from which inverse kinematics can start for a TCP pose in the base frame.

    Each coarse cell of the map has witnesses, which are solutions of grid corners in the cell. The result is witness
    `k` of the cell that contains the pose, with `k` modulo the number of witnesses. The first and last joint of this
    witness are turned to match the pose. If the cell has no witness, the result is the arm's start pose, with the first
    joint turned towards the target.
    """
    approach = z_axis(quat)
    x = pos[0] - view.axis_x
    y = pos[1] - view.axis_y
    side = wp.sqrt(approach[0] * approach[0] + approach[1] * approach[1])
    azimuth = float(0.0)
    if side > 1.0e-6:
        azimuth = angle_of(approach[0], approach[1])
    tilt = angle_of(approach[2], side)
    ahead = unit_circle(azimuth)
    c = ahead[0]
    s = ahead[1]
    iz = int(wp.floor((pos[2] - view.z_low) * view.wit_per_meter))
    it = wp.clamp(int(wp.floor(tilt * view.wit_per_radian)), 0, view.wit_ntilt - 1)
    iu = int(wp.floor((c * x + s * y - view.u_low) * view.wit_per_meter))
    iv = int(wp.floor((c * y - s * x - view.u_low) * view.wit_per_meter))
    q = view.home
    found = int(0)
    if iz >= 0 and iu >= 0 and iv >= 0 and iz < view.wit_nz and iu < view.wit_nu and iv < view.wit_nu:
        cell = view.wit_cells[((iz * view.wit_ntilt + it) * view.wit_nu + iu) * view.wit_nu + iv]
        if cell[1] > 0:
            found = int(1)
            half = view.wit_joints[cell[0] + k % cell[1]]
            for i in range(MAX_JOINTS):
                q[i] = float(half[i])
    if found == 0:
        q[0] = turned(view.base, view.base.sign * angle_of(x, y))
    else:
        lean = unit_circle(0.5 * tilt)
        half_way = unit_circle(0.5 * azimuth)
        back = mul_quat(
            wp.vec4(lean[0], 0.0, -lean[1], 0.0),
            mul_quat(neg_quat(wp.vec4(half_way[0], 0.0, 0.0, half_way[1])), quat),
        )
        roll = 2.0 * angle_of(back[0], back[3])
        q[0] = turned(view.base, q[0] + view.base.sign * azimuth)
        for i in range(1, MAX_JOINTS):
            if i == view.njoint - 1:
                q[i] = turned(view.wrist, q[i] + view.wrist.sign * roll)
    return q


@wp.kernel
def _look_up(
    # Map:
    view: MapView,
    # In:
    pos: wp.array[wp.vec3],
    approach: wp.array[wp.vec3],
    # Out:
    verdict_out: wp.array[wp.uint8],
):
    poseid = wp.tid()
    verdict_out[poseid] = wp.uint8(map_verdict(view, pos[poseid], approach[poseid]))


def look_up(view: MapView, pos: wp.array, approach: wp.array, verdict_out: wp.array) -> None:
    """Fill `verdict_out` (N,) uint8 with a `Verdict` for each TCP position [m] and unit approach axis, base frame."""
    wp.launch(_look_up, dim=pos.shape[0], inputs=[view, pos, approach], outputs=[verdict_out], device=pos.device)
