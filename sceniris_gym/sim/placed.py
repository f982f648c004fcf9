"""Writes of what is in the scene alone, and environments' origins: resets in models that others reset as well."""

from __future__ import annotations

import warnings
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.errors import MaskError, MaskTypeError, ModelWarning
from sceniris_gym.geometry.contacts import ContactRules
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.write import Poses, RestMap, rest_value

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _write_placed(
    # What is in the scene:
    qposadr: wp.array[int],
    dofadr: wp.array[int],
    mocapid: wp.array[int],
    element: wp.array[int],
    nu: int,
    # RestMap:
    rest_rowadr: wp.array[int],
    rest_qposadr: wp.array[int],
    rest_coef: wp.array[float],
    rest_bias: wp.array[float],
    rest_lower: wp.array[float],
    rest_upper: wp.array[float],
    # Layouts in:
    rows: wp.array[int],
    qpos_in: wp.array2d[float],
    mocap_pos_in: wp.array2d[wp.vec3],
    mocap_quat_in: wp.array2d[wp.quat],
    # Data out:
    qpos_out: wp.array2d[float],
    qvel_out: wp.array2d[float],
    warmstart_out: wp.array2d[float],
    mocap_pos_out: wp.array2d[wp.vec3],
    mocap_quat_out: wp.array2d[wp.quat],
    ctrl_out: wp.array2d[float],
    act_out: wp.array2d[float],
):
    worldid, i = wp.tid()
    row = rows[worldid]
    if row < 0 or row >= qpos_in.shape[0]:
        return

    if i < qposadr.shape[0]:
        qpos_out[worldid, qposadr[i]] = qpos_in[row, qposadr[i]]
    if i < dofadr.shape[0]:
        qvel_out[worldid, dofadr[i]] = 0.0
        warmstart_out[worldid, dofadr[i]] = 0.0
    if i < mocapid.shape[0]:
        mocap_pos_out[worldid, mocapid[i]] = mocap_pos_in[row, mocapid[i]]
        mocap_quat_out[worldid, mocapid[i]] = mocap_quat_in[row, mocapid[i]]
    if i < element.shape[0]:
        e = element[i]
        value = rest_value(rest_rowadr, rest_qposadr, rest_coef, rest_bias, rest_lower, rest_upper, e, qpos_in[row])
        if e < nu:
            ctrl_out[worldid, e] = value
        else:
            act_out[worldid, e - nu] = value


class PlacedWrite:
    """Writes the objects and the robot of a scene, and leaves everything else of a world as it is.

    All joints of these are written, with those that are not drawn at home, and come to rest. Actuators that hold one of
    these joints get its position; other controls stay.

    Args:
        scene: The scene.
        rest: Controls and activations at rest.
        device: The device of the data.

    Attributes:
        controls: The controls that are written, ascending.
    """

    def __init__(self, scene: SceneModel, rest: RestMap, device: wp.Device) -> None:
        mjm = scene.mjm
        joints = np.flatnonzero(np.isin(mjm.jnt_bodyid, bodies_of(scene)))
        widths = np.array([(7, 6), (4, 3), (1, 1), (1, 1)])[mjm.jnt_type[joints]]  # in qpos and in qvel, by type
        qposadr = _spread(mjm.jnt_qposadr[joints], widths[:, 0])
        dofadr = _spread(mjm.jnt_dofadr[joints], widths[:, 1])
        first, terms = rest.rowadr.numpy(), np.isin(rest.qposadr.numpy(), qposadr)
        elements = [e for e in range(len(first) - 1) if terms[first[e] : first[e + 1]].any()]
        self.controls = np.array([e for e in elements if e < mjm.nu], int)
        self._nu, self._rest = mjm.nu, rest
        self._lists = [
            wp.array(values, dtype=wp.int32, ndim=1, device=device)
            for values in (qposadr, dofadr, mocap_of(scene), elements)
        ]

    def launch(self, d: mjw.Data, poses: Poses, rows: wp.array) -> None:
        """Write rows of `poses`; worlds without a row (-1) stay as they are, shape (nworld,), int32."""
        rest, most = self._rest, max(a.shape[0] for a in self._lists)
        wp.launch(
            _write_placed,
            dim=(d.nworld, most),
            inputs=[*self._lists, self._nu]
            + [rest.rowadr, rest.qposadr, rest.coef, rest.bias, rest.lower, rest.upper]
            + [rows, poses.qpos, poses.mocap_pos, poses.mocap_quat],
            outputs=[d.qpos, d.qvel, d.qacc_warmstart, d.mocap_pos, d.mocap_quat, d.ctrl, d.act],
            device=d.qpos.device,
        )


@wp.kernel
def _shift(
    # In:
    qposadr: wp.array[int],
    mocapid: wp.array[int],
    origins: wp.array[wp.vec3],
    mask: wp.array[wp.bool],
    # Data:
    qpos_out: wp.array2d[float],
    mocap_pos_out: wp.array2d[wp.vec3],
):
    worldid, i = wp.tid()
    if not mask[worldid]:
        return
    if i < qposadr.shape[0]:
        for k in range(3):
            qpos_out[worldid, qposadr[i] + k] += origins[worldid][k]
    if i < mocapid.shape[0]:
        mocap_pos_out[worldid, mocapid[i]] += origins[worldid]


