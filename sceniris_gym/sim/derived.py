"""Updates of what follows from model fields that differ by world: subtree masses, reference poses, controls at rest."""

from __future__ import annotations

from typing import ClassVar, Protocol

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.device.transforms import quat_mat
from sceniris_gym.scene.support import subtree
from sceniris_gym.sim.inertia import LEAST, InverseWeights
from sceniris_gym.sim.rest import RestMap, history_samples, rest_value

wp.set_module_options({"enable_backward": False})


class Follower(Protocol):
    """An update of fields that follow from others.

    Attributes:
        SOURCES: Fields that are read.
        OUTPUTS: Fields that are written, which have a row for each world.
    """

    SOURCES: ClassVar[tuple[str, ...]]
    OUTPUTS: ClassVar[tuple[str, ...]]

    def __init__(self, mjm: mujoco.MjModel, m: mjw.Model, d: mjw.Data, rest: RestMap) -> None:
        """Prepare for the worlds of `d`."""

    def launch(self, mask: wp.array) -> None:
        """Bring the fields of the masked worlds up to date; shape (nworld,), bool."""


def components(array: wp.array) -> wp.array:
    """Return a view of an array of floats or vectors, shape (rows, n), as floats (rows, n, length)."""
    length = array.strides[1] // 4 if array.shape[1] else 1
    view = wp.array(ptr=array.ptr, dtype=float, shape=(*array.shape[:2], length), device=array.device)
    view._kept = array  # it owns the memory
    return view


@wp.kernel
def _subtree_masses(
    mask: wp.array[wp.bool],
    # Model in:
    body_end: wp.array[int],
    body_mass: wp.array2d[float],
    # Model out:
    body_subtreemass_out: wp.array2d[float],
):
    worldid, bodyid = wp.tid()
    if not mask[worldid]:
        return
    total = float(0.0)
    for i in range(bodyid, body_end[bodyid]):
        total += body_mass[worldid, i]
    body_subtreemass_out[worldid, bodyid] = total


class SubtreeMasses:
    """Masses of bodies with all below them."""

    SOURCES: ClassVar[tuple[str, ...]] = ("body_mass",)
    OUTPUTS: ClassVar[tuple[str, ...]] = ("body_subtreemass",)

    def __init__(self, mjm: mujoco.MjModel, m: mjw.Model, d: mjw.Data, rest: RestMap) -> None:
        self._model, self._end = m, _ends(mjm, m)

    def launch(self, mask: wp.array) -> None:
        """See `Follower`."""
        m = self._model
        outputs = [m.body_subtreemass]
        wp.launch(_subtree_masses, outputs[0].shape, [mask, self._end, m.body_mass], outputs, device=mask.device)


@wp.func
def _center(
    worldid: int,
    bodyid: int,
    body_end: wp.array[int],
    xpos: wp.array[wp.vec3],
    xmat: wp.array[wp.mat33],
    body_mass: wp.array2d[float],
    body_ipos: wp.array2d[wp.vec3],
) -> wp.vec3:
    """Return the centre of mass of a body and all below it, at qpos0."""
    moment = wp.vec3(0.0)
    total = float(0.0)
    for i in range(bodyid, body_end[bodyid]):
        mass = body_mass[worldid % body_mass.shape[0], i]
        moment += mass * (xpos[i] + xmat[i] * body_ipos[worldid % body_ipos.shape[0], i])
        total += mass
    if total < LEAST:
        return xpos[bodyid] + xmat[bodyid] * body_ipos[worldid % body_ipos.shape[0], bodyid]
    return moment / total


