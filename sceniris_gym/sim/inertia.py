"""Inverse weights of bodies, joints, tendons and actuators in worlds whose masses differ.

MuJoCo computes them in `mj_setConst`: the diagonal of J M^-1 J^T at qpos0, for the Jacobians J of bodies (at their
centres of mass), joints and tendons, and the norm of M^-1 J^T for actuators. All worlds have the same poses at qpos0,
so the Jacobians at the origins of bodies are found once, on the host. M couples degrees of freedom of one kinematic
tree, and those that a tendon or an actuator ties together: a block.
"""

from __future__ import annotations

from typing import ClassVar

import mujoco
import mujoco_warp as mjw
import warp as wp

from sceniris_gym.device.transforms import quat_mat
from sceniris_gym.sim.inertia_tables import DOF, TENDON, InertiaTables, inertia_tables, ints
from sceniris_gym.sim.rest import RestMap

wp.set_module_options({"enable_backward": False})

_SLIDES = wp.constant(2)
"""Value of `body_simple` for a lone body on slides, which MuJoCo weighs by its mass alone, without armature."""
LEAST = 1.0e-15
"""The smallest value that MuJoCo divides by (mjMINVAL)."""


@wp.func
def _extent(tables: InertiaTables, block: int) -> wp.vec3i:
    """Return the first degree of freedom of a block, their number, and the first element of its matrix."""
    first = tables.blockadr[block]
    return wp.vec3i(first, tables.blockadr[block + 1] - first, tables.matrixadr[block])


@wp.kernel
def _mass_matrix(
    # In:
    tables: InertiaTables,
    mask: wp.array[wp.bool],
    # Model in:
    body_mass: wp.array2d[float],
    body_inertia: wp.array2d[wp.vec3],
    body_ipos: wp.array2d[wp.vec3],
    body_iquat: wp.array2d[wp.quat],
    dof_armature: wp.array2d[float],
    tendon_armature: wp.array2d[float],
    actuator_armature: wp.array2d[float],
    actuator_gear: wp.array2d[wp.spatial_vector],
    # Out:
    matrix_out: wp.array2d[float],
):
    worldid, pairid = wp.tid()
    if not mask[worldid]:
        return
    pair = tables.pair[pairid]
    i = pair[0]
    j = pair[1]
    total = float(0.0)
    for bodyid in range(pair[2], pair[3]):
        ipos = body_ipos[worldid % body_ipos.shape[0], bodyid]
        q = body_iquat[worldid % body_iquat.shape[0], bodyid]
        inertia = body_inertia[worldid % body_inertia.shape[0], bodyid]
        xmat = tables.xmat[bodyid]
        arm = xmat * ipos
        turn = wp.transpose(xmat * quat_mat(wp.vec4(q[0], q[1], q[2], q[3])))
        jacr_i = tables.jacr[bodyid, i]
        jacr_j = tables.jacr[bodyid, j]
        jacp_i = tables.jacp[bodyid, i] + wp.cross(jacr_i, arm)
        jacp_j = tables.jacp[bodyid, j] + wp.cross(jacr_j, arm)
        total += body_mass[worldid % body_mass.shape[0], bodyid] * wp.dot(jacp_i, jacp_j)
        total += wp.dot(wp.cw_mul(inertia, turn * jacr_i), turn * jacr_j)
    for k in range(tables.pair_armature[pairid], tables.pair_armature[pairid + 1]):
        source = tables.armature[k]
        value = float(0.0)
        if source[0] == DOF:
            value = dof_armature[worldid % dof_armature.shape[0], source[1]]
        elif source[0] == TENDON:
            value = tendon_armature[worldid % tendon_armature.shape[0], source[1]]
        else:
            gear = actuator_gear[worldid % actuator_gear.shape[0], source[1]][0]
            value = actuator_armature[worldid % actuator_armature.shape[0], source[1]] * gear * gear
        total += tables.armature_factor[k] * value
    block = _extent(tables, tables.dof_block[i])
    matrix_out[worldid, block[2] + (i - block[0]) * block[1] + j - block[0]] = total


