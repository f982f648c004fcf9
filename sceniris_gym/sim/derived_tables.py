"""Constants for derived fields: poses and Jacobians at qpos0, and the memory layout of the mass matrix M."""

import copy
from collections.abc import Sequence

import mujoco
import numpy as np
import warp as wp

from sceniris_gym.scene.field_table import JOINT_TRANSMISSIONS
from sceniris_gym.scene.support import subtree
from sceniris_gym.sim.versions import actuator_outputs


@wp.struct
class Derived:
    """Poses and Jacobians at qpos0 in the world frame, the fields of a Model by name, and scratch memory.

    The Jacobian rows are, in this order: the linear velocity of each body's origin, the angular velocity of each body,
    each degree of freedom, each tendon, each actuator for the first three elements of its gear, and each actuator for
    the last three elements.

    Attributes:
        body_end: End of a body's subtree: the id after the last body of the subtree, shape (nbody,).
        dof_block: For each degree of freedom, the range of all degrees of freedom in its tree: the first, and the one
            after the last, shape (nv,).
        shared_root: For each body below the root of a tree that variants share, the root, otherwise 0, shape (nbody,).
            In rows and columns of these bodies, kernels compute poses and Jacobians from fields of each world.
        xpos, xmat: Poses of bodies, shape (nbody,).
        jacobian: Rows of Jacobians, shape (nrow, nv), vec3. The three degrees of freedom of a ball joint share one
            inverse weight, and so do the three rotations and the three translations of a free joint. The row of such a
            degree of freedom therefore has entries in the columns of all three, each with the axis of its column.
        moved: For each row of `jacobian`, a range of degrees of freedom that includes all trees with an effect on the
            row: the first, and the one after the last. The two rows of an actuator share one range, at the first row.
        geared: Rows of tendons and actuators whose armature adds to M.
        inverse: M, which the kernel replaces by its inverse, and scratch memory of the same size. Shape (nworld, 2, nv,
            degrees of freedom of the largest tree). The row of a degree of freedom has only the columns of its tree.
    """

    # Tables
    body_end: wp.array[int]
    dof_block: wp.array[wp.vec2i]
    shared_root: wp.array[int]
    xpos: wp.array[wp.vec3]
    xmat: wp.array[wp.mat33]
    jacobian: wp.array2d[wp.vec3]
    moved: wp.array[wp.vec2i]
    geared: wp.array[int]
    # Scratch memory
    inverse: wp.array4d[float]
    # Fields
    body_simple: wp.array[int]
    body_parentid: wp.array[int]
    body_pos: wp.array2d[wp.vec3]
    body_quat: wp.array2d[wp.quat]
    dof_bodyid: wp.array[int]
    dof_jntid: wp.array[int]
    jnt_type: wp.array[int]
    jnt_pos: wp.array2d[wp.vec3]
    jnt_axis: wp.array2d[wp.vec3]
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
    # Following fields
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


def derived_tables(mjm: mujoco.MjModel, nworld: int, roots: Sequence[int] = ()) -> Derived:
    """Return the `Derived` of a model, with scratch memory for `nworld` worlds, on the current device.

    `roots` has the root bodies of objects with variants.
    """
    data = mujoco.MjData(mjm)  # at qpos0
    mujoco.mj_fwdPosition(mjm, data)
    trees = np.stack([mjm.tree_dofadr, mjm.tree_dofadr + mjm.tree_dofnum], axis=1)[mjm.dof_treeid]
    driven = np.isin(mjm.actuator_trntype, (*JOINT_TRANSMISSIONS, int(mujoco.mjtTrn.mjTRN_TENDON)))
    driven &= np.any(mjm.actuator_armature)  # a field that is 0 in the whole model cannot vary
    transmissions = np.concatenate([np.ones(mjm.ntendon, bool), driven, driven])
    t = Derived()  # pyrefly: ignore[missing-argument]
    t.body_end = wp.array([subtree(mjm, b)[-1] + 1 for b in range(mjm.nbody)], dtype=int)
    t.dof_block = wp.array(trees, dtype=wp.vec2i, ndim=1)
    shared_root = np.zeros(mjm.nbody, int)
    for root in roots:
        shared_root[subtree(mjm, root)[1:]] = root
    t.shared_root = wp.array(shared_root, dtype=int)
    t.xpos, t.xmat = wp.array(data.xpos, dtype=wp.vec3), wp.array(data.xmat.reshape(-1, 3, 3), dtype=wp.mat33)
    rows = _jacobians(mjm, data)
    t.jacobian = wp.array(rows, dtype=wp.vec3, ndim=2)
    depends = np.any(rows != 0.0, axis=2)
    for first, number in ((0, mjm.nbody), (len(rows) - 2 * len(driven), len(driven))):
        depends[first : first + number] |= depends[first + number : first + 2 * number]  # of both rows
    moved = [(trees[on, 0].min(), trees[on, 1].max()) if on.any() else (0, 0) for on in depends]
    t.moved = wp.array(moved[: len(rows) - len(driven)], dtype=wp.vec2i, ndim=1)
    t.geared = wp.array(2 * mjm.nbody + mjm.nv + np.flatnonzero(transmissions), dtype=int)
    t.inverse = wp.zeros((nworld, 2, mjm.nv, max(mjm.tree_dofnum, default=0)), dtype=float)
    # all MuJoCo versions have this field, but not all MuJoCo-Warp versions
    t.actuator_armature = wp.array(mjm.actuator_armature[None], dtype=float)
    return t


def _jacobians(mjm: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return rows of Jacobians as in `Derived.jacobian`, shape (nrow, nv, 3)."""
    bodies = np.zeros((2, mjm.nbody, 3, mjm.nv))
    for b in range(1, mjm.nbody):
        mujoco.mj_jac(mjm, data, bodies[0, b], bodies[1, b], data.xpos[b], b)
    several = np.isin(mjm.jnt_type[mjm.dof_jntid], (int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)))
    number = np.where(several, 3, 1)
    axis = (np.arange(mjm.nv) - mjm.jnt_dofadr[mjm.dof_jntid]) % number
    shared = np.arange(mjm.nv) - axis
    dofs = (shared[:, None] == shared)[..., None] * np.eye(3)[axis] / np.sqrt(number)[:, None]
    tendons, actuators = np.zeros((mjm.ntendon, mjm.nv, 3)), np.zeros((2, len(mjm.actuator_trntype), mjm.nv, 3))
    geared = copy.copy(mjm)
    for k in range(6):
        geared.actuator_gear[:] = np.eye(6)[k]
        mujoco.mj_fwdPosition(geared, data)
        for i in range(mjm.nv):  # unit velocity of one degree of freedom
            data.qvel[:] = np.arange(mjm.nv) == i
            mujoco.mj_fwdVelocity(geared, data)
            tendons[:, i, 0] = data.ten_velocity
            actuators[k // 3, :, i, k % 3] = data.actuator_velocity[actuator_outputs(mjm)]
    return np.concatenate([*bodies.transpose(0, 1, 3, 2), dofs, tendons, *actuators])
