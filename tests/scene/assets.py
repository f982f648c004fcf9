"""Small assets with all that a scene takes over from one, an own model, and scenes of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel

TETRAHEDRON = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"

CHEST = """
<mujoco model="chest">
  <compiler angle="degree" meshdir="parts"/>
  <option timestep="0.001"/>
  <asset><mesh name="knob" file="knob.obj"/></asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="ground" type="plane" size="1 1 .1"/>
    <body name="chest">
      <joint name="swing" type="hinge" axis="0 0 1"/>
      <geom name="box" type="box" size=".1 .1 .1" pos="0 0 .1"/>
      <geom name="knob" type="mesh" mesh="knob" pos="0 0 .3"/>
      <body name="tray" pos="0 0 .25">
        <joint name="slide" type="slide" axis="0 -1 0" range="0 .25"/>
        <geom name="tray" type="box" size=".05 .05 .01"/>
        <body name="lid" pos="0 0 .05">
          <joint name="hinge" type="hinge" axis="1 0 0" range="0 90"/>
          <geom name="lid" type="box" size=".05 .05 .005"/>
        </body>
      </body>
    </body>
  </worldbody>
  <contact><exclude body1="chest" body2="tray"/></contact>
  <sensor><framepos name="where" objtype="body" objname="chest"/></sensor>
  <actuator><position name="pull" joint="slide" kp="10"/></actuator>
  <keyframe><key name="home" qpos="1 .2 .5" ctrl=".2"/></keyframe>
</mujoco>
"""
BALL = '<mujoco><worldbody><body name="b"><geom name="g" type="sphere" size=".03"/></body></worldbody></mujoco>'
ARM = """
<mujoco>
  <worldbody><body name="base"><geom name="foot" type="box" size=".05 .05 .05"/>
    <body name="link"><joint name="joint1" type="hinge" axis="0 0 1" range="-115 115"/>
      <geom name="link" type="box" size=".2 .02 .02"/></body></body></worldbody>
  <actuator><position name="motor" joint="joint1"/></actuator>
  <keyframe><key name="home" qpos=".5" ctrl=".4"/><key name="up" qpos="1.5" ctrl="1.4"/></keyframe>
</mujoco>
"""
OWN = """
<mujoco>
  <option timestep="0.003"/>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <light pos="0 0 2"/>
    <body name="desk" pos="1 0 0"><geom type="box" size=".3 .3 .02"/>
      <body name="drawer"><joint name="rail" type="slide" range="0 .2"/><geom type="box" size=".1 .1 .02"/></body>
    </body>
    <body name="stone" pos="0 0 .2"><freejoint name="loose"/><geom type="sphere" size=".03"/></body>
    <body name="door"><joint name="swing" type="hinge" axis="0 0 1"/><geom type="box" size=".3 .02 .3"/></body>
  </worldbody>
  <keyframe><key name="home" qpos=".1 0 0 .2 1 0 0 0 .7"/></keyframe>
</mujoco>
"""


def build(folder: Path, objects: dict[str, Any], **others: Any) -> SceneModel:
    """Build a scene of the assets in `folder`; an asset is named by its file's stem."""
    for part in (*objects.values(), *filter(None, [others.get("robot")])):
        if "asset" in part:
            part["asset"] = str(folder / f"{part['asset']}.xml")
    return build_model(SceneConfig.load({"floor": {"size": [1, 2]}, "objects": objects, **others}))


def names(mjm: mujoco.MjModel, kind: str) -> list[str]:
    """Return the names of all elements of a kind, such as 'body'."""
    count = {"body": mjm.nbody, "joint": mjm.njnt, "geom": mjm.ngeom, "actuator": mjm.nu, "mesh": mjm.nmesh}[kind]
    return [getattr(mjm, kind)(i).name for i in range(count)]
