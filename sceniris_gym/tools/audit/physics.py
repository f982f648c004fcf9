"""Tests layouts in MuJoCo C: how deep bodies penetrate at the start, and whether objects stay where they are."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import mujoco.rollout
import numpy as np

from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.tools.audit.pairs import Tree

SETTLE_SECONDS = 0.5
STILL = 0.01  # m; a free object that moves more did not rest
FAST = 1.0  # m/s
_FIRST_MOMENT = 0.005  # s; the contact solver's first push is not a motion
_THREADS = os.cpu_count() or 1
_CHUNK = 250  # rows whose states are kept at once
_GIVEN = mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT


@dataclass(frozen=True)
class Penetration:
    """The deepest contact in some layouts.

    Attributes:
        depth: Penetration [m], 0 if nothing touches.
        row: The layout, -1 if nothing touches.
        owners: Names of the two objects.
    """

    depth: float
    row: int
    owners: tuple[str, str] | None


@dataclass(frozen=True)
class Settling:
    """How free objects move after a start at rest.

    Attributes:
        moved: Object name -> distance between start and end [m], shape (nrow,).
        speed: Object name -> largest speed [m/s], shape (nrow,).
    """

    moved: dict[str, np.ndarray]
    speed: dict[str, np.ndarray]


def deepest(tree: Tree, table: LayoutTable) -> Penetration:
    """Return the deepest contact that MuJoCo's collision pass finds in any row, in or between any objects."""
    mjm = tree.mjm
    data = mujoco.MjData(mjm)
    depth = np.zeros(len(table))
    pair = np.zeros((len(table), 2), int)
    for i in range(len(table)):
        table.put(data, i)
        mujoco.mj_kinematics(mjm, data)
        mujoco.mj_comPos(mjm, data)
        mujoco.mj_collision(mjm, data)
        if data.ncon:
            k = int(data.contact.dist.argmin())
            depth[i], pair[i] = max(-data.contact.dist[k], 0.0), data.contact.geom[k]
    if not len(table) or depth.max() <= 0:
        return Penetration(0.0, -1, None)
    row = int(depth.argmax())
    first, second = (tree.owner[mjm.geom_bodyid[g]] for g in pair[row])
    return Penetration(float(depth[row]), row, (first, second))


def settle(
    mjm: mujoco.MjModel, bodies: Mapping[str, int], table: LayoutTable, seconds: float = SETTLE_SECONDS
) -> Settling:
    """Step each layout for some time with the actuators holding the start pose.

    Args:
        mjm: The model.
        bodies: Free object name -> its body id, which has a free joint.
        table: The layouts.
        seconds: Duration [s].
    """
    names = list(bodies)
    joints = [mjm.body_jntadr[bodies[name]] for name in names]
    place = 1 + mjm.jnt_qposadr[joints][:, None] + np.arange(3)  # a full state starts with the time
    velocity = 1 + mjm.nq + mjm.jnt_dofadr[joints][:, None] + np.arange(3)
    moved, speed = np.zeros((2, len(table), len(names)))
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
    return Settling(
        {name: moved[:, k] for k, name in enumerate(names)}, {name: speed[:, k] for k, name in enumerate(names)}
    )


def _start(mjm: mujoco.MjModel, table: LayoutTable) -> tuple[np.ndarray, np.ndarray]:
    """Return the start states (nrow, nstate), and the controls with mocap poses (nrow, ngiven), of layouts."""
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
    """Set the controls: those of position servos so that they exert no force, others as in the first keyframe."""
    if mjm.nkey:
        data.ctrl[:] = mjm.key_ctrl[0]
    mujoco.mj_fwdPosition(mjm, data)
    gain, bias = mjm.actuator_gainprm[:, 0], mjm.actuator_biasprm
    servo = (mjm.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE) & (bias[:, 1] < 0) & (gain > 0)
    rest = -(bias[servo, 0] + bias[servo, 1] * data.actuator_length[servo]) / gain[servo]
    limits = np.where(mjm.actuator_ctrllimited[servo, None], mjm.actuator_ctrlrange[servo], [-np.inf, np.inf])
    data.ctrl[servo] = np.clip(rest, *limits.T)
