"""Arms of no maker, in one model of a user's own: a SCARA with odd names for each kind of hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import torch
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.batch import Batch
from sceniris_gym.vector.state import State


@dataclass(frozen=True)
class Hand:
    """A hand: MJCF of its bodies, tendons, equalities and actuators, and what it should do.

    Attributes:
        bodies, tendons, equalities, actuators: MJCF, with `%` for what names begin with.
        gaps: Distance between the centres of the fingers [m], closed and open.
    """

    bodies: str
    tendons: str = ""
    equalities: str = ""
    actuators: str = ""
    gaps: tuple[float, float] = (0.0, 0.0)


def _slides(left: str = "0 .03", right: str = "0 .03", along: str = "0 -1 0", damping: float = 2.0) -> str:
    """Two fingers on slides, whose centres are 2 to 8 cm apart."""
    return f"""
      <body name="%thumb" pos="0 .01 0"><joint name="%p" type="slide" axis="0 1 0" range="{left}" damping="{damping}"/>
        <geom name="%thumb" type="box" size=".01 .002 .02" mass=".05" contype="0" conaffinity="0"/>
        <site name="%eye" pos="0 0 .01"/></body>
      <body name="%index" pos="0 -.01 0">
        <joint name="%q" type="slide" axis="{along}" range="{right}" damping="{damping}"/>
        <geom name="%index" type="box" size=".01 .002 .02" mass=".05" contype="0" conaffinity="0"/>
        <site name="%ear" pos="0 0 .01"/></body>"""


SWINGING = """
      <body name="%thumb" pos="0 .04 .08"><joint name="%p" axis="1 0 0" range="-17.18873385 0" damping=".1"/>
        <geom name="%thumb" type="box" pos="0 0 -.08" size=".01 .002 .01" mass=".05" contype="0" conaffinity="0"/>
      </body>
      <body name="%index" pos="0 -.04 .08"><joint name="%q" axis="-1 0 0" range="-17.18873385 0" damping=".1"/>
        <geom name="%index" type="box" pos="0 0 -.08" size=".01 .002 .01" mass=".05" contype="0" conaffinity="0"/>
      </body>"""
"""Fingers that hang at 4 cm to either side, and close to 4 cm - 8 cm sin(0.3) as their joints go to -0.3 rad."""

_SWUNG = 2.0 * (0.04 - 0.08 * np.sin(0.3))

HANDS = {
    "none": Hand('<geom type="sphere" size=".01" contype="0" conaffinity="0"/>'),
    "two actuators": Hand(
        _slides("0 .03", "-.03 0", along="0 1 0"),
        actuators="""
      <position name="%q is shut by" joint="%q" kp="200" kv="5" ctrlrange="-.03 0"/>
      <position name="%z" joint="%p" kp="200" kv="5" ctrlrange="0 .03"/>""",
        gaps=(0.02, 0.08),
    ),
    "tendon": Hand(
        SWINGING,
        tendons='<fixed name="%t"><joint joint="%p" coef=".5"/><joint joint="%q" coef=".5"/></fixed>',
        equalities='<joint joint1="%p" joint2="%q"/>',
        # closes as the control grows, from 0 to 255
        actuators="""
      <general name="%pull" tendon="%t" ctrlrange="0 255" gainprm="-.0117647058823529" biastype="affine"
        biasprm="0 -10 -1"/>""",
        gaps=(_SWUNG, 0.08),
    ),
    "mimic": Hand(
        _slides(),
        equalities='<joint joint1="%q" joint2="%p"/>',
        actuators='<position name="%only" joint="%p" kp="200" kv="5"/>',
        gaps=(0.02, 0.08),
    ),
    "mimicked": Hand(
        _slides(),
        equalities='<joint joint1="%q" joint2="%p"/>',
        actuators='<position name="%only" jointinparent="%q" kp="200" kv="5" gear="10"/>',
        gaps=(0.02, 0.08),
    ),
    "cord": Hand(
        _slides(),
        tendons='<spatial name="%cord"><site site="%eye"/><site site="%ear"/></spatial>',
        equalities='<joint joint1="%q" joint2="%p"/>',
        actuators='<position name="%winch" tendon="%cord" kp="200" kv="5"/>',
        gaps=(0.02, 0.08),
    ),
    "motor": Hand(
        _slides(),
        equalities='<joint joint1="%q" joint2="%p"/>',
        actuators='<motor name="%m" joint="%p" gear="-1" ctrlrange="-1 1"/>',
        gaps=(0.02, 0.08),
    ),
    "passive": Hand(_slides()),
}
"""Hands by what moves them."""

ARM = """
    <body name="{plinth}" pos="{pos}" euler="0 0 {yaw}">
      <geom type="box" size=".03 .03 .1" pos="0 0 .1" contype="0" conaffinity="0"/>
      <body name="%boom" pos="0 0 .4">
        <joint name="%swing" axis="0 0 1" range="-120 120" damping="4"/>
        <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="1" contype="0" conaffinity="0"/>
        <body name="%jib" pos=".3 0 0">
          <joint name="%1" axis="0 0 -1" damping="2"/>
          <geom type="capsule" size=".02" fromto="0 0 0 0 .25 0" mass="1" contype="0" conaffinity="0"/>
          <body name="%quill" pos="0 .25 0">
            <joint name="%run" type="slide" axis="0 0 -1" range="-.2 .2"/>
            <geom type="capsule" size=".01" fromto="0 0 0 0 0 -.1" mass=".5" contype="0" conaffinity="0"/>
            <body name="%chuck" pos="0 0 -.1">
              <joint name="%turn about" axis="0 0 1"/>
              <geom type="box" size=".03 .03 .01" mass=".3" contype="0" conaffinity="0"/>
              <body name="%palm" pos="0 0 -.1">
                <site name="%point" euler="180 0 0"/>{bodies}
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>"""

ACTUATORS = """
      <position name="%gamma" joint="%run" kp="900" kv="60" gear="-3" forcerange="-90 90"/>
      <position name="%alpha" tendon="%rope" kp="2000" kv="200" forcerange="-80 80"/>
      <motor name="%swing" joint="%swing"/>
      <general name="%delta" jointinparent="%1" gainprm="100" biastype="affine" biasprm="25 -200 -20"/>
      <position name="%beta" joint="%turn about" kp="30" kv="3" ctrlrange="-2.5 2.5" timeconst=".01"/>"""
ROPE = '<fixed name="%rope"><joint joint="%swing" coef=".5"/></fixed>'

JOINTS = ("swing", "1", "run", "turn about")
"""The joints of the arm, from base to tip."""
CONTROLS = {"swing": "alpha", "1": "delta", "run": "gamma", "turn about": "beta"}
"""The position actuators that move them."""


def mjcf(arms: dict[str, tuple[str, str, float]], things: str = "") -> str:
    """Return a model with arms: hand, position and yaw [degrees] by the name of the root body."""
    bodies, tendons, equalities, actuators = "", "", "", ""
    for plinth, (hand, pos, yaw) in arms.items():
        kind, begin = HANDS[hand], f"{plinth}:"
        body = ARM.format(plinth=plinth, pos=pos, yaw=yaw, bodies=kind.bodies)
        bodies += body.replace("%", begin)
        tendons += (ROPE + kind.tendons).replace("%", begin)
        equalities += kind.equalities.replace("%", begin)
        actuators += (kind.actuators + ACTUATORS).replace("%", begin)
    return f"""<mujoco><option gravity="0 0 0" timestep=".005" integrator="implicitfast"/>
      <default><equality solref=".005 1" solimp=".95 .99 .001"/></default>
      <worldbody>{things}{bodies}</worldbody><tendon>{tendons}</tendon><equality>{equalities}</equality>
      <actuator>{actuators}</actuator></mujoco>"""


def state_of(scene: dict[str, Any] | SceneModel, num_envs: int = 2, substeps: int = 4) -> State:
    """Return the State of worlds in the start pose of a scene, which no layouts were made for."""
    model = scene if isinstance(scene, SceneModel) else build_model(SceneConfig.load(scene))
    batch = Batch(model, num_envs, "cpu", substeps=substeps, graph=False)
    batch.data.qpos.assign(np.tile(model.home_qpos, (num_envs, 1)))
    batch.data.ctrl.assign(np.tile(model.home_ctrl, (num_envs, 1)))
    batch.update()
    numbers = {name: wp.zeros(num_envs, dtype=wp.int32, device="cpu") for name in ("episode", "status", "start")}
    param = wp.zeros((num_envs, 0), dtype=float, device="cpu")
    seeds, present = wp.zeros(num_envs, dtype=wp.uint64, device="cpu"), np.ones((num_envs, len(model.config.objects)))
    arrays = {"seed": seeds, "present": wp.array(present.astype(np.int32), device="cpu"), "param": param, **numbers}
    tensors = {name: wp.to_torch(array) for name, array in arrays.items()}
    layouts: Any = SimpleNamespace(reaching=None, view=SimpleNamespace(**arrays), **tensors)
    return State(batch, layouts)


def mujocos(s: State, world: int = 0, mjm: mujoco.MjModel | None = None) -> mujoco.MjData:
    """Return plain MuJoCo's data for the state of one world or another model, after mj_forward."""
    mjm = s.mjm if mjm is None else mjm
    data, d = mujoco.MjData(mjm), s.data
    for name in ("qpos", "qvel", "ctrl", "act", "mocap_pos", "mocap_quat"):
        getattr(data, name)[:] = getattr(d, name).numpy()[world]
    mujoco.mj_forward(mjm, data)
    return data


def step(s: State, datas: Sequence[mujoco.MjData], substeps: int = 4) -> None:
    """Take a control step of all worlds in plain MuJoCo by the controls of the State, which is brought up to date."""
    for data, ctrl in zip(datas, s.ctrl.numpy(), strict=True):
        data.ctrl[:] = ctrl
        mujoco.mj_step(data.model, data, substeps)
    s.data.qpos.assign(np.array([data.qpos for data in datas]))
    s.data.qvel.assign(np.array([data.qvel for data in datas]))
    s._batch.update()


def joints_of(mjm: mujoco.MjModel, plinth: str) -> list[int]:
    """Return the addresses in qpos of an arm's joints, by their names."""
    return [int(mjm.joint(f"{plinth}:{name}").qposadr[0]) for name in JOINTS]


def tensor(values: object) -> torch.Tensor:
    """Return numbers as torch has them in a State."""
    return torch.tensor(np.asarray(values), dtype=torch.float32)
