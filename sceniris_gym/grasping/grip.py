"""Grips: for each grasp, how far the gripper closes on the object, and how far it shifts sideways to be centred.

Both fingers close at the same time, so they would push an object that is not in the middle sideways. Distances always
use MuJoCo's collision geometry, also with `geometry: visual`, because MuJoCo simulates contacts with this geometry.
"""

import copy
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from sceniris_gym.files import Array
from sceniris_gym.geometry.contacts import ContactRules
from sceniris_gym.geometry.rotations import matrix, quaternion
from sceniris_gym.grasping.grasps import Grasp
from sceniris_gym.grasping.gripper import Gripper, carried, squeezing_controls
from sceniris_gym.reach.arm import SerialArm

INSIDE = 3.0e-4
"""Penetration [m] of each finger into the object at the start. With 0, the object would slip by 1 mm at first."""
PRESSES = (1.0, 0.5, 0.25, 0.125)
"""How firmly controls may close a gripper. 0 would keep the fingers where they are, and 1 closes them completely."""
_STEPS = 16  # bisection steps: 40 mm of finger travel over 2^16 is 0.6 um
_FAR = 0.3  # m, distances are measured up to this limit, because the object is between the fingers
_FITS = 2.0e-4  # m, largest error of the penetration on either side
_MOVES = 1.0e-6  # m, a geom belongs to a finger if it moves farther than this while the gripper opens
SLIPS = 1.0e-3
"""Largest motion of a held object in the hand [m]. Starts guarantee 2 mm, because arms swing and sag."""
_HOLD, _LOAD = 0.5, 2.0  # duration of the hold test [s], and its load as a multiple of the object's weight


class Grip(NamedTuple):
    """A grasp with the fingers closed on the object.

    Attributes:
        share: Opening of the gripper, from 0 (closed) to 1 (open).
        pos: Position [m] of the TCP, midway between the contacts, in the frame of the grasp's body, shape (3,).
        fits: How firmly the controls close the fingers on the object, as in `PRESSES`, so that they hold it where it
            stands. 0 if the fingers do not touch the object from both sides. If it moves in the hand, minus the least
            motion [m].
        lifts: The same, for an object that hangs in its placed orientation. 0 if this was not tested.
        holds: The same, for gravity in any direction. 0 if this was not tested.
    """

    share: float
    pos: Array
    fits: float = 0.0
    lifts: float = 0.0
    holds: float = 0.0


