"""Models to write first scenes of."""

from __future__ import annotations

import mujoco

TABLE = """
<mujoco>
  <worldbody>
    <geom name="ground" type="plane" size="0 0 1"/>
    <body name="table" pos="0.5 0 0.4"><geom type="box" size="0.3 0.4 0.02" rgba="0 0 0 0"/></body>
    <body name="can" pos="0.5 0 0.48"><freejoint/><geom type="cylinder" size="0.03 0.06"/></body>
    <body name="a/main" pos="0.4 0.2 0.46"><freejoint/><geom type="box" size="0.04 0.04 0.04"/></body>
    <body name="top" pos="0.4 0.2 0.52"><freejoint/><geom type="box" size="0.02 0.02 0.02"/></body>
    <body name="ball" pos="-0.5 0.2 0.1"><freejoint/><geom type="sphere" size="0.04"/></body>
    <body name="pin" pos="0.6 0.2 0.5">
      <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><geom size="0.02"/>
    </body>
  </worldbody>
</mujoco>
"""
"""A table, a can and a box with a smaller one on it, a ball on the ground, and something without a freejoint."""


def posed(mjm: mujoco.MjModel) -> mujoco.MjData:
    """Return a model in its pose `qpos0`."""
    data = mujoco.MjData(mjm)
    mujoco.mj_kinematics(mjm, data)
    return data


def arm(fingers: str, head: str = "", depth: int = 6) -> str:
    """Return MJCF of an arm of upright links that turn about z and y in turn, with something at its end."""
    inner = f'<body name="hand" pos="0 0 0.1"><geom size="0.02" mass="0.1"/>{fingers}</body>'
    for i in reversed(range(depth)):
        axis = "0 0 1" if i in (0, depth - 1) else "0 1 0"
        beside = head if i == 0 else ""
        inner = (
            f'<body name="link{i}" pos="0 0 0.1"><joint name="j{i}" axis="{axis}" range="-90 90"/>'
            f'<geom type="capsule" fromto="0 0 0 0 0 0.1" size="0.02"/>{inner}{beside}</body>'
        )
    return f'<mujoco><worldbody><body name="base"><geom size="0.03"/>{inner}</body></worldbody></mujoco>'


FINGERS = "".join(
    f'<body name="{side}" pos="{y} 0 0.05"><joint type="slide" axis="{s} 0 0" range="0 0.04"/>'
    '<geom type="box" size="0.005 0.01 0.03"/></body>'
    for side, y, s in (("left", 0.01, 1), ("right", -0.01, -1))
)
HEAD = '<body name="head" pos="0.1 0 0"><joint axis="0 0 1"/><geom size="0.02"/></body>'
