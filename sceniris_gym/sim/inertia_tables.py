"""Constants behind inverse weights: Jacobians of bodies, tendons and actuators at qpos0, and blocks of M."""

from __future__ import annotations

import copy
from collections.abc import Callable
from itertools import pairwise

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.scene.support import subtree
from sceniris_gym.sim.rest import JOINT_TRANSMISSIONS
from sceniris_gym.sim.versions import actuator_outputs

DOF, TENDON, ACTUATOR = 0, 1, 2
"""Fields that armature comes from."""


@wp.struct
class InertiaTables:
    """Constants of M and of Jacobians at qpos0. Degrees of freedom are in the order of blocks; frames are the world's.

    Attributes:
        blockadr: First degree of freedom of a block, shape (nblock + 1,).
        matrixadr: First element of a block's square matrix, shape (nblock,).
        dof_place: Place of a degree of freedom in this order, shape (nv,).
        dof_block: Block of the degree of freedom at a place, shape (nv,).
        body_block: Block that moves a body, -1 for none, shape (nbody,).
        xmat: Orientations of bodies, shape (nbody,).
        jacp: Linear velocity of a body's origin by a degree of freedom, shape (nbody, nv).
        jacr: Angular velocity of a body, likewise.
        pair: Row and column of a place in the lower half of a block's matrix, and the first and the last but one body
            that both move, shape (npair,).
        pair_armature: First armature of a pair, shape (npair + 1,).
        armature: Field, element and unused, of an armature that adds to a pair.
        armature_factor: Its factor.
        part: First degree of freedom (in the model's order) and number of them of a part of a joint, shape (npart,).
        tendon_block: Block of a tendon, -1 for none, shape (ntendon,).
        tendon_jac: Jacobians of tendons, shape (ntendon, nv).
        actuator_block: Block of an actuator, -1 for none, shape (nactuator,).
        actuator_jac: Moment of an actuator by each element of its gear, shape (nactuator, 6, nv).
    """

    blockadr: wp.array[int]
    matrixadr: wp.array[int]
    dof_place: wp.array[int]
    dof_block: wp.array[int]
    body_block: wp.array[int]
    xmat: wp.array[wp.mat33]
    jacp: wp.array2d[wp.vec3]
    jacr: wp.array2d[wp.vec3]
    pair: wp.array[wp.vec4i]
    pair_armature: wp.array[int]
    armature: wp.array[wp.vec2i]
    armature_factor: wp.array[float]
    part: wp.array[wp.vec2i]
    tendon_block: wp.array[int]
    tendon_jac: wp.array2d[float]
    actuator_block: wp.array[int]
    actuator_jac: wp.array3d[float]


def inertia_tables(mjm: mujoco.MjModel) -> tuple[InertiaTables, int]:
    """Return the constants of a model, and the number of elements of all blocks."""
    data = mujoco.MjData(mjm)  # at qpos0
    mujoco.mj_fwdPosition(mjm, data)
    jac = np.zeros((2, mjm.nbody, 3, mjm.nv))
    for b in range(1, mjm.nbody):
        mujoco.mj_jac(mjm, data, jac[0, b], jac[1, b], data.xpos[b], b)
    tendon_jac = _rates(mjm, data, lambda: data.ten_velocity)
    actuator_jac, geared = [], copy.copy(mjm)
    for k in range(6):
        geared.actuator_gear[:] = np.eye(6)[k]
        mujoco.mj_fwdPosition(geared, data)
        actuator_jac.append(_rates(geared, data, lambda: data.actuator_velocity)[actuator_outputs(mjm)])
    rows = [*tendon_jac, *np.abs(actuator_jac).sum(axis=0)]
    block = _blocks(mjm, rows)
    order = np.argsort(block, kind="stable")
    place, sizes = np.argsort(order), np.bincount(block, minlength=0)
    adr = np.concatenate([[0], np.cumsum(sizes)])
    last_dof = np.array([_last_dof(mjm, b) for b in range(mjm.nbody)])
    pairs = [(i, j) for first, end in pairwise(adr) for i in range(first, end) for j in range(first, i + 1)]
    bodies = [_moved_by_both(mjm, *order[[i, j]]) for i, j in pairs]
    armatures = _armatures(mjm, tendon_jac)
    of_pairs = [armatures.get((max(order[[i, j]]), min(order[[i, j]])), []) for i, j in pairs]
    flat = [armature for each in of_pairs for armature in each]
    t = InertiaTables()
    t.blockadr, t.matrixadr = ints(adr), ints(np.cumsum(sizes**2) - sizes**2)
    t.dof_place, t.dof_block = ints(place), ints(block[order])
    t.body_block = ints(np.where(last_dof >= 0, block[last_dof] if mjm.nv else -1, -1))
    t.xmat = wp.array(data.xmat.reshape(-1, 3, 3), dtype=wp.mat33)
    t.jacp, t.jacr = (wp.array(j.transpose(0, 2, 1)[:, order], dtype=wp.vec3) for j in jac)
    t.pair = wp.array(np.array([(*p, *b) for p, b in zip(pairs, bodies, strict=True)]).reshape(-1, 4), dtype=wp.vec4i)
    t.pair_armature = ints(np.cumsum([0, *map(len, of_pairs)]))
    t.armature = wp.array(np.array([(kind, i) for kind, i, _ in flat]).reshape(-1, 2), dtype=wp.vec2i)
    t.armature_factor = wp.array([factor for _, _, factor in flat], dtype=float)
    t.part = wp.array(np.array(_parts(mjm)).reshape(-1, 2), dtype=wp.vec2i)
    t.tendon_block, t.actuator_block = (
        ints([block[np.flatnonzero(r)[0]] if np.any(r) else -1 for r in part])
        for part in (rows[: mjm.ntendon], rows[mjm.ntendon :])
    )
    t.tendon_jac = wp.array(tendon_jac[:, order], dtype=float)
    t.actuator_jac = wp.array(np.array(actuator_jac).transpose(1, 0, 2)[:, :, order], dtype=float)
    return t, int((sizes**2).sum())


