"""`RestMap`: the controls and activations that hold a pose. A reset computes them on the device.

If an episode starts with an object in a gripper, the gripper's controls close the fingers.
"""

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.grasping.gripper import squeezing_controls
from sceniris_gym.layout.masks import selects
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.field_table import JOINT_TRANSMISSIONS
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import subtree
from sceniris_gym.sim.versions import actuator_controls, actuator_outputs

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

GAINS = ("actuator_gainprm", "actuator_biasprm", "actuator_gear")
"""Fields of a Model that determine controls at rest."""
# as integers: `numpy.int32(0) in (enum member,)` is false although both are equal
CTRL_HOLDS = tuple(
    int(d) for d in (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
)
ACT_HOLDS = (*CTRL_HOLDS, int(mujoco.mjtDyn.mjDYN_INTEGRATOR))
SCALAR_JOINTS = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))


@wp.struct
class RestMap:
    """Controls and activations that hold the pose qpos. A value is `law[0] + law[1] * sum(arm * qpos[qposadr])`.

    Arrays of shape (nu + na,) have an element for each control, then one for each activation. If an element holds a
    pose, its sum has one term for each joint that its actuator moves. Element e has the terms from `rowadr[e]` to
    `rowadr[e + 1] - 1`.

    Attributes:
        rowadr: Index of each element's first term, shape (nu + na + 1,).
        qposadr: Address in qpos of each term's joint.
        arm: Factor of each term (its moment arm): 1, or the joint's coefficient in a fixed tendon.
        law: The two numbers `law[0]` and `law[1]` of each element, shape (1, nu + na), or (nworld, nu + na) if gains
            differ between worlds. An element without terms has its home value and 0.
        lower: Lower limit of each element, shape (nu + na,).
        upper: Upper limit of each element, shape (nu + na,).
        actuator: Id of the actuator that holds a pose through the element, or -1, shape (nu + na,).
        carried: For an actuator of one joint that carries a tool centre point: the joint, the first body that the joint
            carries, the end of the range of these bodies, and 1 for a hinge or 0 for a slide. -1 for all other
            elements. Shape (nu + na,).
        sampleadr: Addresses in `history` of the past controls of delayed actuators.
        sampled: Id of the control at each of these addresses.
        press: For each kind of start in the scene file and each slot, how firmly controls close the fingers on the
            object if it is present: at 1 completely, and at 0 not at all, shape (nkind, nslot). Empty without starts.
        closed: For each kind, qpos of the closed fingers of its arm, and nan for all other joints, shape (nkind, nq).
        squeezing: For each kind, controls at which motors close its hand with the most force, and nan for all other
            elements, shape (nkind, nu + na).
    """

    rowadr: wp.array[int]
    qposadr: wp.array[int]
    arm: wp.array[float]
    law: wp.array2d[wp.vec2]
    lower: wp.array[float]
    upper: wp.array[float]
    actuator: wp.array[int]
    carried: wp.array[wp.vec4i]
    sampleadr: wp.array[int]
    sampled: wp.array[int]
    press: wp.array2d[float]
    closed: wp.array2d[float]
    squeezing: wp.array2d[float]


@wp.func
def rest_value(rest: RestMap, worldid: int, elemid: int, qpos: wp.array[float]) -> float:
    """Return the value with which element `elemid` of a RestMap holds the joint positions `qpos`, shape (nq,)."""
    law = rest.law[worldid % rest.law.shape[0], elemid]
    length = float(0.0)
    for term in range(rest.rowadr[elemid], rest.rowadr[elemid + 1]):
        length += rest.arm[term] * qpos[rest.qposadr[term]]
    return wp.clamp(law[0] + law[1] * length, rest.lower[elemid], rest.upper[elemid])


