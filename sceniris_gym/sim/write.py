"""Writes layouts into the simulation's Data by mask: positions, mocap poses, activations and controls."""

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.sim.versions import actuator_controls, actuator_outputs

wp.set_module_options({"enable_backward": False})

# as integers: `numpy.int32(0) in (enum member,)` is false although both are equal
CTRL_HOLDS = tuple(
    int(d) for d in (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
)
ACT_HOLDS = (*CTRL_HOLDS, int(mujoco.mjtDyn.mjDYN_INTEGRATOR))
JOINT_TRANSMISSIONS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
SCALAR_JOINTS = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))


class Poses(NamedTuple):
    """The poses of layouts on the device.

    Attributes:
        qpos: Joint positions [m, rad], quaternions wxyz, shape (nrow, nq).
        mocap_pos: Positions of mocap bodies [m], world frame, shape (nrow, nmocap).
        mocap_quat: Their orientations, wxyz inside `wp.quat`, shape (nrow, nmocap).
    """

    qpos: wp.array
    mocap_pos: wp.array
    mocap_quat: wp.array


@dataclass(frozen=True)
class RestMap:
    """Controls and activations at rest, each an affine function of qpos: `bias + sum(coef * qpos[qposadr])`.

    Element e has the terms `rowadr[e]` to `rowadr[e + 1]`; the nu controls come first, then the na activations.

    Attributes:
        rowadr: First term of an element, shape (nu + na + 1,).
        qposadr: Address in qpos of a term.
        coef: Factor of a term.
        bias: Constant part, shape (nu + na,); the home value of an element that holds no pose and has no terms.
        lower: Lower limit, shape (nu + na,).
        upper: Upper limit, shape (nu + na,).
    """

    rowadr: wp.array
    qposadr: wp.array
    coef: wp.array
    bias: wp.array
    lower: wp.array
    upper: wp.array


@wp.func
def rest_value(
    rowadr: wp.array[int],
    qposadr: wp.array[int],
    coef: wp.array[float],
    bias: wp.array[float],
    lower: wp.array[float],
    upper: wp.array[float],
    elemid: int,
    qpos: wp.array[float],
) -> float:
    """Element `elemid` of a `RestMap`, given by its fields, at the joint positions `qpos` (nq,)."""
    value = bias[elemid]
    for term in range(rowadr[elemid], rowadr[elemid + 1]):
        value += coef[term] * qpos[qposadr[term]]
    return wp.clamp(value, lower[elemid], upper[elemid])


@wp.kernel
def _rows_of_mask(mask: wp.array[wp.bool], rows_out: wp.array[int]):
    worldid = wp.tid()
    rows_out[worldid] = wp.where(mask[worldid], worldid, -1)


@wp.kernel
def _mask_of_rows(rows: wp.array[int], nrow: int, mask_out: wp.array[wp.bool]):
    worldid = wp.tid()
    mask_out[worldid] = rows[worldid] >= 0 and rows[worldid] < nrow


@wp.kernel
def _mask_of_ids(ids: wp.array[int], mask_out: wp.array[wp.bool]):
    worldid = ids[wp.tid()]
    if worldid >= 0 and worldid < mask_out.shape[0]:
        mask_out[worldid] = True


@wp.kernel
def _write_state(
    # Sizes:
    nq: int,
    nmocap: int,
    nu: int,
    na: int,
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
    mocap_pos_out: wp.array2d[wp.vec3],
    mocap_quat_out: wp.array2d[wp.quat],
    ctrl_out: wp.array2d[float],
    act_out: wp.array2d[float],
):
    worldid, elemid = wp.tid()
    row = rows[worldid]
    if row < 0 or row >= qpos_in.shape[0]:
        return

    if elemid < nq:
        qpos_out[worldid, elemid] = qpos_in[row, elemid]
    if elemid < nmocap:
        mocap_pos_out[worldid, elemid] = mocap_pos_in[row, elemid]
        mocap_quat_out[worldid, elemid] = mocap_quat_in[row, elemid]
    if elemid < nu + na:
        # from the layout, not from qpos_out: other threads of this launch are writing that
        value = rest_value(
            rest_rowadr, rest_qposadr, rest_coef, rest_bias, rest_lower, rest_upper, elemid, qpos_in[row]
        )
        if elemid < nu:
            ctrl_out[worldid, elemid] = value
        else:
            act_out[worldid, elemid - nu] = value


@wp.kernel
def _write_values(mask: wp.array[wp.bool], values: wp.array[float], out: wp.array2d[float]):
    worldid, elemid = wp.tid()
    if mask[worldid]:
        out[worldid, elemid] = values[elemid]


def rows_of_mask(mask: wp.array, rows_out: wp.array) -> None:
    """Fill `rows_out` (nworld,) int32: world i takes row i where `mask` is true, none (-1) elsewhere."""
    wp.launch(_rows_of_mask, dim=mask.shape[0], inputs=[mask], outputs=[rows_out], device=mask.device)


def mask_of_rows(rows: wp.array, nrow: int, mask_out: wp.array) -> None:
    """Fill `mask_out` (nworld,) bool: true where `rows` names one of `nrow` rows."""
    wp.launch(_mask_of_rows, dim=rows.shape[0], inputs=[rows, nrow], outputs=[mask_out], device=rows.device)


def mask_of_ids(ids: wp.array, mask_out: wp.array) -> None:
    """Fill `mask_out` (nworld,) bool: true for the worlds in `ids` (n,) int32, false for the others."""
    mask_out.zero_()
    wp.launch(_mask_of_ids, dim=ids.shape[0], inputs=[ids], outputs=[mask_out], device=mask_out.device)


