"""`Fingers`: the joints that open and close a hand, and the controls that move them, by MuJoCo's own kinematics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from sceniris_gym.grasping.gripper import finger_joints
from sceniris_gym.program.couplings import joined_bodies
from sceniris_gym.scene.couplings import active_equalities, driven_by, follow
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import subtree
from sceniris_gym.sim.rest import CTRL_HOLDS
from sceniris_gym.sim.versions import actuator_controls, actuator_outputs

# Fingers that move by less [m] across the approach axis neither open nor close.
_STILL = 1e-4
# Lengths of actuators that differ by less [m or rad] are equal but for rounding.
_SAME = 1e-9


@dataclass(frozen=True)
class Fingers:
    """The fingers of a hand that actuators move by joints, by tendons of any kind, or by equalities of joints.

    Attributes:
        joints: Ids of the joints that carry a finger as a whole: none of them carries another one.
        closed_qpos: Positions of these joints when the hand is closed [m or rad], shape (njoint,).
        width: Sideways motion of each finger per unit of its joint [m/m or m/rad], shape (njoint,): the mean between
            closed and open, at the geom that is nearest to the TCP; negative if the finger closes as its joint grows.
            None for linkages, whose fingers move as a `connect` or a `weld` makes them.
        controls: Columns of the actuators in `ctrl`, ascending.
        closed: Controls that close the hand, shape (ncontrol,).
        opened: Controls that open it, shape (ncontrol,).
    """

    joints: tuple[int, ...]
    closed_qpos: np.ndarray
    width: np.ndarray | None
    controls: list[int]
    closed: np.ndarray
    opened: np.ndarray

    @classmethod
    def find(cls, scene: SceneModel, tcp: int, arm: Sequence[int]) -> Fingers | None:
        """Find the fingers that the last joint of an arm carries; return None if no actuator opens and closes any.

        A hand opens as its fingers move away from the approach axis, which is the z axis of the TCP.

        Args:
            scene: The scene. All joints but those of the fingers are in its start pose.
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
        return cls(
            joints,
            closed[mjm.jnt_qposadr[list(joints)]],
            widths,
            list(controls),
            *np.transpose(list(controls.values())),
        )


def _below(mjm: mujoco.MjModel, joint: int) -> list[int]:
    """Return the bodies that a joint moves."""
    return subtree(mjm, int(mjm.jnt_bodyid[joint]))


def _seen(mjm: mujoco.MjModel, data: mujoco.MjData, tcp: int, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of all geoms in the TCP's frame [m], shape (ngeom, 3), and the lengths of all actuators."""
    data.qpos[:] = qpos
    for stage in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon, mujoco.mj_transmission):
        stage(mjm, data)
    axes = data.site_xmat[tcp].reshape(3, 3)
    return (data.geom_xpos - data.site_xpos[tcp]) @ axes, data.actuator_length.copy()


def _ends(mjm: mujoco.MjModel, actuator: int, short: float, long: float) -> tuple[float, float]:
    """Return the controls by which an actuator closes and opens a hand, given its lengths there; nan if there are none.

    Those of a position actuator hold these lengths; those of any other actuator are the ends of its control range.
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
