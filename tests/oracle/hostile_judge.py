"""MuJoCo C as the judge of served states: contacts, equalities, accelerations, rest, and what should stay at home.

It knows the model, the states, and in plain words what the scene names; it shares no code with what makes layouts.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator

import mujoco
import numpy as np

from tests.generators.hostile_words import Conflict, Home, Served, Thing, home_state

DEEPER = 1e-5
"""How much deeper [m] than at home a pair may be that touches at home, and how deep anything may be in its support."""
VIOLATION = 1e-5
"""How much more than at home an active equality or a limit may be violated, in its own units."""
KICK = 50.0
"""Bound on |qacc| [m/s2] of a slide, beyond twice what gravity and springs alone would do to it. A hinge or a ball has
the bound KICK / r [rad/s2] with r = sqrt(I / m), the radius of gyration of what it moves about its axis. What
contacts alone do is left out: any that home does not have is a conflict by itself, and what overlaps there is pushed
apart there, too."""
MOVED = 0.01
"""How far [m] an object with `stable` may get within REST."""
REST = 0.5
"""Time [s] that it is watched, with everything else, and its own joints, held where they are."""
HEAVIER = 1e5
"""How much heavier what is held is made than it is: more would cost the simulation its digits."""

_ROWS = {
    int(mujoco.mjtConstraint.mjCNSTR_EQUALITY): "equality",
    int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT): "limit of joint",
    int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON): "limit of tendon",
}


class Judge:
    """Judges states of one model.

    Args:
        mjm: The model that is simulated.
        things: What the scene names.
        home: What the user's own model says of home; None leaves that out.
    """

    def __init__(self, mjm: mujoco.MjModel, things: list[Thing], home: Home | None = None) -> None:
        self.mjm, self.things, self.home = mjm, things, home
        self._data = mujoco.MjData(mjm)
        self._owner = self._owners()
        self._supports = {t.name: mjm.body(t.support).id for t in things if t.support is not None}
        self._placed = {t.name for t in things if t.placed}
        self._at_home, self._violated_at_home = self._judge_home()
        self._unhelped = self._without_help()
        self._untouched = _without_contacts(mjm)
        self._stable = [mjm.body(t.body).id for t in things if t.stable]
        self._alone = self._with_all_else_held()

    def judge(self, served: Served) -> list[Conflict]:
        """Judge all rows; no conflict means that all are right."""
        found = []
        for row in range(len(served.qpos)):
            found += [Conflict(kind, row, who, value) for kind, who, value in self._judge_row(served, row)]
        return found

    def _judge_row(self, served: Served, row: int) -> Iterator[tuple[str, str, float]]:
        mjm, data = self.mjm, self._data
        self._put(mjm, data, served, row)
        if not np.isfinite(data.qpos).all():
            yield "not finite", "qpos", float("nan")
            return
        mujoco.mj_forward(mjm, data)
        yield from self._judge_contacts(data)
        for (kind, i), worst in _violations(mjm, data).items():
            if worst > self._violated_at_home.get((kind, i), 0.0) + VIOLATION:
                yield kind, f"{kind} {i}", worst
        yield from self._judge_accelerations(data, served, row)
        yield from self._judge_home_poses(data)
        yield from self._judge_rest(served, row)

    def _put(self, mjm: mujoco.MjModel, data: mujoco.MjData, served: Served, row: int) -> None:
        mujoco.mj_resetData(mjm, data)
        data.qpos[:] = served.qpos[row]
        if mjm.nmocap:
            data.mocap_pos[:], data.mocap_quat[:] = served.mocap_pos[row], served.mocap_quat[row]
        data.ctrl[:], data.act[:] = served.ctrl[row], served.act[row]
        if served.history is not None:
            data.history[:] = served.history[row]
            return
        for i in np.flatnonzero(np.asarray(getattr(mjm, "actuator_historyadr", [])) >= 0):
            count = int(mjm.actuator_history[i, 0])
            mujoco.mj_initCtrlHistory(mjm, data, int(i), None, np.full((count, 1), data.ctrl[i]))

    def _owners(self) -> np.ndarray:
        """The thing that every body belongs to: its number, or -1."""
        owner = np.full(self.mjm.nbody, -1)
        for i, thing in enumerate(self.things):
            owner[self.mjm.body(thing.body).id] = i
        for body in range(1, self.mjm.nbody):
            if owner[body] < 0:
                owner[body] = owner[self.mjm.body_parentid[body]]
        return owner

    def _judge_home(self) -> tuple[dict, dict[tuple[str, int], float]]:
        """Depths of pairs that touch at home, with placed objects far apart from all else; violations of equalities."""
        mjm, data = self.mjm, home_state(self.mjm)
        mujoco.mj_forward(mjm, data)
        violated = _violations(mjm, data)
        for i, thing in enumerate(self.things):
            body = mjm.body(thing.body)
            away = np.array([1e4 * (i + 1), 1e4, 1e4])
            if thing.placed and mjm.body_mocapid[body.id] >= 0:
                data.mocap_pos[mjm.body_mocapid[body.id]] = away
            elif thing.placed:
                adr = mjm.jnt_qposadr[body.jntadr[0]]
                data.qpos[adr : adr + 3] = away
        mujoco.mj_kinematics(mjm, data)
        mujoco.mj_comPos(mjm, data)
        mujoco.mj_collision(mjm, data)
        found: dict = {}
        for key, _, contact in self._contacts(data):
            found[key] = min(found.get(key, np.inf), contact.dist)
        return found, violated

    def _contacts(self, data: mujoco.MjData) -> Iterator[tuple[tuple, list[int], mujoco.MjContact]]:
        """Contacts that act: a key of the pair, its bodies (-1 for a flex), and the contact."""
        for i in range(data.ncon):
            contact = data.contact[i]
            if contact.dist < contact.includemargin:
                ids = [(int(g), int(f)) for g, f in zip(contact.geom, contact.flex, strict=True)]
                yield tuple(sorted(ids)), [int(self.mjm.geom_bodyid[g]) if g >= 0 else -1 for g, _ in ids], contact

    def _judge_contacts(self, data: mujoco.MjData) -> Iterator[tuple[str, str, float]]:
        worst: dict[tuple, tuple[str, str, float]] = {}
        for key, bodies, contact in self._contacts(data):
            home, depth = self._at_home.get(key), float(contact.dist)
            owners = [self._owner[b] if b >= 0 else -1 for b in bodies]
            if home is not None and (owners[0] == owners[1] or not self._any_placed(owners)):
                if depth >= home - DEEPER:
                    continue
                kind = "deeper than at home"
            elif self._carries(bodies, owners):
                if depth >= -DEEPER:
                    continue
                kind = "in its support"
            elif depth > 0.0 and self._is_apart(data, contact):
                continue
            else:
                kind = "contact" if depth <= 0.0 else "margin"
            if key not in worst or depth < worst[key][2]:
                worst[key] = kind, " and ".join(self._element(g, f) for g, f in key), depth
        yield from worst.values()

    def _is_apart(self, data: mujoco.MjData, contact: mujoco.MjContact) -> bool:
        """Return whether two geoms are further apart than their margin after all.

        MuJoCo's own test of two boxes measures along axes, and finds edges nearer than they are by up to a tenth.
        """
        (a, b), margin = contact.geom, contact.includemargin
        if min(a, b) < 0:
            return False
        return mujoco.mj_geomDistance(self.mjm, data, int(a), int(b), 2.0 * margin, None) >= margin

    def _any_placed(self, owners: list[int]) -> bool:
        return any(o >= 0 and self.things[o].placed for o in owners)

    def _carries(self, bodies: list[int], owners: list[int]) -> bool:
        """Return whether one of two bodies is the support of the thing that the other belongs to."""
        for one, other in ((0, 1), (1, 0)):
            thing = self.things[owners[one]] if owners[one] >= 0 else None
            if thing is not None and self._supports.get(thing.name) == bodies[other]:
                return True
        return False

    def _element(self, geom: int, flex: int) -> str:
        if geom < 0:
            return f"flex {mujoco.mj_id2name(self.mjm, mujoco.mjtObj.mjOBJ_FLEX, flex)}"
        return self.mjm.geom(geom).name or f"geom {geom} of {self.mjm.body(self.mjm.geom_bodyid[geom]).name}"

    def _without_help(self) -> mujoco.MjModel:
        """The model without constraints and without servos: gravity, springs and what users set is left."""
        mjm = copy.copy(self.mjm)
        mjm.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        servos = (mjm.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED) & (mjm.actuator_biasprm[:, 1] < 0)
        mjm.actuator_gainprm[servos], mjm.actuator_biasprm[servos] = 0.0, 0.0
        return mjm

    def _judge_accelerations(self, data: mujoco.MjData, served: Served, row: int) -> Iterator[tuple[str, str, float]]:
        names = [name for thing in self.things for name in (*thing.drawn, *thing.held)]
        if not names:
            return
        mjm = self.mjm
        other = mujoco.MjData(self._unhelped)
        self._put(self._unhelped, other, served, row)
        mujoco.mj_forward(self._unhelped, other)
        untouched = mujoco.MjData(self._untouched)
        self._put(self._untouched, untouched, served, row)
        mujoco.mj_forward(self._untouched, untouched)
        inertia = np.zeros((mjm.nv, mjm.nv))
        mujoco.mj_fullM(mjm, data, inertia)
        for name in dict.fromkeys(names):
            dof = mjm.joint(name).dofadr[0]
            bound = KICK
            if mjm.joint(name).type[0] != mujoco.mjtJoint.mjJNT_SLIDE:
                bound /= np.sqrt(inertia[dof, dof] / mjm.body_subtreemass[mjm.dof_bodyid[dof]])
            kick = np.minimum(abs(data.qacc[dof]), abs(untouched.qacc[dof]))
            if not kick <= 2.0 * abs(other.qacc[dof]) + bound:
                yield "acceleration", name, float(data.qacc[dof])

    def _judge_home_poses(self, data: mujoco.MjData) -> Iterator[tuple[str, str, float]]:
        if self.home is None:
            return
        drawn = {name for thing in self.things for name in thing.drawn}
        for name, value in self.home.joints.items():
            if name not in drawn:
                off = abs(float(data.qpos[self.mjm.joint(name).qposadr[0]]) - value)
                if off > DEEPER:
                    yield "not at home", name, off
        for name, pose in self.home.mocap.items():
            i = int(self.mjm.body(name).mocapid[0])
            off = float(np.abs(np.r_[data.mocap_pos[i], data.mocap_quat[i]] - pose).max())
            if off > DEEPER and not any(t.body == name and t.placed for t in self.things):
                yield "not at home", name, off

    def _with_all_else_held(self) -> mujoco.MjModel | None:
        """The model with all but the roots of stable objects too heavy to move; None if there are none.

        Joints inside of them are held too: a stable pose is that of an object whose joints do not sag.
        """
        bodies = self._stable
        off = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        if not bodies or self.mjm.opt.disableflags & off:  # nothing rests where nothing is in contact
            return None
        mjm = copy.copy(self.mjm)
        held, _ = self._held(mjm)
        data = mujoco.MjData(mjm)
        mujoco.mj_forward(mjm, data)
        inertia = np.zeros((mjm.nv, mjm.nv))
        mujoco.mj_fullM(mjm, data, inertia)
        mjm.dof_armature[held] = HEAVIER * inertia.diagonal()[held]
        mujoco.mj_setConst(mjm, data)  # how hard contacts are follows from the inertia behind them
        return mjm

    def _held(self, mjm: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Return masks of the entries of qvel and qpos that do not belong to the roots of stable objects."""
        first = np.repeat(np.arange(mjm.njnt), np.diff([*mjm.jnt_qposadr, mjm.nq]))
        return ~np.isin(mjm.dof_bodyid, self._stable), ~np.isin(mjm.jnt_bodyid[first], self._stable)

    def _judge_rest(self, served: Served, row: int) -> Iterator[tuple[str, str, float]]:
        if self._alone is None:
            return
        mjm = self._alone
        held, held_qpos = self._held(mjm)
        data = mujoco.MjData(mjm)
        self._put(mjm, data, served, row)
        mujoco.mj_forward(mjm, data)
        start, qpos = data.xpos.copy(), data.qpos.copy()
        for _ in range(round(REST / mjm.opt.timestep)):
            mujoco.mj_step(mjm, data)
            data.qpos[held_qpos], data.qvel[held] = qpos[held_qpos], 0.0  # what overlaps parts, however heavy it is
        for thing in self.things:
            body = self.mjm.body(thing.body).id
            off = float(np.linalg.norm(data.xpos[body] - start[body]))
            if thing.stable and not off < MOVED:
                yield "moved", thing.name, off


def _without_contacts(mjm: mujoco.MjModel) -> mujoco.MjModel:
    alone = copy.copy(mjm)
    alone.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return alone


def _violations(mjm: mujoco.MjModel, data: mujoco.MjData) -> dict[tuple[str, int], float]:
    """The worst violation of every active equality, and of every limit of a joint or a tendon."""
    found: dict[tuple[str, int], float] = {}
    for row in range(data.nefc):
        kind = _ROWS.get(int(data.efc_type[row]))
        if kind is not None:
            off = float(data.efc_pos[row])
            key = kind, int(data.efc_id[row])
            found[key] = max(found.get(key, 0.0), abs(off) if kind == "equality" else -off)
    return found
