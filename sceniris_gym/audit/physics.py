"""Tests in MuJoCo C: free objects of a layout should stay in place, and equalities should hold."""

import os
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass

import mujoco
import mujoco.rollout
import numpy as np

from sceniris_gym.scene.layout_table import LayoutTable

SETTLE_SECONDS = 0.5
STILL = 0.01  # m, greatest motion of a free object at rest
FAST = 1.0  # m/s
BROKEN = 2e-4  # m or rad, an equality may have this error, because keyframes have few digits
_IMMOVABLE = 1e8  # kg m^2 or kg, armature: 1,000 N m rotate such a joint by 1e-6 rad in half a second
_FIRST_MOMENT = 0.005  # s, the contact solver's first push does not count as motion
_THREADS = os.cpu_count() or 1
_CHUNK = 250  # rows stepped at once, which bounds the memory for their states
_GIVEN = mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT


@dataclass(frozen=True)
class Settling:
    """Motion of free objects after a start at rest.

    Attributes:
        moved: Object name -> distance between start and end [m], shape (nrow,), NaN where MuJoCo warned.
        speed: Object name -> largest speed [m/s], shape (nrow,), NaN where MuJoCo warned.
        warnings: Row with a warning of MuJoCo -> kind and text of the first warning.
    """

    moved: dict[str, np.ndarray]
    speed: dict[str, np.ndarray]
    warnings: dict[int, tuple[str, str]]


@contextmanager
def without_log() -> Iterator[None]:
    """Prevent MuJoCo and its threads from writing a log file of warnings into the working folder."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


@without_log()
def settle(
    mjm: mujoco.MjModel,
    bodies: Mapping[str, int],
    table: LayoutTable,
    seconds: float = SETTLE_SECONDS,
    frozen: Sequence[int] = (),
) -> Settling:
    """Step each layout for some time, while position servos hold their joints where the layout has them.

    A warning of MuJoCo ends a rollout early. After a bad acceleration, MuJoCo has also reset the state.

    Args:
        mjm: The model.
        bodies: Name of a free object -> id of its body with the free joint.
        table: The layouts.
        seconds: Duration [s].
        frozen: Ids of joints that are held still.
    """
    mjm = _prepared(mjm, frozen)
    names = list(bodies)
    joints = [mjm.body_jntadr[bodies[name]] for name in names]
    place = 1 + mjm.jnt_qposadr[joints][:, None] + np.arange(3)  # a full state starts with the time
    velocity = 1 + mjm.nq + mjm.jnt_dofadr[joints][:, None] + np.arange(3)
    moved, speed = np.zeros((2, len(table), len(names)))
    warnings: dict[int, tuple[str, str]] = {}
    nstep = round(seconds / mjm.opt.timestep)
    skipped = min(round(_FIRST_MOMENT / mjm.opt.timestep), nstep - 1)
    for start, some in table.chunks(_CHUNK):
        first, given = _start(mjm, some)
        threads = [mujoco.MjData(mjm) for _ in range(_THREADS)]
        state = np.empty((len(some), nstep, first.shape[1]))
        mujoco.rollout.rollout(mjm, threads, first, given[:, None], control_spec=int(_GIVEN), nstep=nstep, state=state)
        here = slice(start, start + len(some))
        moved[here] = np.linalg.norm(state[:, -1][:, place] - first[:, place], axis=-1)
        speed[here] = np.linalg.norm(state[:, skipped:][:, :, velocity], axis=-1).max(1)
        for i in np.flatnonzero(~(state[:, -1, 0] > first[:, 0] + (nstep - 0.5) * mjm.opt.timestep)).tolist():
            warnings[start + i] = _first_warning(mjm, threads[0], first[i], given[i], nstep)
            moved[start + i] = speed[start + i] = np.nan
    return Settling(dict(zip(names, moved.T, strict=True)), dict(zip(names, speed.T, strict=True)), warnings)


def _first_warning(
    mjm: mujoco.MjModel, data: mujoco.MjData, first: np.ndarray, given: np.ndarray, nstep: int
) -> tuple[str, str]:
    """Repeat a rollout that ended early, and return the kind and the text of its first warning.

    `first` and `given` are the state and the controls from `_start`, and `nstep` is the planned number of steps.
    """
    mujoco.mj_resetData(mjm, data)
    mujoco.mj_setState(mjm, data, first, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_setState(mjm, data, given, _GIVEN)
    for step in range(nstep):
        mujoco.mj_step(mjm, data)
        for kind, warning in enumerate(data.warning):
            if warning.number:
                text = mujoco.mju_warningText(kind, int(warning.lastinfo))
                return mujoco.mjtWarning(kind).name.removeprefix("mjWARN_"), f"{text} Step {step + 1}."
    return "UNKNOWN", "MuJoCo ended the run early."


def _start(mjm: mujoco.MjModel, table: LayoutTable) -> tuple[np.ndarray, np.ndarray]:
    """Return the input of rollouts from layouts: states (nrow, nstate), and controls with mocap poses (nrow, ngiven).

    Both are in the form of `mj_getState`.
    """
    data = mujoco.MjData(mjm)
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    states = np.empty((len(table), mujoco.mj_stateSize(mjm, full)))
    given = np.empty((len(table), mujoco.mj_stateSize(mjm, _GIVEN)))
    for i in range(len(table)):
        mujoco.mj_resetData(mjm, data)
        table.put(data, i)
        hold(mjm, data)
        mujoco.mj_getState(mjm, data, states[i], full)
        mujoco.mj_getState(mjm, data, given[i], _GIVEN)
    return states, given


def hold(mjm: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Set the controls so that position servos exert no force. Other controls come from the first keyframe."""
    if mjm.nkey:
        data.ctrl[:] = mjm.key_ctrl[0]
    mujoco.mj_fwdPosition(mjm, data)
    gain, bias, servo = mjm.actuator_gainprm[:, 0], mjm.actuator_biasprm, _servos(mjm)
    rest = -(bias[servo, 0] + bias[servo, 1] * data.actuator_length[servo]) / gain[servo]
    limits = np.where(mjm.actuator_ctrllimited[servo, None], mjm.actuator_ctrlrange[servo], [-np.inf, np.inf])
    data.ctrl[servo] = np.clip(rest, *limits.T)
    for actuator in np.flatnonzero(mjm.actuator_history[:, 0] > 0):  # delayed actuators start with this control
        past = np.full((int(mjm.actuator_history[actuator, 0]), 1), data.ctrl[actuator])
        mujoco.mj_initCtrlHistory(mjm, data, int(actuator), None, past)