@wp.kernel
def _reference_poses(
    mask: wp.array[wp.bool],
    # Bodies in:
    body_end: wp.array[int],
    xpos: wp.array[wp.vec3],
    xmat: wp.array[wp.mat33],
    body_mass: wp.array2d[float],
    body_ipos: wp.array2d[wp.vec3],
    # Cameras or lights in:
    bodies: wp.array[wp.vec2i],
    pos: wp.array2d[wp.vec3],
    quat: wp.array2d[wp.quat],
    dir: wp.array2d[wp.vec3],
    # Out:
    pos0_out: wp.array2d[wp.vec3],
    poscom0_out: wp.array2d[wp.vec3],
    mat0_out: wp.array2d[wp.mat33],
    dir0_out: wp.array2d[wp.vec3],
):
    worldid, i = wp.tid()
    if not mask[worldid]:
        return
    body = bodies[i][0]
    offset = xmat[body] * pos[worldid % pos.shape[0], i]
    pos0_out[worldid, i] = offset
    center = _center(worldid, bodies[i][1], body_end, xpos, xmat, body_mass, body_ipos)
    poscom0_out[worldid, i] = xpos[body] + offset - center
    if quat:
        q = quat[worldid % quat.shape[0], i]
        mat0_out[worldid, i] = xmat[body] * quat_mat(wp.vec4(q[0], q[1], q[2], q[3]))
    if dir:
        dir0_out[worldid, i] = wp.normalize(xmat[body] * dir[worldid % dir.shape[0], i])


class _ReferencePoses:
    """Poses of cameras or lights at qpos0."""

    KIND: ClassVar[str]

    def __init__(self, mjm: mujoco.MjModel, m: mjw.Model, d: mjw.Data, rest: RestMap) -> None:
        data, kind = mujoco.MjData(mjm), self.KIND
        mujoco.mj_kinematics(mjm, data)
        body, target = (getattr(mjm, f"{kind}_{of}") for of in ("bodyid", "targetbodyid"))
        bodies = np.stack([body, np.where(target >= 0, target, body)], axis=1)
        self._model, self._nworld = m, d.nworld
        with wp.ScopedDevice(m.qpos0.device):
            xpos, xmat = wp.array(data.xpos, dtype=wp.vec3), wp.array(data.xmat.reshape(-1, 3, 3), dtype=wp.mat33)
            self._bodies = [_ends(mjm, m), xpos, xmat]
            self._of = wp.array(bodies, dtype=wp.vec2i)

    def launch(self, mask: wp.array) -> None:
        """See `Follower`."""
        m, kind = self._model, self.KIND
        fields = (
            getattr(m, f"{kind}_{name}", None) for name in ("pos", "quat", "dir", "pos0", "poscom0", "mat0", "dir0")
        )
        pos, quat, dir, *outputs = fields
        inputs = [mask, *self._bodies, m.body_mass, m.body_ipos, self._of, pos, quat, dir]
        wp.launch(_reference_poses, (self._nworld, len(self._of)), inputs, outputs, device=mask.device)


class CameraReferences(_ReferencePoses):
    """Poses of cameras at qpos0."""

    KIND = "cam"
    SOURCES: ClassVar[tuple[str, ...]] = ("cam_pos", "cam_quat", "body_mass", "body_ipos")
    OUTPUTS: ClassVar[tuple[str, ...]] = ("cam_pos0", "cam_poscom0", "cam_mat0")


class LightReferences(_ReferencePoses):
    """Positions and directions of lights at qpos0."""

    KIND = "light"
    SOURCES: ClassVar[tuple[str, ...]] = ("light_pos", "light_dir", "body_mass", "body_ipos")
    OUTPUTS: ClassVar[tuple[str, ...]] = ("light_pos0", "light_poscom0", "light_dir0")


@wp.func
def _is(value: float, wanted: float) -> bool:
    """Tell whether two controls are the same but for rounding."""
    return wp.abs(value - wanted) <= 1.0e-6 * wp.max(1.0, wp.abs(wanted))


