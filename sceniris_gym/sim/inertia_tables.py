"""Constants behind inverse weights: Jacobians of bodies, tendons and actuators at qpos0, and blocks of M."""

from __future__ import annotations

import copy
from collections.abc import Callable

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.scene.support import subtree
from sceniris_gym.sim.rest import JOINT_TRANSMISSIONS
from sceniris_gym.sim.versions import actuator_outputs

SLIDES = 2
"""Value of `body_simple` for a lone body on slides, which MuJoCo weighs by its mass alone, without armature."""


@wp.struct
class Inertia:
    """Constants of M and of Jacobians at qpos0 in the world frame, the fields of a Model, and scratch memory.

    Attributes:
        block: First degree of freedom of a kinematic tree, their number, and the first element of its square matrix in
            `matrix` and `inverse`, shape (ntree,).
        dof_treeid: Tree of a degree of freedom, shape (nv,).
        dof_part: First and number of the degrees of freedom that it shares its weight with, shape (nv,).
        dof_bodyid: Body of a degree of freedom, shape (nv,).
        body_treeid: Tree that moves a body, -1 for none, shape (nbody,).
        body_slides: 1 for a lone body on slides, shape (nbody,).
        xmat: Orientations of bodies, shape (nbody,).
        jacp: Linear velocity of a body's origin by a degree of freedom, shape (nbody, nv).
        jacr: Angular velocity of a body, likewise.
        pair: Row and column of a place in the lower half of a tree's matrix, and the first and the last but one body
            that both move, shape (npair,).
        geared: Tendon or -1, and actuator or -1, whose armature adds to M, shape (ngeared,).
        geared_jac: Jacobian of what it moves with, shape (ngeared, nv).
        tendon_jac: Jacobians of tendons, as moments by the first element of a gear, shape (ntendon, nv).
        actuator_jac: Moment of an actuator by each element of its gear, shape (nactuator, nv).
        no_gear: The gear of a tendon, shape (1, ntendon).
        matrix: M, and then its Cholesky factor, shape (nworld, size).
        inverse: The inverse of M, likewise.
    """

    block: wp.array[wp.vec3i]
    dof_treeid: wp.array[int]
    dof_part: wp.array[wp.vec2i]
    dof_bodyid: wp.array[int]
    body_treeid: wp.array[int]
    body_slides: wp.array[int]
    xmat: wp.array[wp.mat33]
    jacp: wp.array2d[wp.vec3]
    jacr: wp.array2d[wp.vec3]
    pair: wp.array[wp.vec4i]
    geared: wp.array[wp.vec2i]
    geared_jac: wp.array2d[float]
    tendon_jac: wp.array2d[wp.spatial_vector]
    actuator_jac: wp.array2d[wp.spatial_vector]
    no_gear: wp.array2d[wp.spatial_vector]
    matrix: wp.array2d[float]
    inverse: wp.array2d[float]
    body_mass: wp.array2d[float]
    body_inertia: wp.array2d[wp.vec3]
    body_ipos: wp.array2d[wp.vec3]
    body_iquat: wp.array2d[wp.quat]
    dof_armature: wp.array2d[float]
    tendon_armature: wp.array2d[float]
    actuator_armature: wp.array2d[float]
    actuator_gear: wp.array2d[wp.spatial_vector]
    body_invweight0: wp.array2d[wp.vec2]
    dof_invweight0: wp.array2d[float]


