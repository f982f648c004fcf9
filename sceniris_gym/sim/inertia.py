"""Inverse weights of bodies, joints, tendons and actuators in worlds whose masses differ.

MuJoCo computes them in `mj_setConst`: the diagonal of J M^-1 J^T at qpos0, for the Jacobians J of bodies (at their
centres of mass), joints and tendons, and the norm of M^-1 J^T for actuators. All worlds have the same poses at qpos0,
so the Jacobians at the origins of bodies are found once, on the host. M couples degrees of freedom of one kinematic
tree alone.
"""

from __future__ import annotations

from typing import ClassVar

import mujoco
import mujoco_warp as mjw
import warp as wp

from sceniris_gym.device.transforms import quat_mat
from sceniris_gym.sim.inertia_tables import Inertia, inertia_tables
from sceniris_gym.sim.rest import RestMap

wp.set_module_options({"enable_backward": False})

LEAST = 1.0e-15
"""The smallest value that MuJoCo divides by (mjMINVAL)."""


@wp.func
def _inverse(w: Inertia, worldid: int, i: int, j: int) -> float:
    """Return an element of M^-1, of two degrees of freedom of one tree."""
    block = w.block[w.dof_treeid[i]]
    return w.inverse[worldid, block[2] + (i - block[0]) * block[1] + j - block[0]]


@wp.func
def _armature(w: Inertia, worldid: int, tendonid: int, actuatorid: int) -> float:
    """Return the armature of a tendon, or of an actuator in the units of what it moves."""
    if tendonid >= 0:
        return w.tendon_armature[worldid % w.tendon_armature.shape[0], tendonid]
    gear = w.actuator_gear[worldid % w.actuator_gear.shape[0], actuatorid][0]
    return w.actuator_armature[worldid % w.actuator_armature.shape[0], actuatorid] * gear * gear


@wp.kernel
def _mass_matrix(
    mask: wp.array[wp.bool],
    # Inertia in: block, dof_treeid, xmat, jacp, jacr, pair, geared, geared_jac, body_mass, body_inertia, body_ipos,
    #   body_iquat, dof_armature, tendon_armature, actuator_armature, actuator_gear
    # Inertia out: matrix
    w: Inertia,
):
    worldid, pairid = wp.tid()
    if not mask[worldid]:
        return
    pair = w.pair[pairid]
    i = pair[0]
    j = pair[1]
    total = float(0.0)
    for bodyid in range(pair[2], pair[3]):
        q = w.body_iquat[worldid % w.body_iquat.shape[0], bodyid]
        inertia = w.body_inertia[worldid % w.body_inertia.shape[0], bodyid]
        arm = w.xmat[bodyid] * w.body_ipos[worldid % w.body_ipos.shape[0], bodyid]
        turn = wp.transpose(w.xmat[bodyid] * quat_mat(wp.vec4(q[0], q[1], q[2], q[3])))
        jacr_i = w.jacr[bodyid, i]
        jacr_j = w.jacr[bodyid, j]
        jacp = wp.dot(w.jacp[bodyid, i] + wp.cross(jacr_i, arm), w.jacp[bodyid, j] + wp.cross(jacr_j, arm))
        total += w.body_mass[worldid % w.body_mass.shape[0], bodyid] * jacp
        total += wp.dot(wp.cw_mul(inertia, turn * jacr_i), turn * jacr_j)
    if i == j:
        total += w.dof_armature[worldid % w.dof_armature.shape[0], i]
    if pair[3] > 0:  # MuJoCo has a place for it in M
        for k in range(w.geared.shape[0]):
            square = w.geared_jac[k, i] * w.geared_jac[k, j]
            if square != 0.0:
                total += square * _armature(w, worldid, w.geared[k][0], w.geared[k][1])
    block = w.block[w.dof_treeid[i]]
    w.matrix[worldid, block[2] + (i - block[0]) * block[1] + j - block[0]] = total


@wp.kernel
def _factor(
    mask: wp.array[wp.bool],
    # Inertia in: block, matrix
    # Inertia out: matrix
    w: Inertia,
):
    worldid, treeid = wp.tid()
    if not mask[worldid]:
        return
    width = w.block[treeid][1]
    base = w.block[treeid][2]
    for i in range(width):
        for j in range(i + 1):
            total = w.matrix[worldid, base + i * width + j]
            for k in range(j):
                total -= w.matrix[worldid, base + i * width + k] * w.matrix[worldid, base + j * width + k]
            if i == j:
                w.matrix[worldid, base + i * width + i] = wp.sqrt(wp.max(total, LEAST))
            else:
                w.matrix[worldid, base + i * width + j] = total / w.matrix[worldid, base + j * width + j]