@wp.kernel
def _hold_anew(
    mask: wp.array[wp.bool],
    sampleadr: wp.array[int],
    samples: wp.array[int],
    rest: RestMap,
    # Model in:
    actuator_gainprm: wp.array3d[float],
    actuator_biasprm: wp.array3d[float],
    actuator_gear: wp.array2d[wp.spatial_vector],
    # Data in:
    qpos: wp.array2d[float],
    # Data out:
    ctrl_out: wp.array2d[float],
    act_out: wp.array2d[float],
    history_out: wp.array2d[float],
    # Out:
    coef_out: wp.array2d[float],
    bias_out: wp.array2d[float],
):
    worldid, element = wp.tid()
    actuatorid = rest.actuator[element]
    if not mask[worldid] or actuatorid < 0:
        return
    before = rest_value(rest, worldid, element, qpos[worldid])
    gain = actuator_gainprm[worldid % actuator_gainprm.shape[0], actuatorid, 0]
    bias0 = actuator_biasprm[worldid % actuator_biasprm.shape[0], actuatorid, 0]
    bias1 = actuator_biasprm[worldid % actuator_biasprm.shape[0], actuatorid, 1]
    gear = actuator_gear[worldid % actuator_gear.shape[0], actuatorid][0]
    if gain * bias1 >= 0.0:
        return
    bias_out[worldid, element] = -bias0 / gain
    for term in range(rest.rowadr[element], rest.rowadr[element + 1]):
        coef_out[worldid, term] = -bias1 / gain * (gear * rest.arm[term])
    if not ctrl_out:
        return
    now = rest_value(rest, worldid, element, qpos[worldid])
    # controls that hold the present pose follow; those that somebody else has set stay
    nu = ctrl_out.shape[1]
    if element < nu:
        if _is(ctrl_out[worldid, element], before):
            ctrl_out[worldid, element] = now
    elif _is(act_out[worldid, element - nu], before):
        act_out[worldid, element - nu] = now
    for k in range(sampleadr[element], sampleadr[element + 1]):
        if _is(history_out[worldid, samples[k]], before):
            history_out[worldid, samples[k]] = now


class HoldingControls:
    """Controls and activations that hold a pose; those that hold the present one are set anew."""

    SOURCES: ClassVar[tuple[str, ...]] = ("actuator_gainprm", "actuator_biasprm", "actuator_gear")
    OUTPUTS: ClassVar[tuple[str, ...]] = ()

    def __init__(self, mjm: mujoco.MjModel, m: mjw.Model, d: mjw.Data, rest: RestMap) -> None:
        self._model, self._data, self._rest = m, d, rest
        address, element = history_samples(mjm)
        order, count = np.argsort(element, kind="stable"), np.bincount(element, minlength=mjm.nu + mjm.na)
        with wp.ScopedDevice(m.qpos0.device):
            rest.coef, rest.bias = (
                wp.array(np.repeat(values.numpy(), d.nworld, axis=0), dtype=float) for values in (rest.coef, rest.bias)
            )
            self._sampleadr = wp.array(np.concatenate([[0], np.cumsum(count)]), dtype=int)
            self._samples = wp.array(address[order], dtype=int)

    def launch(self, mask: wp.array) -> None:
        """See `Follower`."""
        m, d, rest = self._model, self._data, self._rest
        gains = [components(m.actuator_gainprm), components(m.actuator_biasprm), m.actuator_gear]
        inputs = [mask, self._sampleadr, self._samples, rest, *gains, d.qpos]
        outputs = [d.ctrl, d.act, getattr(d, "history", None), rest.coef, rest.bias]
        wp.launch(_hold_anew, (d.nworld, rest.actuator.shape[0]), inputs, outputs, device=mask.device)


FOLLOWERS: tuple[type[Follower], ...] = (
    SubtreeMasses,
    InverseWeights,
    CameraReferences,
    LightReferences,
    HoldingControls,
)
"""All updates, in an order in which they can run."""


def _ends(mjm: mujoco.MjModel, m: mjw.Model) -> wp.array:
    """Return the number behind the last body below each body, shape (nbody,)."""
    return wp.array([subtree(mjm, b)[-1] + 1 for b in range(mjm.nbody)], dtype=int, device=m.qpos0.device)