@wp.func
def control_at_start(
    rest: RestMap, worldid: int, elemid: int, kind: int, present: wp.array[int], qpos: wp.array[float]
) -> float:
    """Return the value of element `elemid` of a RestMap at the start of an episode, for joint positions `qpos`.

    If the world starts with an object in a gripper, the elements of this gripper close its fingers. `kind` is the
    world's kind of start, or -1 in a scene without starts. `present` is nonzero for the slots of present objects.
    """
    term = rest.rowadr[elemid]
    if kind >= 0 and kind < rest.press.shape[0]:
        for slot in range(rest.press.shape[1]):
            press = rest.press[kind, slot]
            if press > 0.0 and present[slot] != 0:
                if not wp.isnan(rest.squeezing[kind, elemid]):
                    return press * rest.squeezing[kind, elemid]
                # a number only if the element drives fingers
                if term < rest.rowadr[elemid + 1]:
                    if not wp.isnan(rest.closed[kind, rest.qposadr[term]]):
                        closed = rest_value(rest, worldid, elemid, rest.closed[kind])
                        return press * closed + (1.0 - press) * rest_value(rest, worldid, elemid, qpos)
    return rest_value(rest, worldid, elemid, qpos)


@wp.kernel
def _controls(
    rest: RestMap, kind: wp.array[int], present: wp.array2d[int], qpos: wp.array2d[float], out: wp.array2d[float]
):
    row, elemid = wp.tid()
    out[row, elemid] = control_at_start(rest, 0, elemid, kind[row], present[row], qpos[row])


def controls_at_start(rest: RestMap, start: np.ndarray, present: np.ndarray, qpos: np.ndarray) -> np.ndarray:
    """Return the elements of the first world of a RestMap on a CPU at the start of stored layouts, shape (nrow, n).

    Args:
        rest: The RestMap.
        start: The kind of start of each layout, or -1, shape (nrow,).
        present: Whether each slot's object is present, shape (nrow, nslot).
        qpos: Joint positions, shape (nrow, nq).
    """
    found = wp.zeros((len(qpos), len(rest.lower)), dtype=float, device="cpu")
    inputs = [rest, start.astype(np.int32), present.astype(np.int32), qpos.astype(np.float32), found]
    wp.launch(_controls, found.shape, inputs, device="cpu")
    return found.numpy()


def affine_law(rest: RestMap, nq: int) -> tuple[np.ndarray, np.ndarray]:
    """Return c (n,) and F (n, nq). The n elements of the first world are c + F @ qpos, before they are clipped."""
    constants, slopes = rest.law.numpy()[0].T
    rows, factors = np.repeat(np.arange(len(slopes)), np.diff(rest.rowadr.numpy())), np.zeros((len(slopes), nq))
    np.add.at(factors, (rows, rest.qposadr.numpy()), slopes[rows] * rest.arm.numpy())
    return constants, factors


def scene_rest(scene: SceneModel, device: wp.Device, nworld: int = 1) -> RestMap:
    """Return the RestMap of a scene, with `nworld` rows of its law.

    Controls and activations that cannot hold a pose have their home values.
    """
    mjm, key = scene.mjm, scene.keyframe
    rest = rest_map(mjm, scene.home_ctrl, mjm.key_act[key] if key >= 0 else np.zeros(mjm.na), device)
    first, held, carried = rest.rowadr.numpy(), np.append(rest.qposadr.numpy(), -1), rest.carried.numpy()
    only = np.where(np.diff(first) == 1, held[first[:-1]], -1)  # address of the only joint of each element
    tips = {int(mjm.site_bodyid[i]) for i in range(mjm.nsite) if mjm.site(i).name in scene.tcps.values()}
    for joint, body in enumerate(mjm.jnt_bodyid.tolist()):
        bodies = subtree(mjm, body)
        if tips.intersection(bodies):
            is_hinge = mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
            carried[only == mjm.jnt_qposadr[joint]] = joint, body, bodies[-1] + 1, is_hinge
    rest.carried = wp.array(carried, dtype=wp.vec4i, ndim=1, device=device)
    rest.law = wp.array(np.repeat(rest.law.numpy(), nworld, axis=0), dtype=wp.vec2, ndim=2, device=device)
    return rest


