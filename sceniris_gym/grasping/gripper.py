"""Measures the gripper of an arm from the arm's geometry: the opening, and the dimensions of the fingers.

Finger joints are the joints of the hand that do not move the TCP. If an equality makes a finger joint follow another
finger joint, only the joint that is followed is set. A gripper with two mirrored fingers is then opened by one joint.
Joints in closed loops follow the joints that actuators drive (`loop_couplings`).
All lengths are in the TCP frame, with +z along the approach axis and +y along the closing axis.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from itertools import compress
from typing import NamedTuple

import mujoco
import numpy as np

from sceniris_gym.files import Array
from sceniris_gym.geometry.pieces import Piece, PieceType
from sceniris_gym.grasping.linkage import check_loops, loop_couplings
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.scene.couplings import Coupling, driven_by, follow, free_range, joint_couplings
from sceniris_gym.scene.support import subtree

# Opening [m] of a tool without fingers, which may touch objects of any width.
_NO_LIMIT = 1.0e3
# Depth [m] of a gripper that has no palm behind its TCP.
_DEEP = 0.1
_PUSHES = 1e-9  # J, work of a motor that closes a hand, for a control of 1
_ROUNDING = 1e-4  # m or rad, by which a control range may differ from its joint's range
_SHARES = 17  # openings at which the closed loops are checked, and at which fingertips are measured
_WAYS = 257  # openings at which fingers in closed loops are tested for touching, 0.3 mm apart
_CLEAR = 0.005  # m, between an object and the finger that is part of the hand
_TIPS = 0.01  # m, a piece is a fingertip if it ends at most this far behind the end of the farthest piece


class Gripper(NamedTuple):
    """A gripper in its TCP frame. Lengths are in metres.

    Attributes:
        opening: Widest gap between the fingers, 1000 for a tool without fingers.
        closed: Smallest gap between the fingers.
        tip: How far the fingertips are beyond the TCP, along the approach axis, at any opening.
        depth: Distance from the palm to the TCP, along the approach axis.
        half_width: Half the width of the fingers at the TCP, across the closing axis.
        thickness: Thickness of a finger at the TCP, along the closing axis.
        qposadr: Addresses in qpos of the finger joints that do not follow other joints.
        open_qpos: Positions of the joints in `qposadr` at the widest gap [m or rad].
        closed_qpos: Positions of the joints in `qposadr` at the smallest gap [m or rad].
        couplings: Couplings of the joints that follow the joints in `qposadr`, in the order of `joint_couplings`.
        middle: Position on the closing axis of the middle of an object before its grasp, as (a, b) for a + b w [m] if
            the object has the width w. It is not the TCP if one finger is part of the hand. Then b has the sign of the
            side to which the other finger opens.
    """

    opening: float
    closed: float
    tip: float
    depth: float
    half_width: float
    thickness: float
    qposadr: Array
    open_qpos: Array
    closed_qpos: Array
    couplings: tuple[Coupling, ...] = ()
    middle: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def from_model(cls, mjm: mujoco.MjModel, arm: SerialArm, home_qpos: np.ndarray, pieces: list[Piece]) -> Gripper:
        """Measure the gripper of an arm.

        Args:
            mjm: The model.
            arm: The arm in the model.
            home_qpos: A pose of the model, shape (nq,). Positions of finger joints in this pose are ignored.
            pieces: Pieces of all geoms of the model.

        Raises:
            NotSupportedError: The fingers are part of a closed loop, and opening the gripper would violate the equality
                that closes the loop: no actuator drives the loop, or a joint reaches its limit.
        """
        mjm, hand = commanded(mjm), carried(mjm, arm)
        own = [p for p in pieces if p.body in hand and p.type != PieceType.PLANE]
        couplings, home = joint_couplings(mjm, f"arm '{arm.name}'"), home_qpos.copy()
        follow(couplings, home)
        loops = loop_couplings(mjm, hand_joints(mjm, hand, arm.qposadr), couplings, home)
        couplings = (*loops, *couplings)
        found = finger_joints(mjm, hand, arm.qposadr, couplings, home_qpos)
        if not found or not own:
            return cls(_NO_LIMIT, 0.0, 0.0, _DEEP, 0.01, 0.0, np.zeros(0, int), np.zeros(0), np.zeros(0))
        follow(couplings, home)
        measured = _Hand(mjm, arm, own, couplings, home)
        joints = list(found)
        adr, fingers = mjm.jnt_qposadr[joints].astype(int), measured.moved_by(joints)
        wide, narrow = np.transpose([measured.outer_first(joint, ends) for joint, ends in found.items()])
        if loops:
            narrow = measured.closed_end(fingers, adr, wide, narrow)
        opened = [measured.opened(fingers, adr, qpos) for qpos in np.linspace(wide, narrow, _SHARES)]
        (low, high, opening), (_, _, closed) = opened[0], opened[-1]
        sides = [fingers & (sign * (low[:, 1] + high[:, 1]) > 0.0) for sign in (1.0, -1.0)]
        if opening == 0.0 and all(side.any() for side in sides):
            opening, closed = measured.tip_gaps(sides, adr, [wide, narrow])
        middle = (0.0, 0.0)
        if len(joints) == 1 and fingers.any() and (jaw := measured.one_jaw(fingers, adr, [wide, narrow])) is not None:
            opening, closed, middle = jaw
        at = _beside(low, high, fingers)
        first, across = (middle[0], 2.0 * middle[1] * opening) if middle[1] else (-0.5 * opening, opening)
        right, left = sorted([first, first + across])  # a finger that is part of the hand is no palm
        between = ~at & (high[:, 2] < 0.0) & (low[:, 1] < left) & (high[:, 1] > right)
        gripper = cls(
            opening=opening,
            closed=closed,
            tip=float(np.concatenate([high[at, 2], *(tops[fingers, 2] for _, tops, _ in opened)]).max(initial=0.0)),
            depth=float(-high[between, 2].max(initial=-_DEEP)),
            half_width=float(np.abs([low[at, 0], high[at, 0]]).max(initial=0.0)),
            thickness=float((high[at, 1] - low[at, 1]).max(initial=0.0)),
            qposadr=adr,
            open_qpos=wide,
            closed_qpos=narrow,
            couplings=tuple(driven_by(couplings, joints)),
            middle=middle,
        )
        check_loops(mjm, arm.name, home_qpos, gripper.couplings, *gripper.poses(np.linspace(0.0, 1.0, _SHARES)))
        return gripper

    def poses(self, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the positions of the finger joints at given openings of the gripper.

        Args:
            share: Openings from 0 (closed) to 1 (open), shape (n,).

        Returns:
            Addresses in qpos of the finger joints and their followers, shape (nfinger,), and the positions of these
            joints [m or rad], shape (n, nfinger).
        """
        adr = np.concatenate([self.qposadr, [c.adr for c in self.couplings]]).astype(int)
        qpos = np.zeros((len(share), adr.max(initial=-1) + 1))
        qpos[:, self.qposadr] = self.closed_qpos + share[:, None] * (self.open_qpos - self.closed_qpos)
        follow(self.couplings, qpos)
        return adr, qpos[:, adr]