@wp.kernel
def _invert(
    mask: wp.array[wp.bool],
    # Inertia in: block, dof_treeid, matrix, inverse
    # Inertia out: inverse
    w: Inertia,
):
    worldid, dofid = wp.tid()
    if not mask[worldid]:
        return
    block = w.block[w.dof_treeid[dofid]]
    width = block[1]
    base = block[2]
    # a row of the symmetric inverse, by forward and backward substitution in place
    at = base + (dofid - block[0]) * width
    for i in range(width):
        total = wp.where(i == dofid - block[0], 1.0, 0.0)
        for k in range(i):
            total -= w.matrix[worldid, base + i * width + k] * w.inverse[worldid, at + k]
        w.inverse[worldid, at + i] = total / w.matrix[worldid, base + i * width + i]
    for back in range(width):
        i = width - 1 - back
        total = w.inverse[worldid, at + i]
        for k in range(i + 1, width):
            total -= w.matrix[worldid, base + k * width + i] * w.inverse[worldid, at + k]
        w.inverse[worldid, at + i] = total / w.matrix[worldid, base + i * width + i]


@wp.kernel
def _body_weights(
    mask: wp.array[wp.bool],
    # Inertia in: block, dof_treeid, body_treeid, body_slides, xmat, jacp, jacr, inverse, body_mass, body_ipos
    # Inertia out: body_invweight0
    w: Inertia,
):
    worldid, bodyid = wp.tid()
    if not mask[worldid] or w.body_treeid[bodyid] < 0:
        return
    if w.body_slides[bodyid] == 1:
        w.body_invweight0[worldid, bodyid] = wp.vec2(1.0 / w.body_mass[worldid % w.body_mass.shape[0], bodyid], 0.0)
        return
    block = w.block[w.body_treeid[bodyid]]
    arm = w.xmat[bodyid] * w.body_ipos[worldid % w.body_ipos.shape[0], bodyid]
    weight = wp.vec2(0.0)
    for i in range(block[0], block[0] + block[1]):
        jacr = w.jacr[bodyid, i]
        jacp = w.jacp[bodyid, i] + wp.cross(jacr, arm)
        for j in range(block[0], block[0] + block[1]):
            other = w.jacp[bodyid, j] + wp.cross(w.jacr[bodyid, j], arm)
            weight += _inverse(w, worldid, i, j) * wp.vec2(wp.dot(jacp, other), wp.dot(jacr, w.jacr[bodyid, j]))
    w.body_invweight0[worldid, bodyid] = weight / 3.0


@wp.kernel
def _dof_weights(
    mask: wp.array[wp.bool],
    # Inertia in: block, dof_treeid, dof_part, dof_bodyid, body_slides, inverse, body_mass
    # Inertia out: dof_invweight0
    w: Inertia,
):
    worldid, dofid = wp.tid()
    if not mask[worldid]:
        return
    part = w.dof_part[dofid]
    total = float(0.0)
    for i in range(part[0], part[0] + part[1]):
        total += _inverse(w, worldid, i, i)
    bodyid = w.dof_bodyid[dofid]
    if w.body_slides[bodyid] == 1:
        total = 1.0 / w.body_mass[worldid % w.body_mass.shape[0], bodyid]
    w.dof_invweight0[worldid, dofid] = total / float(part[1])


@wp.kernel
def _transmission_weights(
    mask: wp.array[wp.bool],
    # Inertia in: block, dof_treeid, inverse
    w: Inertia,
    jac: wp.array2d[wp.spatial_vector],
    gears: wp.array2d[wp.spatial_vector],
    is_norm: bool,
    # Out:
    weight_out: wp.array2d[float],
):
    """J M^-1 J^T of tendons, or the norm of M^-1 J^T of actuators."""
    worldid, i = wp.tid()
    if not mask[worldid]:
        return
    gear = gears[worldid % gears.shape[0], i]
    total = float(0.0)
    for k in range(jac.shape[1]):
        moment = wp.dot(gear, jac[i, k])
        if is_norm or moment != 0.0:
            acceleration = float(0.0)
            block = w.block[w.dof_treeid[k]]
            for j in range(block[0], block[0] + block[1]):
                acceleration += _inverse(w, worldid, k, j) * wp.dot(gear, jac[i, j])
            total += acceleration * wp.where(is_norm, acceleration, moment)
    weight_out[worldid, i] = wp.where(is_norm, wp.sqrt(total), total)


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
            self._inertia = inertia_tables(mjm, d.nworld)
            if not hasattr(m, "actuator_armature"):  # MuJoCo has it in all versions, MuJoCo-Warp does not
                self._inertia.actuator_armature = wp.array(mjm.actuator_armature[None], dtype=float)

    def launch(self, mask: wp.array) -> None:
        """Bring the inverse weights of the masked worlds up to date; shape (nworld,), bool."""
        m, w = self._model, self._inertia
        for name in self.SOURCES + self.OUTPUTS:
            if name in Inertia.vars and hasattr(m, name):  # some are not in all versions
                setattr(w, name, getattr(m, name))
        steps = (
            (_mass_matrix, len(w.pair)),
            (_factor, len(w.block)),
            (_invert, m.nv),
            (_body_weights, m.nbody),
            (_dof_weights, m.nv),
        )
        for kernel, count in steps:
            wp.launch(kernel, dim=(self._nworld, count), inputs=[mask, w], device=mask.device)
        for more in (
            [w.tendon_jac, w.no_gear, False, m.tendon_invweight0],
            [w.actuator_jac, m.actuator_gear, True, m.actuator_acc0],
        ):
            dim = (self._nworld, more[0].shape[0])
            wp.launch(_transmission_weights, dim, inputs=[mask, w, *more], device=mask.device)
