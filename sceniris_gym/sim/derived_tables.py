"""Constants behind fields that follow from others: poses and Jacobians at qpos0, and the places of M in memory."""

from __future__ import annotations

import copy
from collections.abc import Callable

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.scene.support import subtree
from sceniris_gym.sim.rest import JOINT_TRANSMISSIONS
from sceniris_gym.sim.versions import actuator_outputs


@wp.struct
class Derived:
    """Poses and Jacobians at qpos0 in the world frame, the fields of a Model by their names, and scratch memory.

    A transmission is a tendon, or an actuator behind all tendons.

    Attributes:
        body_end: The number behind the last body below a body, shape (nbody,).
        body_block, dof_block: First degree of freedom of the tree that one belongs to, and the number behind the last,
            shapes (nbody,) and (nv,); (0, 0) for a body that no joint moves.
        dof_shared: First and number of the degrees of freedom that one shares its weight with, shape (nv,).
        dof_row: Place of a row of M in `inverse`, from column 0 on, shape (nv,).
        xpos, xmat: Poses of bodies, shape (nbody,).
        jacp: Linear velocity of a body's origin by a degree of freedom, shape (nbody, nv).
        jacr: Angular velocity of a body, likewise.
        element: Row and column of an element of the blocks of M, in the order of `inverse`, shape (size,).
        width: The most degrees of freedom of a tree.
        moment: Moment of a transmission by each element of its gear, shape (ntransmission, nv).
        moved: First degree of freedom of the trees that a transmission moves, and the number behind the last, shape
            (ntransmission,).
        geared: Transmissions whose armature adds to M.
        inverse: M and then its inverse, with a square for each kinematic tree, and as much scratch memory behind it,
            shape (nworld, 2, size).
    """

    body_end: wp.array[int]
    body_block: wp.array[wp.vec2i]
    dof_block: wp.array[wp.vec2i]
    dof_shared: wp.array[wp.vec2i]
    dof_row: wp.array[int]
    xpos: wp.array[wp.vec3]
    xmat: wp.array[wp.mat33]
    jacp: wp.array2d[wp.vec3]
    jacr: wp.array2d[wp.vec3]
    element: wp.array[wp.vec2i]
    width: int
    moment: wp.array2d[wp.spatial_vector]
    moved: wp.array[wp.vec2i]
    geared: wp.array[int]
    inverse: wp.array3d[float]
    body_simple: wp.array[int]
    dof_bodyid: wp.array[int]
    cam_bodyid: wp.array[int]
    cam_targetbodyid: wp.array[int]
    light_bodyid: wp.array[int]
    light_targetbodyid: wp.array[int]
    body_mass: wp.array2d[float]
    body_inertia: wp.array2d[wp.vec3]
    body_ipos: wp.array2d[wp.vec3]
    body_iquat: wp.array2d[wp.quat]
    dof_armature: wp.array2d[float]
    tendon_armature: wp.array2d[float]
    actuator_armature: wp.array2d[float]
    actuator_gear: wp.array2d[wp.spatial_vector]
    cam_pos: wp.array2d[wp.vec3]
    cam_quat: wp.array2d[wp.quat]
    light_pos: wp.array2d[wp.vec3]
    light_dir: wp.array2d[wp.vec3]
    body_subtreemass: wp.array2d[float]
    body_invweight0: wp.array2d[wp.vec2]
    dof_invweight0: wp.array2d[float]
    tendon_invweight0: wp.array2d[float]
    actuator_acc0: wp.array2d[float]
    cam_pos0: wp.array2d[wp.vec3]
    cam_poscom0: wp.array2d[wp.vec3]
    cam_mat0: wp.array2d[wp.mat33]
    light_pos0: wp.array2d[wp.vec3]
    light_poscom0: wp.array2d[wp.vec3]
    light_dir0: wp.array2d[wp.vec3]


