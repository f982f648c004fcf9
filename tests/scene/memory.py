"""Models in memory, as somebody else makes them: cubes with prefixed names, and a ground welded to the world."""

from __future__ import annotations

from typing import Any

import mujoco

CUBE = '<body name="cube_{i}/cube" pos="0 0 .3"><freejoint/><geom name="cube_{i}/g" type="box" size="{half}"/></body>'
MODEL = """
<mujoco>
  <worldbody>
    <body name="terrain"><geom name="ground" type="plane" size="0 0 .01"/></body>
    <geom name="ledge" type="box" size=".3 .2 .02" pos=".8 0 .3"/>
    <geom name="roof" type="box" size=".3 .2 .02" pos=".8 0 .8"/>
    <body name="cab/cabinet" pos="-.6 0 0"><geom name="cab/case" type="box" size=".2 .2 .1" pos="0 0 .1"/>
      <body name="cab/drawer" pos="0 0 .25"><joint name="cab/slide" type="slide" axis="1 0 0" range="0 .2"/>
        <geom name="cab/tray" type="box" size=".1 .1 .01"/></body></body>
    <body name="post" pos="0 .6 0"><joint name="turn" type="hinge" axis="0 0 1"/>
      <geom type="cylinder" size=".02 .2" pos="0 0 .2"/></body>
    {cubes}
  </worldbody>
  <actuator><position name="turn" joint="turn" kp="5"/><position name="pull" joint="cab/slide" kp="5"/></actuator>
  <keyframe><key name="init_state" qpos=".05 .7 {home}" ctrl="0 .3"/></keyframe>
</mujoco>
"""
NEAR = {"box": [[-0.15, -0.15], [0.15, 0.15]]}


def model_text(cubes: int = 3, half: str = ".02 .02 .02") -> str:
    """Return the model as MJCF; in the keyframe the cubes stand in a row above the ground."""
    bodies = "".join(CUBE.format(i=i, half=half) for i in range(cubes))
    return MODEL.format(cubes=bodies, home=" ".join(f"{0.1 * i} 0 .4 1 0 0 0" for i in range(cubes)))


def spec_of(**others: Any) -> mujoco.MjSpec:
    """Return the model as an MjSpec."""
    return mujoco.MjSpec.from_string(model_text(**others))


def cubes_on(support: str, count: int = 3, **words: Any) -> dict[str, dict[str, Any]]:
    """Return objects that are the cubes of the model, on a support."""
    return {f"cube_{i}": {"body": f"cube_{i}/cube", "on": support, **words} for i in range(count)}