def rest_map(
    mjm: mujoco.MjModel, home_ctrl: np.ndarray, home_act: np.ndarray, device: str | wp.Device | None
) -> RestMap:
    """Return the RestMap of a model, with the controls and activations that hold a pose.

    A position actuator (a fixed gain and an affine bias that pulls against its length) holds the pose when its input
    is `-(bias0 + bias1 * length) / gain`, with `length = gear * qpos` of its joint, or `gear * sum(coef * qpos)`
    of its fixed tendon. Its input is the control, or the activation behind a filter or an integrator. All other
    actuators, including actuators of spatial tendons, take their home values.

    Args:
        mjm: The model.
        home_ctrl: Controls of the home pose, shape (nu,).
        home_act: Activations of the home pose, shape (na,).
        device: The target device.
    """
    nu, na = mjm.nu, mjm.na
    law = np.stack([np.concatenate([home_ctrl, home_act]).astype(float), np.zeros(nu + na)], axis=1)
    lower, upper = np.full(nu + na, -np.inf), np.full(nu + na, np.inf)
    terms: list[list[tuple[int, float]]] = [[] for _ in range(nu + na)]
    actuator = np.full(nu + na, -1)
    ctrladr, ctrlnum = actuator_controls(mjm)
    gains, gears = mjm.actuator_gainprm[:, 0], mjm.actuator_gear[actuator_outputs(mjm), 0]
    holds = (mjm.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED) & (ctrlnum == 1) & (mjm.actuator_actnum <= 1)
    holds &= (mjm.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE) & (gains * mjm.actuator_biasprm[:, 1] < 0)
    for i in np.flatnonzero(holds).tolist():
        length = _length_terms(mjm, i)
        if length is None:
            continue
        bias0, bias1 = mjm.actuator_biasprm[i, :2]
        dyntype, inputs = int(mjm.actuator_dyntype[i]), []
        if dyntype in CTRL_HOLDS:
            inputs.append((ctrladr[i], ctrladr[i], mjm.actuator_ctrllimited, mjm.actuator_ctrlrange))
        if mjm.actuator_actnum[i] == 1 and dyntype in ACT_HOLDS:
            inputs.append((nu + mjm.actuator_actadr[i], i, mjm.actuator_actlimited, mjm.actuator_actrange))
        # control ranges are listed by control, activation ranges by actuator
        for e, which, limited, limits in inputs:
            law[e], actuator[e], terms[e] = (-bias0 / gains[i], -bias1 / gains[i] * gears[i]), i, length
            if limited[which]:
                lower[e], upper[e] = limits[which]
    flat = [term for row in terms for term in row]
    rest = RestMap()  # pyrefly: ignore[missing-argument]
    with wp.ScopedDevice(device):
        rest.rowadr = wp.array(np.cumsum([0] + [len(row) for row in terms]), dtype=int)
        rest.qposadr = wp.array([adr for adr, _ in flat], dtype=int)
        rest.arm = wp.array([arm for _, arm in flat], dtype=float)
        rest.law = wp.array(law[None], dtype=wp.vec2, ndim=2)
        rest.lower, rest.upper = (wp.array(values, dtype=float) for values in (lower, upper))
        rest.actuator, rest.carried = wp.array(actuator, dtype=int), wp.full(nu + na, wp.vec4i(-1), dtype=wp.vec4i)
        rest.sampleadr, rest.sampled = (wp.array(each, dtype=int) for each in history_samples(mjm))
    return rest


def _length_terms(mjm: mujoco.MjModel, actuator: int) -> list[tuple[int, float]] | None:
    """Write an actuator's length / gear as a sum of factor * qpos, and return its terms (qpos address, factor).

    Return None if the length is not such a sum, for example for a spatial tendon.
    """
    trntype, target = int(mjm.actuator_trntype[actuator]), int(mjm.actuator_trnid[actuator, 0])
    if trntype in JOINT_TRANSMISSIONS:
        joints, arms = np.array([target]), np.ones(1)
    elif trntype == mujoco.mjtTrn.mjTRN_TENDON:
        wraps = slice(mjm.tendon_adr[target], mjm.tendon_adr[target] + mjm.tendon_num[target])
        joints, arms = mjm.wrap_objid[wraps], mjm.wrap_prm[wraps]
        if (mjm.wrap_type[wraps] != mujoco.mjtWrap.mjWRAP_JOINT).any():
            return None
    else:
        return None
    is_sum = np.isin(mjm.jnt_type[joints], SCALAR_JOINTS).all()
    return list(zip(mjm.jnt_qposadr[joints].tolist(), arms.tolist(), strict=True)) if is_sum else None


