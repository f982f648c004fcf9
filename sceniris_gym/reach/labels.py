"""Labels of a reachability map: for a pose, the number of base and wrist rotations at which the arm reaches it.

A base rotation turns the pose about the first axis, and a wrist rotation turns it about the approach axis. If the first
or the last joint turns by the same angle, the arm reaches the rotated pose. Each pose is therefore solved once, without
limits of these two joints. For each solution, the rotations are then marked at which both joints are within limits.
"""

import math
from dataclasses import replace

import numpy as np
import warp as wp

from sceniris_gym.device.transforms import unit_circle
from sceniris_gym.reach.arm import SerialArm, rotate
from sceniris_gym.reach.lookup import JointTurn, turned
from sceniris_gym.reach.solve import ITERATIONS, ArmView, arm_view, as_vec8, random_joints, refine, vec8

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TURNS = 16
"""Number of base rotations in a label, and number of wrist rotations for each base rotation."""
ALL_TURNS = TURNS * TURNS
_POS_TOL, _ROT_TOL = 5.0e-4, math.radians(0.25)  # largest errors of a reached pose [m, rad]
_STEP = wp.constant(2.0 * math.pi / TURNS)
_vec4l = wp.types.vector(length=4, dtype=wp.uint64)


@wp.func
def _covered(turn: JointTurn, angle: float) -> wp.uint64:
    """Return a bit for each of TURNS rotations: 1 if a joint at `angle` is within its limits after this rotation."""
    bits = wp.uint64(0)
    for i in range(TURNS):
        if turned(turn, angle + turn.sign * _STEP * float(i)) <= turn.upper:
            bits = bits | (wp.uint64(1) << wp.uint64(i))
    return bits


@wp.func
def _count(marks: _vec4l) -> int:
    return wp.bit_count(marks[0]) + wp.bit_count(marks[1]) + wp.bit_count(marks[2]) + wp.bit_count(marks[3])


@wp.func
def _with_turns(marks: _vec4l, bases: wp.uint64, wrists: wp.uint64) -> _vec4l:
    """Mark each pair of a base rotation in `bases` and a wrist rotation in `wrists`. Marks have one bit per pair."""
    for i in range(4):
        for j in range(4):
            if ((bases >> wp.uint64(4 * i + j)) & wp.uint64(1)) != wp.uint64(0):
                marks[i] |= wrists << wp.uint64(16 * j)
    return marks


@wp.func
def _last_joint(q: vec8, njoint: int) -> float:
    last = float(0.0)
    for j in range(8):
        if j == njoint - 1:
            last = q[j]
    return last


@wp.kernel
def _label(
    # Arm:
    arm: ArmView,
    base: JointTurn,
    wrist: JointTurn,
    axis_xy: wp.vec2,
    # In:
    coords: wp.array[wp.vec4],
    warm: wp.array2d[vec8],
    starts: wp.array[vec8],
    iterations: int,
    pos_tol: float,
    rot_tol: float,
    # Out:
    count_out: wp.array[int],
    joints_out: wp.array[vec8],
):
    poseid = wp.tid()
    c = coords[poseid]  # z, tilt, u, v
    pos = wp.vec3(axis_xy[0] + c[2], axis_xy[1] + c[3], c[0])
    lean = unit_circle(0.5 * c[1])
    quat = wp.vec4(lean[0], 0.0, lean[1], 0.0)
    marks = _vec4l()
    total = int(0)
    found = vec8()
    nwarm = warm.shape[1]
    start = int(0)
    while start < nwarm + starts.shape[0] and total < ALL_TURNS:
        q0 = starts[wp.max(start - nwarm, 0)]
        if start < nwarm:
            q0 = warm[poseid, start]
        if q0[0] == q0[0]:  # NaN: no start
            result = refine(arm, pos, quat, q0, iterations)
            if result.pos_err < pos_tol and result.rot_err < rot_tol:
                wrists = _covered(wrist, _last_joint(result.q, arm.njoint))
                marks = _with_turns(marks, _covered(base, result.q[0]), wrists)
                if _count(marks) > total:
                    total = _count(marks)
                    found = result.q
        start += 1
    count_out[poseid] = total
    joints_out[poseid] = found


class Labeller:
    """Labels poses of an arm, given by the four coordinates of a map, by inverse kinematics.

    Args:
        arm: The arm, with a vertical first axis and the TCP on its last axis.
        device: Warp's name of the device.
        starts: Number of random starts of the inverse kinematics. A start is an array of joint positions.
        seed: Seed of the starts.
    """

    def __init__(self, arm: SerialArm, device: str, *, starts: int, seed: int) -> None:
        self.device, (self.base, self.wrist) = device, end_turns(arm)
        lower, upper = arm.lower.copy(), arm.upper.copy()
        lower[[0, -1]], upper[[0, -1]] = -np.inf, np.inf
        free = replace(arm, lower=lower, upper=upper)
        self._starts = wp.array(as_vec8(random_joints(free, starts, seed)), dtype=vec8, device=device)
        self._arm = arm_view(free, device)
        self._axis_xy = wp.vec2(*map(float, arm.axis_xy))

    def label(
        self, coords: np.ndarray, warm: np.ndarray | None = None, *, first: int = 0, count: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Label poses.

        Args:
            coords: Poses as z [m], tilt [rad], u, v [m], shape (N, 4).
            warm: Starts to try before the random starts, shape (N, K, njoint). Starts with NaN are skipped.
            first: Index of the first random start to try.
            count: Number of random starts to try, or None for all from `first` on.

        Returns:
            The labels, from 0 to ALL_TURNS, shape (N,), and joint positions that reach each pose, shape (N, 8). The
            joint positions of a pose with label 0 are 0.
        """
        n = len(coords)
        filled = as_vec8(np.zeros((n, 0, 1)) if warm is None else warm)
        with wp.ScopedDevice(self.device):
            turns, joints = wp.zeros(n, dtype=int), wp.zeros(n, dtype=vec8)
            last = self._starts.shape[0] if count is None else first + count
            arm = [self._arm, self.base, self.wrist, self._axis_xy]
            poses = wp.array(np.ascontiguousarray(coords, np.float32), dtype=wp.vec4)
            starts = [wp.array(filled, dtype=vec8, shape=filled.shape[:2]), self._starts[first:last]]
            inputs = [*arm, poses, *starts, ITERATIONS, _POS_TOL, _ROT_TOL]
            wp.launch(_label, dim=n, inputs=inputs, outputs=[turns, joints])
        return turns.numpy(), joints.numpy()


def end_turns(arm: SerialArm) -> tuple[JointTurn, JointTurn]:
    """Return the limits and the signs of the first and the last joint.

    The sign of the first joint is positive if its axis points up. The sign of the last joint is positive if its axis
    points along the approach axis.
    """
    up = rotate(arm.axis[0], arm.link_quat[0])[2]
    along = rotate(np.array([0.0, 0.0, 1.0]), arm.link_quat[-1]) @ arm.axis[-1]
    return _turn(arm, 0, up), _turn(arm, -1, along)


def _turn(arm: SerialArm, joint: int, sign: float) -> JointTurn:
    free, turn = arm.turns_freely(joint), JointTurn()  # pyrefly: ignore[missing-argument]
    turn.lower, turn.upper = (-np.pi, 2.0 * np.pi) if free else (float(arm.lower[joint]), float(arm.upper[joint]))
    turn.sign = 1.0 if sign > 0.0 else -1.0
    return turn
