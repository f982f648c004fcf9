"""`PositionActuators` set the targets of an arm's joints. `Fingers` describe a hand and its actuators."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.errors import ArmError
from sceniris_gym.grasping.gripper import finger_joints
from sceniris_gym.reach.arm import joined_bodies, joint_label
from sceniris_gym.scene.couplings import active_equalities, driven_by, follow
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import subtree
from sceniris_gym.sim.rest import CTRL_HOLDS, affine_law, rest_map
from sceniris_gym.sim.versions import actuator_controls, actuator_outputs
from sceniris_gym.vector.readings import as_columns
from sceniris_gym.vector.state import State

# Smallest motion of a finger across the approach axis [m] that counts as opening or closing.
_STILL = 1e-4
# Largest part of a force limit that a target of `within_force` may need. A force at the limit would begin to swing.
_FORCE_PART = 0.9
# A joint is light if a time step at full force changes its speed by this many times F / kv, with the force limit F and
# the speed gain kv. The limit of its targets allows changes of F / kv in a control step, which should be quick [rad/s].
_JUMPS, _QUICK = 3.0, 0.2
# A change of an actuator's length that is smaller than this [m or rad] is rounding.
_SAME = 1e-9


class PositionActuators:
    """The position actuators of some joints, one for each joint. Names, gears and tendons do not matter.

    The control `bias + scale * q` holds a joint at the position q (see `rest_map`).

    Args:
        mjm: The model.
        joints: Ids of the joints.
        device: Torch device.
        where: The beginning of error messages.

    Attributes:
        lower, upper: Limits of the targets [rad or m], shape (njoint,). They are within the limits of the controls and
            of the joints.
        lag: Time by which a joint without inertia follows its target [s], shape (njoint,): (kv g^2 + d) / (kp g^2) for
            the joint's damping d and an actuator of gear g.

    Raises:
        ArmError: A joint does not have exactly one position actuator that drives only this joint.
    """

    def __init__(self, mjm: mujoco.MjModel, joints: Sequence[int], device: torch.device, where: str) -> None:
        def tensor(values: np.ndarray) -> Tensor:
            return torch.tensor(values, dtype=torch.float32, device=device)

        rest = rest_map(mjm, np.zeros(mjm.nu), np.zeros(mjm.na), "cpu")
        (constants, matrix), controls, columns = affine_law(rest, mjm.nq), [], mjm.jnt_qposadr[list(joints)]
        alone = np.count_nonzero(matrix[: mjm.nu], axis=1) == 1
        owner = np.repeat(np.arange(len(mjm.actuator_trntype)), actuator_controls(mjm)[1])
        for joint, column in zip(joints, columns, strict=True):
            found = np.flatnonzero(alone & (matrix[: mjm.nu, column] != 0.0)).tolist()
            _check_number(mjm, joint, [int(owner[e]) for e in found], where)
            controls += found
        self._mjm, self._joints, self._actuators = mjm, list(joints), owner[controls]
        self._scale, bias = matrix[controls, columns], constants[controls]
        limits = np.array([rest.lower.numpy()[controls], rest.upper.numpy()[controls]])
        ends = np.sort((limits - bias) / self._scale, axis=0)
        limited = mjm.jnt_limited[self._joints].astype(bool)[:, None]
        own = np.where(limited, mjm.jnt_range[self._joints], [-np.inf, np.inf]).T
        self.lower, self.upper = tensor(np.maximum(ends[0], own[0])), tensor(np.minimum(ends[1], own[1]))
        self._columns, self._ids = as_columns(controls, device), as_columns(self._actuators.tolist(), device)
        self._law = tensor(bias), tensor(self._scale)
        kp, self._speed_gain = -mjm.actuator_biasprm[self._actuators, 1:3].T
        self._stiffness, self._gear = kp, np.abs(self._scale * mjm.actuator_gainprm[self._actuators, 0] / kp)
        i, dofs, loss = self._actuators, mjm.jnt_dofadr[self._joints], self._speed_gain * self._gear
        self._force = np.where(mjm.actuator_forcelimited[i], mjm.actuator_forcerange[i, 1], np.inf)
        light = (loss * self._gear * mjm.opt.timestep > _JUMPS * mjm.dof_M0[dofs]) & (_QUICK * loss < self._force)
        self._damping = mjm.dof_damping[dofs]
        self.lag = (self._damping / self._gear**2 + self._speed_gain) / self._stiffness
        unlimited = np.where(light & np.isfinite(self._force), 0.0, np.inf)
        servo = -(self._gear**2), self._speed_gain / kp, _FORCE_PART * self._gear, unlimited
        self._servo = [tensor(values) for values in servo]

    def targets(self, ctrl: Tensor) -> Tensor:
        """Return the joint targets [rad or m] that `ctrl` (num_envs, nu) sets, shape (num_envs, njoint)."""
        bias, scale = self._law
        return (ctrl[:, self._columns] - bias) / scale

    def set_targets(self, ctrl: Tensor, targets: Tensor) -> None:
        """Clip the targets (num_envs, njoint) to their limits, and write their controls into `ctrl` (num_envs, nu)."""
        bias, scale = self._law
        ctrl[:, self._columns] = bias + scale * targets.clamp(self.lower, self.upper)

    def full_leads(self, speed: np.ndarray) -> np.ndarray:
        """Return how far joints lag behind their targets at full force and speed [rad or m], shape (njoint,).

        At full speed, the joint's damping d balances the full torque T, so the speed is v = T / d. With the gear g from
        joint to actuator, the actuator's force is T / g = kp g lead - kv g v, which gives lead = T / (kp g^2) + kv v /
        kp. Without a force limit of the joint or the actuator, the lead is infinite.

        Args:
            speed: The full speed to use for joints without damping [rad/s or m/s], shape (njoint,).
        """
        limited, limits = self._mjm.jnt_actfrclimited[self._joints], self._mjm.jnt_actfrcrange[self._joints, 1]
        torque = np.minimum(self._force * self._gear, np.where(limited, limits, np.inf))
        with np.errstate(divide="ignore", invalid="ignore"):
            speed = np.where(self._damping > 0.0, torque / self._damping, speed)
            lag = np.where(self._speed_gain > 0.0, self._speed_gain * speed / self._stiffness, 0.0)
        return torque / (self._stiffness * self._gear**2) + lag

    def gains(self, rate: float, dt: float) -> np.ndarray:
        """Return how far targets have to lead, per distance to go, to approach it at a rate [1/s], shape (njoint,).

        In a control step of `dt` [s], a joint without inertia covers the part 1 - exp(-dt / lag) of the way to its
        target.
        """
        return np.expm1(-rate * dt) / np.expm1(-dt / np.maximum(self.lag, 1e-9))

    def bearing(self, s: State) -> Tensor | float:
        """Return how far targets are off the joints that bear an arm's weight [rad or m], shape (num_envs, njoint).

        The weight is that of each world's masses and gravity in the present pose, less the part that `gravcomp` bears.
        """
        fields, (bias, scale) = s._batch.fields, self._law
        if not fields.bears:
            return 0.0
        fields.launch_holding(None)
        return (wp.to_torch(fields.rest.law)[:, self._columns, 0] - bias) / scale

    def within_force(self, s: State, targets: Tensor, qpos: Tensor, qvel: Tensor) -> Tensor:
        """Return targets that need less than the actuators' force limits if joints are light.

        MuJoCo's implicit integrators leave out the derivative of a force at its limit F. If a time step at full force
        changes the speed by more than 2 F / kv, the range of speeds at which the force is below its limit, the joint
        may jump across this range, and the force then changes sign in each step.

        Args:
            s: The worlds, whose gains and force limits count.
            targets: Targets [rad or m], shape (num_envs, njoint).
            qpos: Positions of the joints [rad or m], of the same shape.
            qvel: Velocities of the joints [rad/s or m/s], of the same shape.
        """
        square, lag, part, unlimited = self._servo
        stiffness = square * s._field("actuator_biasprm")[:, self._ids, 1]
        reach = torch.addcmul(unlimited, part, s._field("actuator_forcerange")[:, self._ids, 1]) / stiffness
        free = torch.addcmul(qpos, lag, qvel)
        return targets.clamp(free - reach, free + reach)


def _check_number(mjm: mujoco.MjModel, joint: int, found: Sequence[int], where: str) -> None:
    """Check that exactly one position actuator was found for a joint."""
    if len(found) == 1:
        return
    name = mjm.joint(joint).name
    if found:
        names = ", ".join(repr(mjm.actuator(i).name or i) for i in found)
        has = f"has {len(found)}: {names}. Keep one of them."
    else:
        add = "Add" if name else "Name the joint, and add"
        has = f"has none. {add} <position joint='{name or '...'}' kp='...' ctrlrange='...'/>."
    raise ArmError(f"{where}: {joint_label(mjm, joint)} should have one separate position actuator, but {has}")


class Fingers(NamedTuple):
    """The fingers of a hand. Actuators move them directly at a joint, through a tendon, or through joint equalities.

    Attributes:
        joints: Ids of the first joint of each finger. Joints further along a finger are left out.
        closed_qpos: Positions of these joints when the hand is closed [m or rad], shape (njoint,).
        width: Sideways motion of each finger per unit of its joint [m/m or m/rad], shape (njoint,). It is the mean over
            the way from closed to open, at the finger's geom nearest to the TCP. It is negative if the finger closes as
            the joint position grows. None for linkages, because a `connect` or a `weld` moves their fingers.
        controls: Columns of the actuators in `ctrl`, ascending.
        closed: Controls that close the hand, shape (ncontrol,).
        opened: Controls that open the hand, shape (ncontrol,).
    """

    joints: tuple[int, ...]
    closed_qpos: np.ndarray
    width: np.ndarray | None
    controls: list[int]
    closed: np.ndarray
    opened: np.ndarray

    @classmethod
    def find(cls, scene: SceneModel, tcp: int, arm: Sequence[int]) -> Fingers | None:
        """Find the fingers beyond the last joint of an arm. Return None if no actuator opens and closes a finger.

        A hand opens as its fingers move away from the approach axis, which is the z axis of the TCP.

        Args:
            scene: The scene. Its start pose sets the joints outside the fingers.
            tcp: Id of the site that is the tool centre point.
            arm: Ids of the arm's joints, from base to tip.
        """
        mjm, home, couplings, hand = scene.mjm, scene.home_qpos, scene.couplings, _below(scene.mjm, arm[-1])
        data, closed, opened, width = mujoco.MjData(mjm), home.copy(), home.copy(), {}
        for joint, ends in finger_joints(mjm, hand, mjm.jnt_qposadr[list(arm)], couplings, home).items():
            driven, poses = driven_by(couplings, [joint]), np.array([home, home])
            poses[:, mjm.jnt_qposadr[joint]] = ends
            follow(driven, poses)
            places, lengths = zip(*(_seen(mjm, data, tcp, qpos) for qpos in poses), strict=True)
            bodies = {j: _below(mjm, j) for j in (joint, *(c.follower for c in driven))}
            geoms = np.isin(mjm.geom_bodyid, [b for below in bodies.values() for b in below])
            moved = np.linalg.norm((places[1] - places[0])[:, :2], axis=1)
            if np.ptp(lengths, axis=0).max(initial=0.0) < _SAME or moved[geoms].max(initial=0.0) < _STILL:
                continue
            inner, outer = np.argsort([np.linalg.norm(place[geoms, :2], axis=1).sum() for place in places])
            for j, below in bodies.items():
                adr = mjm.jnt_qposadr[j]
                closed[adr], opened[adr] = poses[inner, adr], poses[outer, adr]
                if not any(mjm.jnt_bodyid[j] in others[1:] for others in bodies.values()):
                    own = np.flatnonzero(np.isin(mjm.geom_bodyid, below))
                    nearest = own[np.linalg.norm(places[inner][own], axis=1).argsort()[:1]]
                    width[j] = moved[nearest].sum() / ((opened[adr] - closed[adr]) or np.inf)
        (_, short), (_, long) = (_seen(mjm, data, tcp, qpos) for qpos in (closed, opened))
        controls = {}
        for i in np.flatnonzero(np.abs(long - short)[actuator_outputs(mjm)] > _SAME).tolist():
            ends = _ends(mjm, i, *(float(lengths[actuator_outputs(mjm)[i]]) for lengths in (short, long)))
            if np.isfinite(ends).all():
                controls[int(actuator_controls(mjm)[0][i])] = ends
        if not controls:
            return None
        joints = tuple(sorted(width))
        linked = any(not set(joined_bodies(mjm, eq)).isdisjoint(hand) for eq in active_equalities(mjm))
        widths = None if linked else np.array([width[j] for j in joints])
        closed_qpos = closed[mjm.jnt_qposadr[list(joints)]]
        return cls(joints, closed_qpos, widths, list(controls), *np.transpose(list(controls.values())))


def _below(mjm: mujoco.MjModel, joint: int) -> list[int]:
    """Return the bodies that a joint moves."""
    return subtree(mjm, int(mjm.jnt_bodyid[joint]))


def _seen(mjm: mujoco.MjModel, data: mujoco.MjData, tcp: int, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of all geoms in the TCP's frame [m], (ngeom, 3), and all actuator lengths, at `qpos`."""
    data.qpos[:] = qpos
    for stage in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon, mujoco.mj_transmission):
        stage(mjm, data)
    axes = data.site_xmat[tcp].reshape(3, 3)
    return (data.geom_xpos - data.site_xpos[tcp]) @ axes, data.actuator_length.copy()


def _ends(mjm: mujoco.MjModel, actuator: int, short: float, long: float) -> tuple[float, float]:
    """Return an actuator's controls that close and open a hand, or two NaN if the actuator has no fixed gain.

    For a position actuator, these controls hold its lengths `short` (closed) and `long` (open). For any other actuator,
    they are the ends of its control range, or infinite if it has no range.
    """
    control = actuator_controls(mjm)[0][actuator]
    low, high = mjm.actuator_ctrlrange[control] if mjm.actuator_ctrllimited[control] else (-np.inf, np.inf)
    gain, bias, slope = mjm.actuator_gainprm[actuator, 0], *mjm.actuator_biasprm[actuator, :2]
    if mjm.actuator_gaintype[actuator] != mujoco.mjtGain.mjGAIN_FIXED:
        return np.nan, np.nan
    if gain * slope < 0.0 and mjm.actuator_dyntype[actuator] in CTRL_HOLDS:
        closed, opened = np.clip([-(bias + slope * length) / gain for length in (short, long)], low, high)
        return closed, opened
    return (low, high) if gain * (long - short) > 0.0 else (high, low)
