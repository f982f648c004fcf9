"""`StateWriter`: writes layouts into masked worlds of the simulation, either all state or only chosen bodies.

`as_origins` reads the origins of worlds, which resets add to all positions that they write.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, ModelWarning
from sceniris_gym.geometry.contacts import ContactRules
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.masks import as_floats, row_of
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.rest import RestMap, control_at_start, history_samples

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.struct
class Poses:
    """The poses of layouts or worlds on the device.

    Attributes:
        qpos: Joint positions [m, rad], quaternions wxyz, shape (nrow, nq).
        mocap_pos: Positions of mocap bodies [m], world frame, shape (nrow, nmocap).
        mocap_quat: Orientations of mocap bodies, wxyz inside `wp.quat`, shape (nrow, nmocap).
    """

    qpos: wp.array2d[float]
    mocap_pos: wp.array2d[wp.vec3]
    mocap_quat: wp.array2d[wp.quat]


def poses_of(rows: LayoutsView | mjw.Data) -> Poses:
    """Return the poses of layouts or of worlds, as views of their arrays."""
    poses = Poses()  # pyrefly: ignore[missing-argument]
    poses.qpos, poses.mocap_pos, poses.mocap_quat = rows.qpos, rows.mocap_pos, rows.mocap_quat
    return poses


class Addresses(NamedTuple):
    """Addresses of the poses of some bodies, or of the positions of some joints. All arrays are in ascending order.

    Attributes:
        qposadr: Addresses in `qpos` of the joint positions.
        dofadr: Addresses in `qvel` of the joint velocities.
        mocapid: Mocap ids of the bodies that are mocap bodies.
        elements: Elements of `RestMap` that hold one of these joint positions: controls, followed by activations.
    """

    qposadr: np.ndarray
    dofadr: np.ndarray
    mocapid: np.ndarray
    elements: np.ndarray


def addresses_of(
    mjm: mujoco.MjModel, bodies: Sequence[int], rest: RestMap, joints: Sequence[int] | None = None
) -> Addresses:
    """Return the addresses of the poses of `bodies` or, if `joints` are given, of the positions of these joints."""
    chosen = np.isin(np.arange(mjm.nbody), bodies)
    ids = np.flatnonzero(chosen[mjm.jnt_bodyid]) if joints is None else np.array(joints, int)
    joint_of_qpos = np.repeat(np.arange(mjm.njnt), np.diff([*mjm.jnt_qposadr, mjm.nq]))
    qposadr, dofadr = (np.flatnonzero(np.isin(each, ids)) for each in (joint_of_qpos, mjm.dof_jntid))
    first, held = rest.rowadr.numpy(), np.isin(rest.qposadr.numpy(), qposadr)
    elements = [e for e in range(len(first) - 1) if held[first[e] : first[e + 1]].any()]
    mocapid = np.sort(mjm.body_mocapid[chosen & (mjm.body_mocapid >= 0)])
    return Addresses(qposadr, dofadr, mocapid, np.array(elements, int))


@wp.kernel
def _write_state(
    # Lists of addresses to write:
    qposadr: wp.array[int],
    axis: wp.array[int],
    dofadr: wp.array[int],
    mocapid: wp.array[int],
    elemid: wp.array[int],
    sampleadr: wp.array[int],
    sampled: wp.array[int],
    plastic: wp.array[float],
    # In:
    rest: RestMap,
    origins: wp.array[wp.vec3],
    mask: wp.array[wp.bool],
    start: wp.array[int],
    present: wp.array2d[int],
    start_rows: wp.array[int],
    rows: wp.array[int],
    # Poses in: qpos, mocap_pos, mocap_quat
    poses: Poses,
    # Data out:
    qpos_out: wp.array2d[float],
    qvel_out: wp.array2d[float],
    warmstart_out: wp.array2d[float],
    mocap_pos_out: wp.array2d[wp.vec3],
    mocap_quat_out: wp.array2d[wp.quat],
    ctrl_out: wp.array2d[float],
    act_out: wp.array2d[float],
    history_out: wp.array2d[float],
    plastic_out: wp.array2d[float],
    # Out:
    count_out: wp.array[int],
):
    worldid, i = wp.tid()
    if not mask[worldid]:
        return
    if count_out:
        if i == 0:
            count_out[worldid] = 0
    row = row_of(worldid, rows)
    kind, there = int(-1), present[row_of(worldid, start_rows)]
    if start:
        kind = start[row_of(worldid, start_rows)]

    if i < qposadr.shape[0]:
        position = float(poses.qpos[row, qposadr[i]])
        if origins:
            if axis[i] >= 0:
                position += origins[worldid][axis[i]]
        qpos_out[worldid, qposadr[i]] = position
    if i < dofadr.shape[0]:
        qvel_out[worldid, dofadr[i]] = 0.0
        warmstart_out[worldid, dofadr[i]] = 0.0
    if i < mocapid.shape[0]:
        mocap_pos_out[worldid, mocapid[i]] = poses.mocap_pos[row, mocapid[i]]
        if origins:
            mocap_pos_out[worldid, mocapid[i]] += origins[worldid]
        mocap_quat_out[worldid, mocapid[i]] = poses.mocap_quat[row, mocapid[i]]
    # read the layout, not qpos_out or ctrl_out, because other threads of this launch write these arrays
    if i < elemid.shape[0]:
        element, nu = elemid[i], ctrl_out.shape[1]
        if element < nu:
            ctrl_out[worldid, element] = control_at_start(rest, worldid, element, kind, there, poses.qpos[row])
        else:
            act_out[worldid, element - nu] = control_at_start(rest, worldid, element, kind, there, poses.qpos[row])
    if i < sampleadr.shape[0]:
        history_out[worldid, sampleadr[i]] = control_at_start(rest, worldid, sampled[i], kind, there, poses.qpos[row])
    if i < plastic.shape[0]:
        plastic_out[worldid, i] = plastic[i]


class StateWriter:
    """Writes poses into the masked worlds, with the controls and activations that hold them.

    The history of delayed actuators is filled with the same controls. For whole worlds, which `mjw.reset_data` has
    cleared before, the writer sets all positions, controls and activations. For chosen bodies or joints, it sets their
    positions, zeroes their velocities, and sets the actuators that hold them. All other state stays unchanged.

    Args:
        mjm: The model.
        d: Data of the worlds. Launches use its arrays in place.
        mask: Worlds to write into, shape (nworld,), bool. Every launch reads it.
        rest: The RestMap: controls and activations that hold a pose.
        bodies: Ids of the bodies to write. If None, the writer writes `joints` or, without joints, whole worlds.
        joints: Ids of the joints to write, instead of bodies.
        origins: Origins of the worlds [m], shape (nworld,), vec3, or None. Every launch reads them and adds them to the
            positions of free bodies and mocap bodies.
        plastic: Values of MuJoCo's `Data.plastic` in the start pose, shape (nplastic,), for whole worlds.
        count: Counters, one per world, that a launch sets to 0, shape (nworld,), int32.
    """

    def __init__(
        self,
        mjm: mujoco.MjModel,
        d: mjw.Data,
        mask: wp.array,
        rest: RestMap,
        *,
        bodies: Sequence[int] | None = None,
        joints: Sequence[int] | None = None,
        origins: wp.array | None = None,
        plastic: np.ndarray | None = None,
        count: wp.array | None = None,
    ) -> None:
        whole = bodies is None and joints is None
        places = addresses_of(mjm, range(mjm.nbody) if whole else bodies or [], rest, joints)
        free = mjm.jnt_qposadr[mjm.jnt_type == mujoco.mjtJoint.mjJNT_FREE]
        axis = np.full(mjm.nq, -1)  # coordinate of the origin that is added
        axis[free[:, None] + np.arange(3)] = range(3)
        elements = np.arange(mjm.nu + mjm.na) if whole else places.elements
        sampleadr, sampled = history_samples(mjm)
        delayed = np.isin(sampled, elements)
        lists = [
            places.qposadr,
            axis[places.qposadr],
            places.dofadr if not whole else [],
            places.mocapid,
            elements,
            sampleadr[delayed],
            sampled[delayed],
        ]
        device = d.qpos.device
        self._lists = [wp.array(values, dtype=int, ndim=1, device=device) for values in lists]
        self._lists.append(wp.array([] if plastic is None else plastic, dtype=float, ndim=1, device=device))
        self._dim = (d.nworld, max(values.shape[0] for values in self._lists))
        self._inputs = [*self._lists, rest, origins, mask]
        self._outputs = [d.qpos, d.qvel, d.qacc_warmstart, d.mocap_pos, d.mocap_quat, d.ctrl, d.act]
        self._outputs += [getattr(d, name, None) for name in ("history", "plastic")]  # not in all versions
        self._outputs.append(count)

    def launch(
        self,
        poses: Poses,
        rows: wp.array | None = None,
        layouts: LayoutsView | None = None,
        layout_rows: wp.array | None = None,
    ) -> None:
        """Write rows of `poses` into the masked worlds.

        Args:
            poses: The poses to write.
            rows: Row of `poses` for each masked world, shape (nworld,), int32. None gives world i row i.
            layouts: Layouts of a scene with starts. If a gripper holds an object in a layout, its controls close the
                fingers. With None, all controls hold the positions in `poses`.
            layout_rows: Row of `layouts` for each masked world, as `rows`.
        """
        starts = (None, None) if layouts is None else (layouts.start, layouts.present)
        inputs, device = [*self._inputs, *starts, layout_rows, rows, poses], self._outputs[0].device
        wp.launch(_write_state, self._dim, inputs=inputs, outputs=self._outputs, device=device)


def as_origins(origins: Any, nworld: int, device: wp.Device) -> wp.array:
    """Return the origins of worlds [m], world frame, as a Warp array on `device`, shape (nworld,), vec3.

    Args:
        origins: A Warp array, a torch tensor or a numpy array, shape (nworld, 3). Dense float32 arrays on the device
            are not copied.
        nworld: Number of worlds.
        device: The target device.

    Raises:
        ArgumentTypeError: `origins` is not an array of floats.
        ArgumentError: `origins` has another shape.
    """
    try:
        found = as_floats(origins, device)
    except (TypeError, ValueError):
        raise ArgumentTypeError(f"origins should be floats, shape ({nworld}, 3), got {short(origins)}.") from None
    if found.dtype is wp.float32 and found.ndim == 2 and found.shape[1] == 3:
        found = found.view(wp.vec3)
    if found.dtype is not wp.vec3 or found.shape != (nworld,):
        shape = tuple(np.shape(origins))
        raise ArgumentError(f"origins should be floats of shape ({nworld}, 3), one per world, got {shape}.")
    return found.to(device)


def warn_of_origins(scene: SceneModel, origins: np.ndarray, where: str) -> None:
    """Warn of geoms that are fixed to the world, because origins move the layouts but not these geoms.

    A geom is fixed to the world if its tree has no free body and no mocap body. Only geoms that collide count. Planes
    do not count, because they look the same from every origin.

    Args:
        scene: The scene.
        origins: Origins [m], shape (nworld, 3).
        where: Name of the caller. The warning begins with this name.
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
        f"{where}: layouts move to the origins of their worlds, but some geometry stays fixed to the world: geoms "
        f"{', '.join(named)}{more}. Layouts do not fit around these geoms, unless the geoms look the same from every "
        "origin. Put the geoms on mocap bodies that also move to the origins, or set all origins to 0."
    )
    warnings.warn(ModelWarning(message), stacklevel=5)