def carried(mjm: mujoco.MjModel, arm: SerialArm) -> set[int]:
    """Return the bodies that the arm's last joint moves: the body with this joint, the hand and the fingers."""
    return set(subtree(mjm, int(mjm.jnt_bodyid[mjm.jnt_qposadr == arm.qposadr[-1]][0])))


def commanded(mjm: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a model whose joint ranges end where position actuators bring the joints.

    The controls are at the joint's limits, but within the control range. Springs of the joints pull them back.
    """
    mjm, (gain, bias, slope) = copy.copy(mjm), (mjm.actuator_gainprm[:, 0], *mjm.actuator_biasprm[:, :2].T)
    moves = (mjm.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (gain * slope < 0.0)
    if not len(moves) == mjm.nu == len(mjm.actuator_gear):  # some actuators have several controls or outputs
        return mjm
    limits = np.where(mjm.actuator_ctrllimited[:, None], mjm.actuator_ctrlrange, [-np.inf, np.inf])
    for i in np.flatnonzero(moves).tolist():
        joint, gear, ends = mjm.actuator_trnid[i, 0], mjm.actuator_gear[i, 0], bias[i] + gain[i] * limits[i]
        pull, spring = -slope[i] * gear**2, mjm.jnt_stiffness[joint]
        narrow = pull * np.clip(mjm.jnt_range[joint], *np.sort(-ends / (slope[i] * gear)))
        narrow = (narrow + spring * mjm.qpos_spring[mjm.jnt_qposadr[joint]]) / (pull + spring)
        if np.abs(narrow - mjm.jnt_range[joint]).max() > _ROUNDING:
            mjm.jnt_range[joint] = narrow
    return mjm


def squeezing_controls(mjm: mujoco.MjModel, adr: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Return the controls at which motors of a hand close it with the most force, shape (nu,), NaN for other actuators.

    A motor has a control range and no position feedback. Virtual work from open to closed gives the end that closes.

    Args:
        mjm: The model.
        adr: Addresses in qpos of the finger joints and their followers, shape (nfinger,).
        poses: Positions of these joints [m or rad] in the closed and in the open hand, shape (2, nfinger).
    """
    data, lengths = mujoco.MjData(mjm), []
    for pose in poses:
        data.qpos[adr] = pose
        mujoco.mj_fwdPosition(mjm, data)
        lengths.append(data.actuator_length.copy())
    if not len(lengths[0]) == mjm.nu == len(mjm.actuator_trntype):  # some actuators have several controls or outputs
        return np.full(mjm.nu, np.nan)
    pushes = mjm.actuator_gainprm[:, 0] * (lengths[0] - lengths[1])
    is_motor = (mjm.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED) & (mjm.actuator_biasprm[:, 1] == 0.0)
    is_motor &= (mjm.actuator_ctrllimited == 1) & (mjm.actuator_dyntype != mujoco.mjtDyn.mjDYN_INTEGRATOR)
    ends = np.where(pushes > 0.0, mjm.actuator_ctrlrange[:, 1], mjm.actuator_ctrlrange[:, 0])
    return np.where(is_motor & (np.abs(pushes) > _PUSHES), ends, np.nan)


def hand_joints(mjm: mujoco.MjModel, hand: Iterable[int], arm: np.ndarray) -> np.ndarray:
    """Return the ids of the hinges and slides of a hand, without joints at the addresses `arm` in qpos."""
    scalar = (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE)
    fingers = np.isin(mjm.jnt_bodyid, list(hand)) & np.isin(mjm.jnt_type, scalar) & ~np.isin(mjm.jnt_qposadr, arm)
    return np.flatnonzero(fingers)


def finger_joints(
    mjm: mujoco.MjModel, hand: Iterable[int], arm: np.ndarray, couplings: Sequence[Coupling], home: np.ndarray
) -> dict[int, tuple[float, float]]:
    """Return the finger joints that have limits and do not follow other joints: id -> range [m or rad].

    Args:
        mjm: The model.
        hand: Bodies that the arm's last joint moves.
        arm: Addresses of the arm's joints in qpos.
        couplings: Joints that follow others. The limits of a follower narrow the range of its driver.
        home: Pose of the model, shape (nq,). Ranges are computed with all other joints in this pose.
    """
    free = np.setdiff1d(hand_joints(mjm, hand, arm), [c.follower for c in couplings]).tolist()
    found = {j: free_range(mjm, couplings, j, home) for j in free}
    return {j: ends for j, ends in found.items() if np.isfinite(ends).all()}


class _Hand(NamedTuple):
    """The pieces that the arm's last joint moves, measured in the TCP frame.

    Attributes:
        mjm: The model.
        arm: The arm in the model.
        pieces: The pieces that the arm's last joint moves.
        couplings: All couplings of joints in the model, as `joint_couplings` returns them.
        home: A pose of the model that satisfies the couplings, shape (nq,).
    """

    mjm: mujoco.MjModel
    arm: SerialArm
    pieces: list[Piece]
    couplings: tuple[Coupling, ...]
    home: np.ndarray

    def moved_by(self, joints: list[int]) -> np.ndarray:
        """Return a mask of the pieces that the joints or their followers move, shape (npiece,)."""
        moving = [*joints, *(c.follower for c in driven_by(self.couplings, joints))]
        bodies = {b for j in moving for b in subtree(self.mjm, int(self.mjm.jnt_bodyid[j]))}
        return np.array([p.body in bodies for p in self.pieces])

    def outer_first(self, joint: int, ends: tuple[float, float]) -> tuple[float, float]:
        """Return the limits of a finger joint [m or rad], first the one with the finger farther from the approach axis.

        `ends` are the lower and the upper limit.
        """
        moved, off = self.moved_by([joint]), []
        for value in ends:
            low, high = self._boxes(self.mjm.jnt_qposadr[joint], value)
            off.append(np.abs(low[moved, 1] + high[moved, 1]).sum())
        return ends[::-1] if off[1] > off[0] else ends

    def closed_end(self, fingers: np.ndarray, adr: np.ndarray, wide: np.ndarray, narrow: np.ndarray) -> np.ndarray:
        """Return the joint positions at which closing fingers first touch, or `narrow` if the fingers do not touch.

        Args:
            fingers: Mask of the pieces that finger joints move, shape (npiece,).
            adr: Addresses in qpos of the finger joints, shape (n,).
            wide: Positions of these joints when the gripper is open [m or rad], shape (n,).
            narrow: Their positions at their other limits [m or rad], shape (n,).
        """
        ways = (wide + way * (narrow - wide) for way in np.linspace(0.0, 1.0, _WAYS))
        return next((qpos for qpos in ways if self.opened(fingers, adr, qpos)[2] <= 0.0), narrow)

    def opened(self, fingers: np.ndarray, adr: np.ndarray, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Return the boxes of all pieces and the gap between the fingers, with finger joints at given positions.

        Args:
            fingers: Mask of the pieces that finger joints move, shape (npiece,).
            adr: Addresses in qpos of the finger joints, shape (n,).
            qpos: Positions of these joints [m or rad], shape (n,).

        Returns:
            Lower and upper corners of the boxes in the TCP frame [m], shape (npiece, 3) each, and the gap [m].
        """
        low, high = self._boxes(adr, qpos)
        at = _beside(low, high, fingers)
        left = at & (low[:, 1] + high[:, 1] > 0.0)
        right = at & (low[:, 1] + high[:, 1] <= 0.0)
        above, below = low[left, 1].min(initial=np.inf), -high[right, 1].max(initial=-np.inf)
        if np.isfinite([above, below]).sum() == 1:  # for a single finger, the other side gets the same room
            alone = min(above, below)
            above = below = alone if alone > 0.0 else _NO_LIMIT  # the hull of a hooked finger may contain the TCP
        return low, high, float(np.clip(above + below, 0.0, _NO_LIMIT))

    def tip_gaps(self, sides: list[np.ndarray], adr: np.ndarray, ends: list[np.ndarray]) -> tuple[float, float]:
        """Return `opening` and `closed` of two fingers whose boxes overlap at any opening, between their tips.

        The tips are the vertices within 1 cm of each finger's end in the closed gripper.

        Args:
            sides: Masks of the pieces of the finger on the +y side and of the finger on the -y side, shape (npiece,).
            adr: Addresses in qpos of the finger joints, shape (n,).
            ends: Positions of these joints in the open and in the closed gripper [m or rad], shape (n,) each.
        """
        tips = [self._tip(side, adr, ends) for side in sides]
        opening, closed = (max(float(left.min() - right.max()), 0.0) for left, right in zip(*tips, strict=True))
        return opening, closed

    def one_jaw(
        self, moves: np.ndarray, adr: np.ndarray, ends: list[np.ndarray]
    ) -> tuple[float, float, tuple[float, float]] | None:
        """Return `opening`, `closed` and `middle` of a gripper whose only jaw closes on a finger that the hand forms.

        The gaps are between the tips: between the vertices of each finger within 1 cm of its end in the closed gripper.

        Args:
            moves: Mask of the pieces of the jaw, shape (npiece,).
            adr: Address in qpos of the joint of the jaw, shape (1,).
            ends: Positions of this joint in the open and in the closed gripper [m or rad], shape (1,) each.

        Returns:
            The three attributes of the gripper, or None if no part of the hand beside the TCP faces the jaw.
        """
        away, jaw = self._tip(moves, adr, ends)
        side = float(np.sign((away - jaw).mean()))
        hand = self._vertices(~moves, adr, ends[1])
        facing = hand[side * hand[:, 1] < (side * jaw).max()]
        if facing[:, 2].max(initial=-np.inf) < -_TIPS:
            return None
        fixed = float((side * facing[facing[:, 2] > facing[:, 2].max() - _TIPS, 1]).max())
        closed, opening = (max(float((side * each).min()) - fixed, 0.0) for each in (jaw, away))
        return opening, closed, (side * (fixed + _CLEAR), 0.5 * side)

    def _tip(self, finger: np.ndarray, adr: np.ndarray, ends: list[np.ndarray]) -> list[np.ndarray]:
        """Return the y [m] of a finger's tip, which are its vertices within 1 cm of its end in the closed gripper.

        Args:
            finger: Mask of the finger's pieces, shape (npiece,).
            adr: Addresses in qpos of the finger joints.
            ends: Positions of these joints in the open and in the closed gripper [m or rad].

        Returns:
            Coordinates of the same vertices along the closing axis, in the open and in the closed gripper.
        """
        wide, narrow = (self._vertices(finger, adr, qpos) for qpos in ends)
        tip = narrow[:, 2] > narrow[:, 2].max() - _TIPS
        return [wide[tip, 1], narrow[tip, 1]]

    def _vertices(self, chosen: np.ndarray, adr: np.ndarray, qpos: np.ndarray) -> np.ndarray:
        """Return the vertices [m] of the pieces in a mask in the TCP frame, (n, 3), with finger joints as `_boxes`."""
        data, axes, at = self._posed(adr, qpos)
        own = compress(self.pieces, chosen)
        places = [(data.xmat[p.body].reshape(3, 3).T, data.xpos[p.body] - at, p.mesh) for p in own]
        found = [(mesh.vertices @ turn + shift) @ axes.T for turn, shift, mesh in places if mesh is not None]
        return np.concatenate([np.zeros((0, 3)), *found])

    def _boxes(self, adr: np.ndarray, qpos: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        """Return the lower and the upper corners [m] of the pieces' boxes in the TCP frame, shape (npiece, 3) each.

        `adr` and `qpos` are the qpos addresses and positions of the joints that differ from `home`.
        """
        data, axes, at = self._posed(adr, qpos)
        found = np.array([p.extents(axes @ data.xmat[p.body].reshape(3, 3)) for p in self.pieces])
        shift = np.array([axes @ (data.xpos[p.body] - at) for p in self.pieces])
        return found[:, 0] + shift, found[:, 1] + shift

    def _posed(self, adr: np.ndarray, qpos: np.ndarray | float) -> tuple[mujoco.MjData, np.ndarray, np.ndarray]:
        """Pose the hand as `_boxes` does, and return its data, and the TCP's axes as rows (3, 3) and position [m]."""
        data = mujoco.MjData(self.mjm)
        data.qpos[:] = self.home
        data.qpos[adr] = qpos
        follow(self.couplings, data.qpos)
        mujoco.mj_kinematics(self.mjm, data)
        return data, data.site_xmat[self.arm.tcp_site].reshape(3, 3).T, data.site_xpos[self.arm.tcp_site]


def _beside(low: np.ndarray, high: np.ndarray, fingers: np.ndarray) -> np.ndarray:
    """Return a mask of the boxes beside the TCP, or of the fingertips if no box is beside the TCP.

    Args:
        low: Lower corners of the boxes in the TCP frame [m], shape (n, 3).
        high: Upper corners of the boxes in the TCP frame [m], shape (n, 3).
        fingers: Mask of the boxes of fingers, shape (n,).
    """
    at = (low[:, 2] <= 0.0) & (high[:, 2] >= 0.0)
    return at if at.any() or not fingers.any() else fingers & (high[:, 2] > high[fingers, 2].max() - _TIPS)
