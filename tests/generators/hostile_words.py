"""Input of the judge of hostile models: the things of a scene, the state of the model at home, and served states."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

_SCALAR = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
_COUPLINGS = (mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtEq.mjEQ_TENDON)


@dataclass(frozen=True)
class Thing:
    """Description of one object of a scene, or of its robot.

    Attributes:
        name: Its name in the scene.
        body: Its root body in the model.
        kind: Free, fixture, static or marker.
        placed: Whether layouts give it a pose.
        support: The body that carries it, 'world' for the floor; None for what floats or is not placed.
        stable: Whether it is put down in a stable pose, on something level.
        drawn: Names of its joints in the model that are drawn.
        held: Names of its joints that servos hold at home.
    """

    name: str
    body: str
    kind: str
    placed: bool = False
    support: str | None = None
    stable: bool = False
    drawn: tuple[str, ...] = ()
    held: tuple[str, ...] = ()


@dataclass(frozen=True)
class Home:
    """Home state in the user's own model: positions of hinges and slides, and poses of mocap bodies."""

    joints: dict[str, float]
    mocap: dict[str, np.ndarray]

    @classmethod
    def of(cls, mjm: mujoco.MjModel) -> Home:
        """Read them from keyframe 'home', or from the model without one; joints under couplings are left out."""
        data = home_state(mjm)
        coupled = {int(o) for k in range(mjm.neq) if mjm.eq_type[k] in _COUPLINGS for o in _joints_of(mjm, k)}
        joints = {
            mjm.joint(j).name: float(data.qpos[mjm.jnt_qposadr[j]])
            for j in range(mjm.njnt)
            if mjm.jnt_type[j] in _SCALAR and j not in coupled
        }
        bodies = {int(mjm.body_mocapid[b]): mjm.body(b).name for b in range(mjm.nbody) if mjm.body_mocapid[b] >= 0}
        return cls(joints, {name: np.r_[data.mocap_pos[i], data.mocap_quat[i]] for i, name in bodies.items()})


@dataclass(frozen=True)
class Served:
    """States that were served, a row each; `history` is MuJoCo's; None fills it with the controls."""

    qpos: np.ndarray
    mocap_pos: np.ndarray
    mocap_quat: np.ndarray
    ctrl: np.ndarray
    act: np.ndarray
    history: np.ndarray | None = None


@dataclass(frozen=True)
class Conflict:
    """Fault of one row: its kind, the parts concerned, and its size."""

    kind: str
    row: int
    who: str
    value: float


def home_state(mjm: mujoco.MjModel) -> mujoco.MjData:
    """The model at its keyframe 'home', or at its default without one."""
    data = mujoco.MjData(mjm)
    key = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_KEY, "home")
    if key >= 0:
        mujoco.mj_resetDataKeyframe(mjm, data, key)
    return data


def _joints_of(mjm: mujoco.MjModel, equality: int) -> list[int]:
    """Joints that an equality of joints or of fixed tendons couples."""
    ids = [int(i) for i in (mjm.eq_obj1id[equality], mjm.eq_obj2id[equality]) if i >= 0]
    if mjm.eq_type[equality] == mujoco.mjtEq.mjEQ_JOINT:
        return ids
    wraps = [w for t in ids for w in range(mjm.tendon_adr[t], mjm.tendon_adr[t] + mjm.tendon_num[t])]
    return [int(mjm.wrap_objid[w]) for w in wraps if mjm.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT]
