"""Inverse kinematics on the device: damped least squares within joint limits, from given starts.

Each function runs in one thread, which keeps the whole arm in registers. Loops over joints are unrolled to MAX_JOINTS,
so that every index of a joint is a constant. Reachability maps and the reach stage of a reset share these
functions. `solve` runs them for a batch of poses.
"""

import math

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.device.transforms import mul_quat, neg_quat, rot_vec_quat, rotation_vector, turn_z, z_axis
from sceniris_gym.reach.arm import MAX_JOINTS, SerialArm, compose

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

POS_TOL = 1.0e-3
"""Largest position error [m] of an accepted solution."""
ROT_TOL = math.radians(0.5)
"""Largest orientation error [rad] of an accepted solution."""
# With these values the solver found all of 60,000 poses at random joints within limits, for a Panda, a UR5e, an arm
# without limits, a gantry with a wrist and a SCARA, in 6 to 20 us per pose on a CPU core (0.5 us per step). For a
# Panda, two in five starts converge. 10 to 14 steps are fastest: after that, a new start is better.
ITERATIONS = 14
"""Maximum number of steps from one start."""
RESTARTS = 64
"""Default number of starts for one pose."""

vec8 = wp.types.vector(length=MAX_JOINTS, dtype=float)
"""Joint positions [rad, m] of one arm, padded with zeros after `njoint` entries."""
mat83 = wp.types.matrix(shape=(MAX_JOINTS, 3), dtype=float)
_vec6 = wp.types.vector(length=6, dtype=float)
_mat86 = wp.types.matrix(shape=(MAX_JOINTS, 6), dtype=float)
_mat66 = wp.types.matrix(shape=(6, 6), dtype=float)

# The float32 kinematics of an arm of 1 m have an error of about 1 um. An accepted solution must also hold in float64.
_POS_ACCEPT = wp.constant(POS_TOL - 1.0e-5)
_ROT_ACCEPT = wp.constant(ROT_TOL - 1.0e-4)
# Steps end when both errors are below this value [m, rad], about the precision of float32.
_CONVERGED = wp.constant(1.0e-5)
# Weight of the rotation error [m/rad]: about half the length of an arm's links.
_LEVER = wp.constant(0.3)
# Damping is this fraction of the squared error: a far start takes careful steps, and a near start converges
# quadratically (T. Sugihara, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", IEEE
# Transactions on Robotics 27, 2011). The minimum damping keeps float32 stable in singular poses.
_DAMPING = wp.constant(0.1)
_LEAST_DAMPING = wp.constant(1.0e-6)
_LONGEST_STEP = wp.constant(1.0)
_PI = wp.constant(math.pi)


@wp.struct
class ArmView:
    """An arm on the device. Joints slide along or rotate about z of their frames. Link poses have joints at 0."""

    njoint: int
    link_pos: wp.array[wp.vec3]  # njoint + 1 links: from each joint's frame to the next, and from the last to the TCP
    link_quat: wp.array[wp.vec4]
    slide: wp.array[int]
    lower: wp.array[float]
    upper: wp.array[float]


@wp.struct
class IkResult:
    """Joint positions within limits, and how far their TCP is from the requested pose: position [m], rotation [rad]."""

    q: vec8
    pos_err: float
    rot_err: float


def arm_view(arm: SerialArm, device: str) -> ArmView:
    """Copy an arm to a device. Limits are rounded inwards, so that float32 joints are also within the exact limits."""
    pos, quat = _along_z(arm)
    lower, upper = arm.lower.astype(np.float32), arm.upper.astype(np.float32)
    lower = np.where(lower < arm.lower, np.nextafter(lower, np.float32(np.inf)), lower)
    upper = np.where(upper > arm.upper, np.nextafter(upper, np.float32(-np.inf)), upper)
    view = ArmView()  # pyrefly: ignore[missing-argument]
    view.njoint = len(arm.joints)
    view.link_pos = wp.array(pos, dtype=wp.vec3, device=device)
    view.link_quat = wp.array(quat, dtype=wp.vec4, device=device)
    view.slide = wp.array(arm.slide, dtype=int, device=device)
    view.lower = wp.array(lower, dtype=float, device=device)
    view.upper = wp.array(upper, dtype=float, device=device)
    return view


def _along_z(arm: SerialArm) -> tuple[np.ndarray, np.ndarray]:
    """Convert an arm's links to joint frames whose z axis is the joint axis. `ref` becomes part of the next link."""
    n = len(arm.joints)
    pos, quat = np.zeros((n + 1, 3)), np.zeros((n + 1, 4))
    at, rotation = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])  # the arm's joint frame in the frame used here
    for i in range(n + 1):
        pos[i], quat[i] = compose(at, rotation, arm.link_pos[i], arm.link_quat[i])
        if i < n:
            up, back = np.zeros(4), np.zeros(4)
            mujoco.mju_quatZ2Vec(up, arm.axis[i])
            mujoco.mju_mulQuat(quat[i], quat[i].copy(), up)
            mujoco.mju_axisAngle2Quat(back, [0.0, 0.0, 1.0], 0.0 if arm.slide[i] else -arm.ref[i])
            mujoco.mju_negQuat(up, up.copy())
            mujoco.mju_mulQuat(rotation, back, up)
            at = np.array([0.0, 0.0, -arm.ref[i] if arm.slide[i] else 0.0])
    return pos, quat