class Origins:
    """Moves what was written by the origin of its world: free bodies and mocap bodies.

    Warns with `warn_of_origins`.

    Args:
        scene: The scene.
        origins: Origins [m], world frame, shape (nworld, 3): a Warp array, a torch tensor or a numpy array. Arrays of
            floats on the device of the data are read anew at every reset.
        nworld: Number of worlds.
        device: The device of the data.
        placed_only: Whether only what is in the scene was written.

    Raises:
        MaskTypeError: Not an array of floats.
        MaskError: Wrong shape.
    """

    def __init__(self, scene: SceneModel, origins: Any, nworld: int, device: wp.Device, *, placed_only: bool) -> None:
        mjm = scene.mjm
        free = mjm.jnt_type == mujoco.mjtJoint.mjJNT_FREE
        mocap = mjm.body_mocapid[mjm.body_mocapid >= 0]
        if placed_only:
            free &= np.isin(mjm.jnt_bodyid, bodies_of(scene))
            mocap = mocap_of(scene)
        self._qposadr = wp.array(mjm.jnt_qposadr[free], dtype=wp.int32, ndim=1, device=device)
        self._mocapid = wp.array(mocap, dtype=wp.int32, ndim=1, device=device)
        self._origins = _as_origins(origins, nworld, device)
        warn_of_origins(scene, self._origins.numpy(), "ResetRandomizer: origins")

    def launch(self, d: mjw.Data, mask: wp.array) -> None:
        """Move what was written in the worlds in `mask`, shape (nworld,), bool."""
        wp.launch(
            _shift,
            dim=(d.nworld, max(self._qposadr.shape[0], self._mocapid.shape[0])),
            inputs=[self._qposadr, self._mocapid, self._origins, mask],
            outputs=[d.qpos, d.mocap_pos],
            device=d.qpos.device,
        )


def warn_of_origins(scene: SceneModel, origins: np.ndarray, where: str) -> None:
    """Warn of geoms that stay where they are in every world, whatever its origin, so that layouts do not fit there.

    Those are what collides and is on no free and no mocap body, but for planes, which are the same everywhere.

    Args:
        scene: The scene.
        origins: Origins [m], shape (nworld, 3).
        where: How the warning begins.
    """
    mjm = scene.mjm
    free = mjm.jnt_bodyid[mjm.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
    moves = (mjm.body_mocapid >= 0) | np.isin(np.arange(mjm.nbody), free)
    fixed = ~moves[mjm.body_rootid][mjm.geom_bodyid] & (mjm.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    rules = ContactRules(mjm, scene.config.geometry)
    found = [int(geom) for geom in np.flatnonzero(fixed) if rules.collides(int(geom))]
    if not found or not np.any(origins):
        return
    named = [f"'{mjm.geom(g).name}' of '{mjm.body(int(mjm.geom_bodyid[g])).name}'" for g in found[:3]]
    more = f" and {len(found) - len(named)} more" if len(found) > len(named) else ""
    message = (
        f"{where}: layouts are moved to the origins of their worlds, and what is fixed to the world is not: geoms "
        f"{', '.join(named)}{more}. Unless it is alike at every origin, layouts do not fit around it. Put it on mocap "
        "bodies that are moved as well, or have all origins 0."
    )
    warnings.warn(ModelWarning(message), stacklevel=5)


def bodies_of(scene: SceneModel) -> list[int]:
    """Return the ids of all bodies of a scene's objects and robot, ascending."""
    return sorted({body for name in scene.bodies for body in scene.subtree(name)})


def mocap_of(scene: SceneModel) -> np.ndarray:
    """Return the mocap ids of a scene's objects."""
    ids = scene.mjm.body_mocapid[bodies_of(scene)]
    return ids[ids >= 0]


def _spread(first: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """All addresses of elements that begin at `first` and are `widths` long."""
    return np.array([a + k for a, width in zip(first, widths, strict=True) for k in range(width)], int)


def _as_origins(origins: Any, nworld: int, device: wp.Device) -> wp.array:
    if isinstance(origins, wp.array):
        found = origins
    elif type(origins).__module__ == "torch":
        found = wp.from_torch(origins.detach().float().contiguous(), dtype=wp.vec3)
    else:
        try:
            found = wp.array(np.asarray(origins, np.float32).reshape(-1, 3), dtype=wp.vec3, device=device)
        except (TypeError, ValueError):
            raise MaskTypeError(f"origins should be floats, shape ({nworld}, 3), got {origins!r}.") from None
    if found.dtype is wp.float32 and found.ndim == 2 and found.shape[1] == 3:
        found = found.view(wp.vec3)
    if found.dtype is not wp.vec3 or found.shape != (nworld,):
        raise MaskError(f"origins should be floats of shape ({nworld}, 3), one origin per world, got {origins.shape}.")
    return found.to(device)