@wp.kernel
def _factor(
    # In:
    tables: InertiaTables,
    mask: wp.array[wp.bool],
    # In and out:
    matrix: wp.array2d[float],
):
    worldid, blockid = wp.tid()
    if not mask[worldid]:
        return
    block = _extent(tables, blockid)
    width = block[1]
    base = block[2]
    for i in range(width):
        for j in range(i + 1):
            total = matrix[worldid, base + i * width + j]
            for k in range(j):
                total -= matrix[worldid, base + i * width + k] * matrix[worldid, base + j * width + k]
            if i == j:
                matrix[worldid, base + i * width + i] = wp.sqrt(wp.max(total, LEAST))
            else:
                matrix[worldid, base + i * width + j] = total / matrix[worldid, base + j * width + j]


@wp.kernel
def _invert(
    # In:
    tables: InertiaTables,
    mask: wp.array[wp.bool],
    matrix: wp.array2d[float],
    # Out:
    inverse_out: wp.array2d[float],
):
    worldid, place = wp.tid()
    if not mask[worldid]:
        return
    block = _extent(tables, tables.dof_block[place])
    width = block[1]
    base = block[2]
    column = place - block[0]
    # row `column` of the symmetric inverse, by forward and backward substitution in place
    at = base + column * width
    for i in range(width):
        total = wp.where(i == column, 1.0, 0.0)
        for k in range(i):
            total -= matrix[worldid, base + i * width + k] * inverse_out[worldid, at + k]
        inverse_out[worldid, at + i] = total / matrix[worldid, base + i * width + i]
    for back in range(width):
        i = width - 1 - back
        total = inverse_out[worldid, at + i]
        for k in range(i + 1, width):
            total -= matrix[worldid, base + k * width + i] * inverse_out[worldid, at + k]
        inverse_out[worldid, at + i] = total / matrix[worldid, base + i * width + i]


@wp.kernel
def _body_weights(
    # In:
    tables: InertiaTables,
    mask: wp.array[wp.bool],
    inverse: wp.array2d[float],
    # Model in:
    body_simple: wp.array[int],
    body_mass: wp.array2d[float],
    body_ipos: wp.array2d[wp.vec3],
    # Model out:
    body_invweight0_out: wp.array2d[wp.vec2],
):
    worldid, bodyid = wp.tid()
    if not mask[worldid] or tables.body_block[bodyid] < 0:
        return
    if body_simple[bodyid] == _SLIDES:
        body_invweight0_out[worldid, bodyid] = wp.vec2(1.0 / body_mass[worldid % body_mass.shape[0], bodyid], 0.0)
        return
    block = _extent(tables, tables.body_block[bodyid])
    first = block[0]
    width = block[1]
    arm = tables.xmat[bodyid] * body_ipos[worldid % body_ipos.shape[0], bodyid]
    linear = float(0.0)
    angular = float(0.0)
    for i in range(width):
        jacr_i = tables.jacr[bodyid, first + i]
        jacp_i = tables.jacp[bodyid, first + i] + wp.cross(jacr_i, arm)
        for j in range(width):
            jacr_j = tables.jacr[bodyid, first + j]
            jacp_j = tables.jacp[bodyid, first + j] + wp.cross(jacr_j, arm)
            weight = inverse[worldid, block[2] + i * width + j]
            linear += weight * wp.dot(jacp_i, jacp_j)
            angular += weight * wp.dot(jacr_i, jacr_j)
    body_invweight0_out[worldid, bodyid] = wp.vec2(linear, angular) / 3.0


@wp.kernel
def _dof_weights(
    # In:
    tables: InertiaTables,
    mask: wp.array[wp.bool],
    inverse: wp.array2d[float],
    # Model in:
    body_simple: wp.array[int],
    body_mass: wp.array2d[float],
    dof_bodyid: wp.array[int],
    # Model out:
    dof_invweight0_out: wp.array2d[float],
):
    worldid, partid = wp.tid()
    if not mask[worldid]:
        return
    part = tables.part[partid]
    total = float(0.0)
    bodyid = dof_bodyid[part[0]]
    if body_simple[bodyid] == _SLIDES:
        dof_invweight0_out[worldid, part[0]] = 1.0 / body_mass[worldid % body_mass.shape[0], bodyid]
        return
    for dofid in range(part[0], part[0] + part[1]):
        place = tables.dof_place[dofid]
        block = _extent(tables, tables.dof_block[place])
        total += inverse[worldid, block[2] + (place - block[0]) * (block[1] + 1)]
    for dofid in range(part[0], part[0] + part[1]):
        dof_invweight0_out[worldid, dofid] = total / float(part[1])