@wp.func
def turns_freely(view: ArmView, i: int) -> bool:
    """Return whether joint `i` is a hinge without limits."""
    return view.slide[i] == 0 and view.upper[i] - view.lower[i] > 1.0e30


@wp.func
def frames(view: ArmView, q: vec8):
    """Return the TCP position and orientation, and the origins and axes of all joints, in the base frame."""
    origin = mat83()
    axis = mat83()
    pos = view.link_pos[0]
    quat = view.link_quat[0]
    for i in range(MAX_JOINTS):
        if i < view.njoint:
            z = z_axis(quat)
            for k in range(3):
                origin[i, k] = pos[k]
                axis[i, k] = z[k]
            if view.slide[i] != 0:
                pos += q[i] * z
            else:
                quat = turn_z(quat, q[i])
            pos += rot_vec_quat(view.link_pos[i + 1], quat)
            quat = mul_quat(quat, view.link_quat[i + 1])
    return pos, wp.normalize(quat), origin, axis


@wp.func
def forward(view: ArmView, q: vec8):
    """Return the TCP position [m] and orientation (wxyz) in the base frame at joints `q`."""
    pos, quat, _origin, _axis = frames(view, q)
    return pos, quat


@wp.func
def _solve_positive(a: _mat66, b: _vec6) -> _vec6:
    """Solve a x = b by Cholesky for a symmetric positive definite `a`. Only the lower triangle of `a` is read.

    Warp unrolls a loop only if its bounds are constants or counters of unrolled loops. A bound such as j + 1 is
    neither, so these loops cover all indices, and an `if` inside selects the needed ones.
    """
    low = a
    x = b
    for j in range(6):
        d = low[j, j]
        for k in range(j):
            d -= low[j, k] * low[j, k]
        inv = 1.0 / wp.sqrt(wp.max(d, 1.0e-12))
        low[j, j] = inv
        for i in range(6):
            if i > j:
                s = low[i, j]
                for k in range(j):
                    s -= low[i, k] * low[j, k]
                low[i, j] = s * inv
    for i in range(6):
        s = x[i]
        for k in range(i):
            s -= low[i, k] * x[k]
        x[i] = s * low[i, i]
    for i in range(5, -1, -1):
        s = x[i]
        for k in range(6):
            if k > i:
                s -= low[k, i] * x[k]
        x[i] = s * low[i, i]
    return x


@wp.func
def _descend(view: ArmView, q: vec8, origin: mat83, axis: mat83, pos: wp.vec3, dpos: wp.vec3, drot: wp.vec3) -> vec8:
    """Take one damped step from `q` to reduce the pose error (dpos, drot). Joints do not move beyond their limits."""
    e = _vec6(dpos[0], dpos[1], dpos[2], _LEVER * drot[0], _LEVER * drot[1], _LEVER * drot[2])
    col = _mat86()
    damping = _DAMPING * wp.dot(e, e) + _LEAST_DAMPING
    a = _mat66()
    for r in range(6):
        a[r, r] = damping
    for i in range(MAX_JOINTS):
        if i < view.njoint:
            z = wp.vec3(axis[i, 0], axis[i, 1], axis[i, 2])
            lin = z
            ang = wp.vec3(0.0)
            if view.slide[i] == 0:
                lin = wp.cross(z, pos - wp.vec3(origin[i, 0], origin[i, 1], origin[i, 2]))
                ang = _LEVER * z
            c = _vec6(lin[0], lin[1], lin[2], ang[0], ang[1], ang[2])
            down = wp.dot(c, e)
            at_lower = q[i] <= view.lower[i] and down < 0.0
            at_upper = q[i] >= view.upper[i] and down > 0.0
            if not at_lower and not at_upper:
                for r in range(6):
                    col[i, r] = c[r]
                    for k in range(6):
                        if k <= r:
                            a[r, k] += c[r] * c[k]
    y = _solve_positive(a, e)
    step = vec8()
    for i in range(MAX_JOINTS):
        for r in range(6):
            step[i] += col[i, r] * y[r]
    longest = wp.max(wp.max(step), -wp.min(step))
    if longest > _LONGEST_STEP:
        step = step * (_LONGEST_STEP / longest)
    for i in range(MAX_JOINTS):
        if i < view.njoint:
            q[i] = wp.clamp(q[i] + step[i], view.lower[i], view.upper[i])
    return q