def inertia_tables(mjm: mujoco.MjModel, nworld: int) -> Inertia:
    """Return the constants of a model and scratch memory for `nworld` worlds, on the current device."""
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
    widths = np.bincount(mjm.dof_treeid)
    squares = np.cumsum(widths**2)
    pairs = [(i, j) for i in range(mjm.nv) for j in range(i + 1) if mjm.dof_treeid[i] == mjm.dof_treeid[j]]
    geared, geared_jac = _geared(mjm, tendon_jac)
    one = np.eye(6)[0]
    t = Inertia()
    t.block = vectors(list(zip(np.cumsum(widths) - widths, widths, squares - widths**2, strict=True)), wp.vec3i)
    t.dof_treeid, t.dof_bodyid, t.body_treeid = (ints(a) for a in (mjm.dof_treeid, mjm.dof_bodyid, mjm.body_treeid))
    t.dof_part, t.body_slides = vectors(_parts(mjm), wp.vec2i), ints(mjm.body_simple == SLIDES)
    t.xmat = wp.array(data.xmat.reshape(-1, 3, 3), dtype=wp.mat33)
    t.jacp, t.jacr = (wp.array(j.transpose(0, 2, 1), dtype=wp.vec3) for j in jac)
    t.pair = vectors([(*pair, *_moved_by_both(mjm, *pair)) for pair in pairs], wp.vec4i)
    t.geared, t.geared_jac = vectors(geared, wp.vec2i), wp.array(geared_jac, dtype=float, ndim=2)
    t.tendon_jac = wp.array(tendon_jac[:, :, None] * one, dtype=wp.spatial_vector)
    t.no_gear = wp.array(np.tile(one, (1, mjm.ntendon, 1)), dtype=wp.spatial_vector)
    t.actuator_jac = wp.array(np.array(actuator_jac).transpose(1, 2, 0), dtype=wp.spatial_vector)
    t.matrix, t.inverse = (wp.zeros((nworld, int(squares[-1]) if len(squares) else 0), dtype=float) for _ in range(2))
    return t


def ints(values: np.ndarray | list) -> wp.array:
    """Return integers as an array on the current device."""
    return wp.array(np.array(values, np.int32), dtype=int)


def vectors(values: list, dtype: type) -> wp.array:
    """Return rows of integers as an array of vectors on the current device."""
    return wp.array(np.array(values, np.int32).reshape(-1, len(dtype())), dtype=dtype)


def _rates(mjm: mujoco.MjModel, data: mujoco.MjData, velocities: Callable[[], np.ndarray]) -> np.ndarray:
    """Return the derivative of velocities of tendons or actuators by each degree of freedom, shape (n, nv)."""
    columns = np.zeros((mjm.nv, len(velocities())))
    for k in range(mjm.nv):
        data.qvel[:] = 0.0
        data.qvel[k] = 1.0
        mujoco.mj_fwdVelocity(mjm, data)
        columns[k] = velocities()
    return columns.T


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


def _geared(mjm: mujoco.MjModel, tendon_jac: np.ndarray) -> tuple[list[tuple[int, int]], np.ndarray]:
    """Return what has an armature beside degrees of freedom, as in `Inertia.geared`, and its Jacobian (n, nv)."""
    found = [((t, -1), tendon_jac[t]) for t in range(mjm.ntendon if hasattr(mjm, "tendon_armature") else 0)]
    for a in range(len(mjm.actuator_trntype) if hasattr(mjm, "actuator_armature") else 0):
        target = int(mjm.actuator_trnid[a, 0])
        if mjm.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_TENDON:
            found.append(((-1, a), tendon_jac[target]))
        elif mjm.actuator_trntype[a] in JOINT_TRANSMISSIONS:
            found += [((-1, a), np.eye(mjm.nv)[dof]) for dof in np.flatnonzero(mjm.dof_jntid == target)]
    return [which for which, _ in found], np.reshape([jac for _, jac in found], (-1, mjm.nv))


def _parts(mjm: mujoco.MjModel) -> list[tuple[int, int]]:
    """Return first and number of the degrees of freedom whose weights MuJoCo averages, for each of them."""
    parts = []
    for kind, first in zip(mjm.jnt_type, mjm.jnt_dofadr, strict=True):
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            parts += [(first, 3)] * 3 + [(first + 3, 3)] * 3
        else:
            parts += [(first, 3)] * 3 if kind == mujoco.mjtJoint.mjJNT_BALL else [(first, 1)]
    return parts