@wp.kernel
def _tendon_weights(
    # In:
    tables: InertiaTables,
    mask: wp.array[wp.bool],
    inverse: wp.array2d[float],
    # Model out:
    tendon_invweight0_out: wp.array2d[float],
):
    worldid, tendonid = wp.tid()
    if not mask[worldid] or tables.tendon_block[tendonid] < 0:
        return
    block = _extent(tables, tables.tendon_block[tendonid])
    first = block[0]
    width = block[1]
    total = float(0.0)
    for i in range(width):
        for j in range(width):
            weight = inverse[worldid, block[2] + i * width + j]
            total += weight * tables.tendon_jac[tendonid, first + i] * tables.tendon_jac[tendonid, first + j]
    tendon_invweight0_out[worldid, tendonid] = total


@wp.kernel
def _actuator_accelerations(
    # In:
    tables: InertiaTables,
    mask: wp.array[wp.bool],
    inverse: wp.array2d[float],
    # Model in:
    actuator_gear: wp.array2d[wp.spatial_vector],
    # Model out:
    actuator_acc0_out: wp.array2d[float],
):
    worldid, actuatorid = wp.tid()
    if not mask[worldid] or tables.actuator_block[actuatorid] < 0:
        return
    block = _extent(tables, tables.actuator_block[actuatorid])
    first = block[0]
    width = block[1]
    gear = actuator_gear[worldid % actuator_gear.shape[0], actuatorid]
    total = float(0.0)
    for i in range(width):
        acceleration = float(0.0)
        for j in range(width):
            moment = float(0.0)
            for k in range(6):
                moment += gear[k] * tables.actuator_jac[actuatorid, k, first + j]
            acceleration += inverse[worldid, block[2] + i * width + j] * moment
        total += acceleration * acceleration
    actuator_acc0_out[worldid, actuatorid] = wp.sqrt(total)


class InverseWeights:
    """Updates inverse weights of the masked worlds from masses, inertias, armatures and gears of their own.

    Args:
        mjm: The model.
        m: The Model; its arrays are used in place, those of OUTPUTS with a row for each world.
        d: Data of the worlds.
        rest: Not used.
    """

    SOURCES: ClassVar[tuple[str, ...]] = (
        *("body_mass", "body_inertia", "body_ipos", "body_iquat", "dof_armature", "tendon_armature"),
        *("actuator_armature", "actuator_gear"),
    )
    OUTPUTS: ClassVar[tuple[str, ...]] = ("body_invweight0", "dof_invweight0", "tendon_invweight0", "actuator_acc0")

    def __init__(self, mjm: mujoco.MjModel, m: mjw.Model, d: mjw.Data, rest: RestMap | None = None) -> None:
        self._model, self._nworld = m, d.nworld
        with wp.ScopedDevice(m.qpos0.device):
            self._tables, size = inertia_tables(mjm)
            self._matrix, self._inverse = (wp.zeros((d.nworld, size), dtype=float) for _ in range(2))
            self._none, self._simple = wp.zeros((1, 0), dtype=float), ints(mjm.body_simple)

    def launch(self, mask: wp.array) -> None:
        """Bring the inverse weights of the masked worlds up to date; shape (nworld,), bool."""
        m, tables = self._model, self._tables

        def launch(kernel: wp.Kernel, count: int, inputs: list, *outputs: wp.array) -> None:
            if count:
                inputs = [tables, mask, *inputs]
                wp.launch(kernel, dim=(self._nworld, count), inputs=inputs, outputs=outputs, device=mask.device)

        armatures = [getattr(m, name, self._none) for name in self.SOURCES[:-1]]
        launch(_mass_matrix, len(tables.pair), [*armatures, m.actuator_gear], self._matrix)
        launch(_factor, len(tables.matrixadr), [], self._matrix)
        launch(_invert, m.nv, [self._matrix], self._inverse)
        bodies = [self._inverse, self._simple, m.body_mass]
        launch(_body_weights, m.nbody, [*bodies, m.body_ipos], m.body_invweight0)
        launch(_dof_weights, len(tables.part), [*bodies, m.dof_bodyid], m.dof_invweight0)
        launch(_tendon_weights, m.ntendon, [self._inverse], m.tendon_invweight0)
        accelerations = [self._inverse, m.actuator_gear]
        launch(_actuator_accelerations, len(tables.actuator_block), accelerations, m.actuator_acc0)