def derived_tables(mjm: mujoco.MjModel, nworld: int) -> Derived:
    """Return the constants of a model and scratch memory for `nworld` worlds, on the current device."""
    data = mujoco.MjData(mjm)  # at qpos0
    mujoco.mj_fwdPosition(mjm, data)
    jac = np.zeros((2, mjm.nbody, 3, mjm.nv))
    for b in range(1, mjm.nbody):
        mujoco.mj_jac(mjm, data, jac[0, b], jac[1, b], data.xpos[b], b)
    end = np.array([subtree(mjm, b)[-1] + 1 for b in range(mjm.nbody)])
    trees = np.append(np.stack([mjm.tree_dofadr, mjm.tree_dofadr + mjm.tree_dofnum], axis=1), [[0, 0]], axis=0)
    widths = mjm.tree_dofnum[mjm.dof_treeid]
    squares = np.cumsum(widths)
    driven = np.isin(mjm.actuator_trntype, (*JOINT_TRANSMISSIONS, int(mujoco.mjtTrn.mjTRN_TENDON)))
    driven &= np.any(mjm.actuator_armature)  # armatures that are 0 in the whole model stay so
    t = Derived()
    t.body_end, t.dof_shared = wp.array(end, dtype=int), wp.array(_shared(mjm), dtype=wp.vec2i, ndim=1)
    t.body_block, t.dof_block = (wp.array(trees[ids], dtype=wp.vec2i) for ids in (mjm.body_treeid, mjm.dof_treeid))
    t.dof_row = wp.array(squares - widths - mjm.tree_dofadr[mjm.dof_treeid], dtype=int)
    t.xpos, t.xmat = wp.array(data.xpos, dtype=wp.vec3), wp.array(data.xmat.reshape(-1, 3, 3), dtype=wp.mat33)
    t.jacp, t.jacr = (wp.array(j.transpose(0, 2, 1), dtype=wp.vec3) for j in jac)
    t.element = wp.array(np.argwhere(mjm.dof_treeid[:, None] == mjm.dof_treeid), dtype=wp.vec2i, ndim=1)
    t.width = max(widths, default=0)
    moments = _moments(mjm, data)
    in_trees = [trees[mjm.dof_treeid[moment.any(axis=1)]] for moment in moments]
    moved = [(own[:, 0].min(), own[:, 1].max()) if len(own) else (0, 0) for own in in_trees]
    t.moment, t.moved = wp.array(moments, dtype=wp.spatial_vector, ndim=2), wp.array(moved, dtype=wp.vec2i, ndim=1)
    t.geared = wp.array(np.flatnonzero(np.append(np.ones(mjm.ntendon, bool), driven)), dtype=int)
    t.inverse = wp.zeros((nworld, 2, int(widths.sum())), dtype=float)
    return t


def _shared(mjm: mujoco.MjModel) -> np.ndarray:
    """Return first and number of the degrees of freedom whose weights MuJoCo averages, for each of them."""
    several = np.isin(mjm.jnt_type[mjm.dof_jntid], (int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)))
    number, first = np.where(several, 3, 1), mjm.jnt_dofadr[mjm.dof_jntid]
    dofs = np.arange(mjm.nv)
    return np.stack([dofs - (dofs - first) % number, number], axis=1).astype(np.int32)


def _moments(mjm: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return moments as in `Derived.moment`; of a tendon, by the first element of a gear alone."""
    moments = np.zeros((mjm.ntendon + len(mjm.actuator_trntype), mjm.nv, 6))
    moments[: mjm.ntendon, :, 0] = _rates(mjm, data, lambda: data.ten_velocity)
    geared, outputs = copy.copy(mjm), actuator_outputs(mjm)
    for k in range(6):
        geared.actuator_gear[:] = np.eye(6)[k]
        mujoco.mj_fwdPosition(geared, data)
        moments[mjm.ntendon :, :, k] = _rates(geared, data, lambda: data.actuator_velocity)[outputs]
    return moments


def _rates(mjm: mujoco.MjModel, data: mujoco.MjData, velocities: Callable[[], np.ndarray]) -> np.ndarray:
    """Return the derivative of velocities of tendons or actuators by each degree of freedom, shape (n, nv)."""
    columns = np.zeros((mjm.nv, len(velocities())))
    for k in range(mjm.nv):
        data.qvel[:] = np.arange(mjm.nv) == k
        mujoco.mj_fwdVelocity(mjm, data)
        columns[k] = velocities()
    return columns.T