@wp.func
def refine(view: ArmView, pos: wp.vec3, quat: wp.vec4, q0: vec8, iterations: int) -> IkResult:
    """Move joints from `q0` until the TCP reaches a pose in the base frame, for at most `iterations` steps.

    Hinges without limits are returned in [-pi, pi], all other joints within their limits.
    """
    q = vec8()
    for i in range(MAX_JOINTS):
        if i < view.njoint:
            q[i] = wp.clamp(q0[i], view.lower[i], view.upper[i])
    result = IkResult()  # pyrefly: ignore[missing-argument]
    k = int(0)
    while k <= iterations:
        at, rotation, origin, axis = frames(view, q)
        dpos = pos - at
        drot = rotation_vector(mul_quat(quat, neg_quat(rotation)))
        result.pos_err = wp.length(dpos)
        result.rot_err = wp.length(drot)
        if k == iterations or wp.max(result.pos_err, result.rot_err) < _CONVERGED:
            k = iterations
        else:
            q = _descend(view, q, origin, axis, at, dpos, drot)
        k += 1
    for i in range(MAX_JOINTS):
        if i < view.njoint:
            if turns_freely(view, i):
                q[i] -= 2.0 * _PI * wp.round(q[i] / (2.0 * _PI))
    result.q = q
    return result


@wp.func
def accepted(result: IkResult) -> bool:
    """Return whether the pose errors are below POS_TOL and ROT_TOL, each reduced by a margin for float32."""
    return result.pos_err < _POS_ACCEPT and result.rot_err < _ROT_ACCEPT


@wp.func
def closer(a: IkResult, b: IkResult) -> IkResult:
    """Return the better result: an accepted result before others, then the one closer to the pose, then `a`."""
    result = a
    if accepted(b) == accepted(a):
        if b.pos_err + _LEVER * b.rot_err < a.pos_err + _LEVER * a.rot_err:
            result = b
    elif accepted(b):
        result = b
    return result


def random_joints(arm: SerialArm, num: int, seed: int = 0) -> np.ndarray:
    """Draw joint positions uniformly within limits, or from -pi to pi without limits, shape (num, njoint)."""
    lower = np.where(np.isfinite(arm.lower), arm.lower, -np.pi)
    upper = np.where(np.isfinite(arm.upper), arm.upper, np.pi)
    return np.random.default_rng(seed).uniform(lower, upper, (num, len(arm.joints)))


def as_vec8(joints: np.ndarray) -> np.ndarray:
    """Pad joints (..., njoint) with zeros to (..., MAX_JOINTS), float32, for the device."""
    unused = [(0, 0)] * (joints.ndim - 1) + [(0, MAX_JOINTS - joints.shape[-1])]
    return np.pad(joints.astype(np.float32), unused)


@wp.kernel
def _solve(
    # Arm:
    arm: ArmView,
    # In:
    pos: wp.array[wp.vec3],
    quat: wp.array[wp.vec4],
    starts: wp.array[vec8],
    iterations: int,
    # Out:
    joints_out: wp.array[vec8],
    ok_out: wp.array[bool],
):
    poseid = wp.tid()
    best = refine(arm, pos[poseid], quat[poseid], starts[0], iterations)
    start = int(1)
    while start < starts.shape[0] and not accepted(best):
        best = closer(best, refine(arm, pos[poseid], quat[poseid], starts[start], iterations))
        start += 1
    if accepted(best):
        best = closer(best, refine(arm, pos[poseid], quat[poseid], best.q, iterations))
    joints_out[poseid] = best.q
    ok_out[poseid] = accepted(best)


def solve(
    arm: SerialArm,
    poses: np.ndarray,
    device: str = "cpu",
    *,
    starts: np.ndarray | None = None,
    restarts: int = RESTARTS,
    iterations: int = ITERATIONS,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Find joint positions for TCP poses. For each pose, starts are tried one after the other until one succeeds.

    Args:
        arm: The arm.
        poses: TCP poses in the base frame, shape (N, 7): position [m] and wxyz quaternion.
        device: Warp's name of the device.
        starts: Start joints, tried in this order for every pose, shape (K, njoint). If None, starts are random.
        restarts: Number of random starts, uniform within limits.
        iterations: Maximum number of steps from each start.
        seed: Seed of the random starts.

    Returns:
        For each pose, the joints within limits [rad, m] that bring the TCP closest to it, shape (N, njoint), and
        whether the TCP is within POS_TOL and ROT_TOL of the pose, shape (N,).
    """
    poses = np.asarray(poses, np.float64).reshape(-1, 7)
    first = random_joints(arm, restarts, seed) if starts is None else np.asarray(starts)
    quat = poses[:, 3:] / np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    with wp.ScopedDevice(device):
        joints = wp.zeros(len(poses), dtype=vec8)
        ok = wp.zeros(len(poses), dtype=bool)
        wanted = [wp.array(poses[:, :3], dtype=wp.vec3), wp.array(quat, dtype=wp.vec4)]
        inputs = [arm_view(arm, device), *wanted, wp.array(as_vec8(first), dtype=vec8), iterations]
        wp.launch(_solve, dim=len(poses), inputs=inputs, outputs=[joints, ok])
    return joints.numpy()[:, : len(arm.joints)], ok.numpy()