def limp_joints(mjm: mujoco.MjModel, bodies: Collection[int]) -> list[int]:
    """Return the joints of the given bodies that are held by no position servo. Free joints are left out.

    A servo holds its joint, or all joints of its tendon, and all joints that equalities couple to the held joints.
    """
    held: set[int] = set()
    for actuator in np.flatnonzero(_servos(mjm)):
        kind, driven = int(mjm.actuator_trntype[actuator]), int(mjm.actuator_trnid[actuator, 0])
        if kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            held.add(driven)
        elif kind == mujoco.mjtTrn.mjTRN_TENDON:
            wraps = range(mjm.tendon_adr[driven], mjm.tendon_adr[driven] + mjm.tendon_num[driven])
            held |= {int(mjm.wrap_objid[w]) for w in wraps if int(mjm.wrap_type[w]) == mujoco.mjtWrap.mjWRAP_JOINT}
    eq = (mjm.eq_type == mujoco.mjtEq.mjEQ_JOINT) & mjm.eq_active0.astype(bool)
    coupled = [set(pair) for pair in zip(mjm.eq_obj1id[eq].tolist(), mjm.eq_obj2id[eq].tolist(), strict=True)]
    for _ in coupled:
        held |= {j for pair in coupled if pair & held for j in pair}
    limp = np.isin(mjm.jnt_bodyid, list(bodies)) & (mjm.jnt_type != mujoco.mjtJoint.mjJNT_FREE)
    return sorted({*np.flatnonzero(limp).tolist()} - held)


def _servos(mjm: mujoco.MjModel) -> np.ndarray:
    """Return a mask of the actuators that are position servos, shape (nu,)."""
    affine = mjm.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
    return affine & (mjm.actuator_biasprm[:, 1] < 0) & (mjm.actuator_gainprm[:, 0] > 0)


def _prepared(mjm: mujoco.MjModel, joints: Sequence[int]) -> mujoco.MjModel:
    """Return a copy of the model in which `joints` have a huge armature, so that they hold still.

    The copy uses dense Jacobians. With sparse Jacobians, stacks would creep because of a wrong factorisation in
    MuJoCo 4.0.0 (google-deepmind/mujoco#3767).
    """
    frozen = copy(mjm)
    frozen.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    for joint in joints:
        size = 3 if int(mjm.jnt_type[joint]) == mujoco.mjtJoint.mjJNT_BALL else 1
        frozen.dof_armature[mjm.jnt_dofadr[joint] : mjm.jnt_dofadr[joint] + size] = _IMMOVABLE
    return frozen


def equalities(mjm: mujoco.MjModel, table: LayoutTable) -> tuple[int, float, str]:
    """Measure the errors of the active equalities of a model in layouts.

    Returns:
        The number of layouts with an error above `BROKEN`, the largest error [m or rad], and the name of the equality
        with this error, or its number if it has no name. The name is empty if there is no error.
    """
    if not mjm.neq:
        return 0, 0.0, ""
    data = mujoco.MjData(mjm)
    missed = np.zeros((len(table), mjm.neq))
    for row in range(len(table)):
        table.put(data, row)
        mujoco.mj_fwdPosition(mjm, data)
        rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        np.maximum.at(missed[row], data.efc_id[rows], np.abs(data.efc_pos[rows]))
    worst = float(missed.max(initial=0.0))
    eq = int(missed.max(axis=0, initial=0.0).argmax())
    name = (mjm.equality(eq).name or str(eq)) if worst > 0.0 else ""
    return int((missed > BROKEN).any(axis=1).sum()), worst, name