def write_values(values: wp.array, mask: wp.array, out: wp.array) -> None:
    """Write `values` (n,) into the rows of `out` (nworld, n) where `mask` (nworld,) is true."""
    wp.launch(_write_values, dim=out.shape, inputs=[mask, values], outputs=[out], device=mask.device)


def write_state(m: mjw.Model, d: mjw.Data, rest: RestMap, poses: Poses, rows: wp.array) -> None:
    """Write rows of `poses` into qpos, mocap poses, ctrl and act; worlds without a row stay as they are.

    Args:
        m: Model of the worlds.
        d: Data of the worlds.
        rest: Controls and activations at rest.
        poses: The poses to write.
        rows: Row of `poses` for every world, -1 for none, shape (nworld,), int32.
    """
    wp.launch(
        _write_state,
        dim=(d.nworld, max(m.nq, m.nmocap, m.nu + m.na)),
        inputs=[
            m.nq,
            m.nmocap,
            m.nu,
            m.na,
            rest.rowadr,
            rest.qposadr,
            rest.coef,
            rest.bias,
            rest.lower,
            rest.upper,
            rows,
            poses.qpos,
            poses.mocap_pos,
            poses.mocap_quat,
        ],
        outputs=[d.qpos, d.mocap_pos, d.mocap_quat, d.ctrl, d.act],
        device=d.qpos.device,
    )


def rest_map(mjm: mujoco.MjModel, home_ctrl: np.ndarray, home_act: np.ndarray, device: str | None) -> RestMap:
    """Find the controls and activations that hold a pose.

    A position actuator (a fixed gain and an affine bias that pulls against its length) holds the pose when its input
    is `-(bias0 + bias1 * length) / gain`, with `length = gear * qpos` of its joint, or `gear * sum(coef * qpos)`
    of its fixed tendon. Its input is the control, or the activation behind a filter or an integrator. All
    other actuators, those over spatial tendons included, take their home values.

    Args:
        mjm: The model.
        home_ctrl: Controls of the home pose, shape (nu,).
        home_act: Activations of the home pose, shape (na,).
        device: The target device.
    """
    nu, na = mjm.nu, mjm.na
    bias = np.concatenate([home_ctrl, home_act]).astype(float)
    lower, upper = np.full(nu + na, -np.inf), np.full(nu + na, np.inf)
    terms: list[list[tuple[int, float]]] = [[] for _ in range(nu + na)]
    ctrladr, ctrlnum = actuator_controls(mjm)
    for i in range(len(ctrladr)):
        length = _length_terms(mjm, i)
        gain, bias0, bias1 = mjm.actuator_gainprm[i, 0], *mjm.actuator_biasprm[i, :2]
        holds = (
            mjm.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_FIXED
            and mjm.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_AFFINE
            and gain * bias1 < 0
            and ctrlnum[i] == 1
            and mjm.actuator_actnum[i] <= 1
        )
        if not holds or length is None:
            continue
        dyntype, inputs = int(mjm.actuator_dyntype[i]), []
        if dyntype in CTRL_HOLDS:
            inputs.append(ctrladr[i])
        if mjm.actuator_actnum[i] == 1 and dyntype in ACT_HOLDS:
            inputs.append(nu + mjm.actuator_actadr[i])
        for e in inputs:
            bias[e] = -bias0 / gain
            terms[e] = [(adr, -bias1 / gain * coef) for adr, coef in length]
            limited, limits = (
                (mjm.actuator_ctrllimited, mjm.actuator_ctrlrange)
                if e < nu
                else (mjm.actuator_actlimited, mjm.actuator_actrange)
            )
            which = e if e < nu else i  # control ranges are listed by control, activation ranges by actuator
            if limited[which]:
                lower[e], upper[e] = limits[which]
    flat = [term for row in terms for term in row]

    def on_device(values: object, dtype: type) -> wp.array:
        return wp.array(values, dtype=dtype, device=device)

    return RestMap(
        rowadr=on_device(np.cumsum([0] + [len(row) for row in terms]), wp.int32),
        qposadr=on_device([adr for adr, _ in flat], wp.int32),
        coef=on_device([coef for _, coef in flat], wp.float32),
        bias=on_device(bias, wp.float32),
        lower=on_device(lower, wp.float32),
        upper=on_device(upper, wp.float32),
    )


def _length_terms(mjm: mujoco.MjModel, actuator: int) -> list[tuple[int, float]] | None:
    """Return (qpos address, factor) pairs that sum to an actuator's length, or None where it is not linear in qpos."""
    gear = float(mjm.actuator_gear[actuator_outputs(mjm)[actuator], 0])
    trntype, target = int(mjm.actuator_trntype[actuator]), int(mjm.actuator_trnid[actuator, 0])
    if trntype in JOINT_TRANSMISSIONS:
        joints = [(target, 1.0)]
    elif trntype == mujoco.mjtTrn.mjTRN_TENDON:
        wraps = range(mjm.tendon_adr[target], mjm.tendon_adr[target] + mjm.tendon_num[target])
        if any(mjm.wrap_type[w] != mujoco.mjtWrap.mjWRAP_JOINT for w in wraps):
            return None
        joints = [(mjm.wrap_objid[w], float(mjm.wrap_prm[w])) for w in wraps]
    else:
        return None
    if any(int(mjm.jnt_type[j]) not in SCALAR_JOINTS for j, _ in joints):
        return None
    return [(int(mjm.jnt_qposadr[j]), gear * coef) for j, coef in joints]