class Fingers:
    """Closes the fingers of a gripper on the objects of its scene.

    Args:
        models: Copies of the model with the random parameters at values for which the fingers hold objects worst. There
            are several, because for some parameters it is not known which end of the range is worse.
        arm: The arm in the model.
        gripper: The arm's gripper.
        home: MjData at the start pose. Joints inside objects keep their positions.
    """

    def __init__(self, models: Sequence[mujoco.MjModel], arm: SerialArm, gripper: Gripper, home: mujoco.MjData) -> None:
        self._models, mjm = models, models[0]
        self._mjm, self._gripper, self._site, self._home = mjm, gripper, arm.tcp_site, home
        self._data = mujoco.MjData(mjm)
        self._data.qpos[:] = home.qpos
        self._rules, self._hand = ContactRules(mjm, "physics"), carried(mjm, arm)
        geoms = np.flatnonzero(np.isin(mjm.geom_bodyid, list(self._hand)))
        at_closed, at_open = (self._pose(share)[geoms] for share in (0.0, 1.0))
        moves = np.linalg.norm(at_open - at_closed, axis=1) > _MOVES
        left = at_open[:, 1] > 0.0
        if gripper.middle[1] != 0.0:  # the hand is the other finger
            left, moves = moves == (gripper.middle[1] > 0.0), True
        self._sides = [geoms[moves & side].tolist() for side in (left, ~left)]

    def grips(self, bodies: Sequence[int], grasps: Sequence[Grasp]) -> tuple[Grip, ...]:
        """Return the grip for each of `grasps`. `bodies` are the bodies of the object."""
        geoms = np.flatnonzero(np.isin(self._mjm.geom_bodyid, bodies)).tolist()
        pairs = [
            [(f, g) for f in side for g in geoms if self._rules.meet(*self._rules.classes[[f, g]])]
            for side in self._sides
        ]
        if not all(pairs):
            return tuple(Grip(0.0, grasp.pos) for grasp in grasps)
        return tuple(self._grip(grasp, pairs) for grasp in grasps)

    def _grip(self, grasp: Grasp, pairs: list[list[tuple[int, int]]]) -> Grip:
        """Close the fingers and shift the gripper until each side penetrates the object by `INSIDE`.

        Args:
            grasp: The grasp.
            pairs: For each side of the gripper, the pairs (finger geom, object geom) that can collide.
        """
        shift, low, high = 0.0, 0.0, 1.0
        for _ in range(_STEPS):
            share = 0.5 * (low + high)
            gaps = self._gaps(share, shift, grasp, pairs)
            shift -= 0.5 * (gaps[0] - gaps[1])
            low, high = (low, share) if gaps.sum() > -2.0 * INSIDE else (share, high)
        gaps = self._gaps(high, shift, grasp, pairs)
        pos = grasp.pos + matrix(grasp.quat)[:, 1] * shift
        return Grip(high, pos, float((np.abs(gaps + INSIDE) < _FITS).all()))

    def _gaps(self, share: float, shift: float, grasp: Grasp, pairs: list[list[tuple[int, int]]]) -> np.ndarray:
        """Return the smallest distance [m] between the fingers and the object on each side of the gripper, shape (2,).

        Args:
            share: Opening of the gripper, from 0 (closed) to 1 (open).
            shift: Distance [m] by which the TCP moves along the closing axis of the grasp.
            grasp: The grasp.
            pairs: As in `_grip`.
        """
        data, home = self._data, self._home
        self._pose(share)
        at, rotation, there = self._in_hand(grasp, grasp.pos + matrix(grasp.quat)[:, 1] * shift)
        for g in {g for side in pairs for _, g in side}:
            data.geom_xpos[g] = at + rotation @ (home.geom_xpos[g] - there)
            data.geom_xmat[g] = (rotation @ home.geom_xmat[g].reshape(3, 3)).ravel()
        near = [min(mujoco.mj_geomDistance(self._mjm, data, f, g, _FAR, None) for f, g in side) for side in pairs]
        return np.array(near)

    def _in_hand(self, grasp: Grasp, pos: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return (at, rotation, there), which move the object into the hand.

        A point of the object that is at x in the model's start pose moves to `at + rotation @ (x - there)`.

        Args:
            grasp: The grasp.
            pos: Position of the TCP in the frame of the grasp's body, shape (3,).
        """
        data, home = self._data, self._home
        body = home.xmat[grasp.body].reshape(3, 3)
        rotation = data.site_xmat[self._site].reshape(3, 3) @ matrix(grasp.quat).T @ body.T
        return data.site_xpos[self._site].copy(), rotation, home.xpos[grasp.body] + body @ pos

    def hold(self, bodies: Sequence[int], grasp: Grasp, grip: Grip, downs: np.ndarray) -> float:
        """Simulate half a second in MuJoCo C, and return how firmly the fingers close to hold the object in all models.

        The object is free, and only the hand and the object collide. A strong gripper may squeeze the object out of its
        fingers. Then the result is the greatest of `PRESSES` that holds the object, or minus the least motion [m].

        Args:
            bodies: Bodies of the object, the root first.
            grasp: The grasp.
            grip: The grip of this grasp.
            downs: Directions of gravity in the frame of the object's root, shape (n, 3). The fingers should hold the
                object for each of them. A row of zeros tests without gravity, for an object that a support carries.
        """
        least = np.inf
        for press in PRESSES:
            moved = (self._moved(copy.copy(model), bodies, grasp, grip, downs, press) for model in self._models)
            if (slip := next((m for m in moved if not m < SLIPS), 0.0)) == 0.0:
                return press
            least = min(least, slip)
        return -float(least)

    def _moved(
        self, alone: mujoco.MjModel, bodies: Sequence[int], grasp: Grasp, grip: Grip, downs: np.ndarray, press: float
    ) -> float:
        """Return the motion [m] of the object in the test of `hold` in one model, `alone`, which the test modifies."""
        data, home, root = self._data, self._home, bodies[0]
        apart = ~np.isin(alone.geom_bodyid, [*self._hand, *bodies])
        alone.geom_contype[apart] = alone.geom_conaffinity[apart] = 0
        self._pose(0.0)
        control = press * self._controls(alone)
        self._pose(grip.share)
        control += (1.0 - press) * self._controls(alone)
        squeezing = squeezing_controls(alone, *self._gripper.poses(np.array([0.0, 1.0])))
        control = np.where(np.isnan(squeezing), control, press * squeezing)
        at, rotation, there = self._in_hand(grasp, grip.pos)
        adr = alone.jnt_qposadr[alone.body_jntadr[root]]
        data.qpos[adr : adr + 3] = at + rotation @ (home.xpos[root] - there)
        data.qpos[adr + 3 : adr + 7] = quaternion(rotation @ home.xmat[root].reshape(3, 3))
        qpos, pull = data.qpos.copy(), _LOAD * np.linalg.norm(alone.opt.gravity)
        for down in downs:
            mujoco.mj_resetData(alone, data)
            data.qpos[:], data.ctrl[:] = qpos, control
            alone.opt.gravity = pull * (rotation @ home.xmat[root].reshape(3, 3) @ down)
            mujoco.mj_kinematics(alone, data)
            before = self._seen(root)
            for _ in range(round(_HOLD / alone.opt.timestep)):
                mujoco.mj_step(alone, data)
            mujoco.mj_kinematics(alone, data)
            if not (slip := np.linalg.norm(self._seen(root) - before)) < SLIPS:
                return float(slip)
        return 0.0

    def _seen(self, body: int) -> np.ndarray:
        """Return the position [m] of a body in the TCP frame, shape (3,)."""
        axes = self._data.site_xmat[self._site].reshape(3, 3)
        return axes.T @ (self._data.xpos[body] - self._data.site_xpos[self._site])

    def _controls(self, mjm: mujoco.MjModel) -> np.ndarray:
        """Return controls that keep position actuators at the current joint positions, shape (nu,).

        The controls are clipped to their limits. The other actuators get 0, or the limit nearest to 0.
        """
        mujoco.mj_fwdPosition(mjm, self._data)
        gain, bias = mjm.actuator_gainprm[:, 0], mjm.actuator_biasprm
        with np.errstate(divide="ignore", invalid="ignore"):
            rest = -(bias[:, 0] + bias[:, 1] * self._data.actuator_length) / gain
        limits = np.where(mjm.actuator_ctrllimited[:, None], mjm.actuator_ctrlrange, [-np.inf, np.inf])
        return np.clip(np.where((bias[:, 1] < 0.0) & (gain > 0.0), rest, 0.0), *limits.T)

    def _pose(self, share: float) -> np.ndarray:
        """Set the opening of the gripper, and return the positions [m] of all geoms in the TCP frame, (ngeom, 3)."""
        data, (adr, qpos) = self._data, self._gripper.poses(np.array([share]))
        data.qpos[adr] = qpos[0]
        mujoco.mj_kinematics(self._mjm, data)
        return (data.geom_xpos - data.site_xpos[self._site]) @ data.site_xmat[self._site].reshape(3, 3)