def history_samples(mjm: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the addresses of past controls in `history`, and the index of the control at each address.

    Only delayed actuators have a history. A history of n samples of m controls starts with two other numbers and the
    times of the samples, followed by n x m controls.

    Returns:
        Two arrays with an entry for each past control, int32.
    """
    ctrladr, ctrlnum = actuator_controls(mjm)
    address, control = [], []
    for i, (nsample, _) in enumerate(mjm.actuator_history):
        kept = np.arange(max(nsample, 0) * ctrlnum[i])
        address += (mjm.actuator_historyadr[i] + 2 + nsample + kept).tolist()
        control += (ctrladr[i] + kept % ctrlnum[i]).tolist()
    return np.array(address, np.int32), np.array(control, np.int32)


def close_grippers(rest: RestMap, compiled: CompiledScene, sim: mujoco.MjModel) -> None:
    """Set `rest.press`, `rest.closed` and `rest.squeezing`, so that a gripper closes on the object that it starts with.

    `sim` is the model of the RestMap.

    Raises:
        NotSupportedError: An episode starts with an object in a gripper without a position actuator or a motor.
    """
    full, starts = compiled.mjm, compiled.starts
    if compiled.reaching is None or starts is None:
        return
    arms, slots = compiled.reaching.arms, [compiled.slots.index(name) for name in compiled.reaching.names]
    press = np.zeros((starts.press.shape[0], len(compiled.slots)))
    press[:, slots] = starts.press.numpy()
    closed, squeezing = np.full((len(press), sim.nq), np.nan), np.full((len(press), len(rest.lower)), np.nan)
    names = {int(adr): full.joint(i).name for i, adr in enumerate(full.jnt_qposadr)}
    for kind in np.flatnonzero(press.any(axis=1)).tolist():
        one = arms[starts.arm.numpy()[kind]]
        adr, qpos = one.gripper.poses(np.array([0.0, 1.0]))
        own = adr.tolist() if sim is full else [int(sim.joint(names[a]).qposadr[0]) for a in adr.tolist()]
        closed[kind, own] = qpos[0]
        squeezing[kind, : sim.nu] = squeezing_controls(sim, np.array(own), qpos)
        if not np.isin(rest.qposadr.numpy(), own).any() and np.isnan(squeezing[kind]).all():
            raise NotSupportedError(
                f"{compiled.config.where}: start: the gripper of '{one.robot}' has no position actuator, and no motor "
                "with a 'ctrlrange', that would keep it closed. Give the gripper one, as in <position joint=...>, or "
                "start from 'home' or 'pregrasp'."
            )
    with wp.ScopedDevice(rest.law.device):
        values = (wp.array(each, dtype=float, ndim=2) for each in (press, closed, squeezing))
        rest.press, rest.closed, rest.squeezing = values


@wp.func
def _follow(values: wp.array[float], at: int, before: float, now: float):
    """Set a value to `now` if it equals `before` up to rounding. Otherwise, a task has set it, so keep it."""
    if wp.abs(values[at] - before) <= 1.0e-6 * wp.max(1.0, wp.abs(before)):
        values[at] = now


@wp.kernel
def _hold_anew(
    mask: wp.array[wp.bool],
    rest: RestMap,
    # Model in:
    actuator_gainprm: wp.array3d[float],
    actuator_biasprm: wp.array3d[float],
    actuator_gear: wp.array2d[wp.spatial_vector],
    actuator_forcelimited: wp.array[wp.bool],
    actuator_forcerange: wp.array2d[wp.vec2],
    body_mass: wp.array2d[float],
    body_gravcomp: wp.array2d[float],
    gravity: wp.array[wp.vec3],
    # Data in:
    qpos: wp.array2d[float],
    xipos: wp.array2d[wp.vec3],
    xanchor: wp.array2d[wp.vec3],
    xaxis: wp.array2d[wp.vec3],
    # Data out:
    ctrl_out: wp.array2d[float],
    act_out: wp.array2d[float],
    history_out: wp.array2d[float],
    # Out:
    law_out: wp.array2d[wp.vec2],
):
    worldid, element = wp.tid()
    actuatorid = rest.actuator[element]
    if actuatorid < 0 or not selects(mask, worldid):
        return
    before = rest_value(rest, worldid, element, qpos[worldid])
    gain = actuator_gainprm[worldid % actuator_gainprm.shape[0], actuatorid, 0]
    bias0 = actuator_biasprm[worldid % actuator_biasprm.shape[0], actuatorid, 0]
    bias1 = actuator_biasprm[worldid % actuator_biasprm.shape[0], actuatorid, 1]
    gear = actuator_gear[worldid % actuator_gear.shape[0], actuatorid][0]
    if gain * bias1 >= 0.0:
        return
    start, load, carried = -bias0 / gain, float(0.0), rest.carried[element]
    for body in range(carried[1], carried[2]):
        mass = body_mass[worldid % body_mass.shape[0], body]
        borne = mass * body_gravcomp[worldid % body_gravcomp.shape[0], body]
        weight = (mass - borne) * gravity[worldid % gravity.shape[0]]
        if carried[3] == 1:
            weight = wp.cross(xipos[worldid, body] - xanchor[worldid, carried[0]], weight)
        load += wp.dot(xaxis[worldid, carried[0]], weight)
    if carried[0] >= 0:
        force = -load / (gear * rest.arm[rest.rowadr[element]])
        if actuator_forcelimited[actuatorid]:
            limits = actuator_forcerange[worldid % actuator_forcerange.shape[0], actuatorid]
            force = wp.clamp(force, limits[0], limits[1])
        start += force / gain
    law_out[worldid, element] = wp.vec2(start, -bias1 / gain * gear)
    now = rest_value(rest, worldid, element, qpos[worldid])
    # update controls that hold the present pose, and keep controls that a task has set
    nu = ctrl_out.shape[1]
    if element < nu:
        _follow(ctrl_out[worldid], element, before, now)
    else:
        _follow(act_out[worldid], element - nu, before, now)
    for k in range(rest.sampleadr.shape[0]):
        if rest.sampled[k] == element:
            _follow(history_out[worldid], rest.sampleadr[k], before, now)


def launch_holding(rest: RestMap, m: mjw.Model, d: mjw.Data, mask: wp.array | None) -> None:
    """Recompute `rest.law` from the Model's gains, then update the controls and activations that hold the current pose.

    Actuators of arms also bear the weight of the arm and its hand at the world poses in Data, less the part that
    `gravcomp` bears, up to their force limits. Without this force, the arm would sag by its weight over the stiffness
    of its actuators. Controls that a task has set stay unchanged.

    Args:
        rest: The RestMap, whose `law` has a row for each world.
        m: The Model. The launch reads the arrays that the Model has at the time of this call.
        d: Data of the worlds.
        mask: Selected worlds, shape (nworld,), bool. None selects all worlds.
    """
    inputs = [mask, rest, m.actuator_gainprm.view(wp.float32), m.actuator_biasprm.view(wp.float32), m.actuator_gear]
    inputs += [m.actuator_forcelimited, m.actuator_forcerange, m.body_mass, m.body_gravcomp, m.opt.gravity]
    inputs += [d.qpos, d.xipos, d.xanchor, d.xaxis]
    outputs = [d.ctrl, d.act, getattr(d, "history", None), rest.law]
    wp.launch(_hold_anew, (d.nworld, rest.actuator.shape[0]), inputs=inputs, outputs=outputs, device=rest.law.device)