def ints(values: np.ndarray | list) -> wp.array:
    """Return integers as an array on the current device."""
    return wp.array(np.array(values, np.int32), dtype=int)


def _rates(mjm: mujoco.MjModel, data: mujoco.MjData, velocities: Callable[[], np.ndarray]) -> np.ndarray:
    """Return the derivative of velocities of tendons or actuators by each degree of freedom, shape (n, nv)."""
    columns = np.zeros((mjm.nv, len(velocities())))
    for k in range(mjm.nv):
        data.qvel[:] = 0.0
        data.qvel[k] = 1.0
        mujoco.mj_fwdVelocity(mjm, data)
        columns[k] = velocities()
    return columns.T


def _blocks(mjm: mujoco.MjModel, rows: list[np.ndarray]) -> np.ndarray:
    """Return the block of each degree of freedom: trees, joined where a tendon or an actuator moves several."""
    block = mjm.dof_treeid.copy()
    for row in rows:
        tied = block[np.flatnonzero(row)]
        block[np.isin(block, tied)] = tied.min(initial=len(block))
    return np.unique(block, return_inverse=True)[1]


def _last_dof(mjm: mujoco.MjModel, body: int) -> int:
    """Return the last degree of freedom that moves a body; -1 if none does."""
    while body > 0 and mjm.body_dofnum[body] == 0:
        body = mjm.body_parentid[body]
    return int(mjm.body_dofadr[body] + mjm.body_dofnum[body] - 1) if body > 0 else -1


def _moved_by_both(mjm: mujoco.MjModel, i: int, j: int) -> tuple[int, int]:
    """Return the first and the last but one body that two degrees of freedom move; (0, 0) for none."""
    lower, upper = max(i, j), min(i, j)
    dof = lower
    while dof > upper:
        dof = mjm.dof_parentid[dof]
    simple = lower != upper and mjm.body_simple[mjm.dof_bodyid[lower]]  # MuJoCo keeps the diagonal alone
    if dof != upper or simple:
        return 0, 0
    body = int(mjm.dof_bodyid[lower])
    return body, subtree(mjm, body)[-1] + 1


def _armatures(mjm: mujoco.MjModel, tendon_jac: np.ndarray) -> dict[tuple[int, int], list[tuple[int, int, float]]]:
    """Return field, element and factor of the armatures that add to each place of M, by degrees of freedom."""
    found: dict[tuple[int, int], list[tuple[int, int, float]]] = {(d, d): [(DOF, d, 1.0)] for d in range(mjm.nv)}

    def add(kind: int, element: int, tendon: int) -> None:
        tied = np.flatnonzero(tendon_jac[tendon]).tolist()
        for i in tied:
            for j in tied[: tied.index(i) + 1]:
                if not any(_moved_by_both(mjm, i, j)):
                    continue  # MuJoCo has no place for it in M
                factor = float(tendon_jac[tendon, i] * tendon_jac[tendon, j])
                found.setdefault((i, j), []).append((kind, element, factor))

    for tendon in range(mjm.ntendon if hasattr(mjm, "tendon_armature") else 0):
        add(TENDON, tendon, tendon)
    for a in range(len(mjm.actuator_trntype) if hasattr(mjm, "actuator_armature") else 0):
        target = int(mjm.actuator_trnid[a, 0])
        if mjm.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_TENDON:
            add(ACTUATOR, a, target)
        elif mjm.actuator_trntype[a] in JOINT_TRANSMISSIONS:
            for d in np.flatnonzero(mjm.dof_jntid == target).tolist():
                found[d, d].append((ACTUATOR, a, 1.0))
    return found


def _parts(mjm: mujoco.MjModel) -> list[tuple[int, int]]:
    """Return first and number of the degrees of freedom whose weights MuJoCo averages."""
    parts = []
    for kind, first in zip(mjm.jnt_type, mjm.jnt_dofadr, strict=True):
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            parts += [(first, 3), (first + 3, 3)]
        else:
            parts.append((first, 3 if kind == mujoco.mjtJoint.mjJNT_BALL else 1))
    return parts
