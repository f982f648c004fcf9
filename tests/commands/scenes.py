"""A small scene for the tools' tests: a shelf with a covered board, a ball-like gem, a can and a crate on the floor."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.layout_table import LayoutTable

MODEL = """
<mujoco>
  <option timestep="0.002"/>
  <visual><headlight ambient="0.4 0.4 0.4" diffuse="0.3 0.3 0.3"/></visual>
  <asset>
    <material name="wood" rgba="0.6 0.4 0.25 1"/>
    <material name="red" rgba="0.8 0.15 0.1 1"/>
    <mesh name="gem" vertex="0.03 0 0.03  -0.03 0 0.03  0 0.03 0.03  0 -0.03 0.03  0 0 0.06  0.02 0.02 0
      0.02 -0.02 0  -0.02 0.02 0  -0.02 -0.02 0"/>
  </asset>
  <worldbody>
    <light pos="0.5 -1 2" dir="-0.25 0.5 -1" type="directional"/>
    <geom name="floor" type="plane" size="0.5 0.5 0.01" rgba="0.8 0.8 0.82 1"/>
    <body name="shelf" mocap="true">
      <geom name="board" type="box" size="0.15 0.1 0.01" pos="0 0 0.01" material="wood"/>
      <geom name="back" type="box" size="0.15 0.01 0.09" pos="0 0.09 0.11" material="wood"/>
      <geom name="roof" type="box" size="0.15 0.05 0.01" pos="0 0.05 0.21" material="wood"/>
      <body name="shelf/tray" pos="0 -0.1 0.05">
        <joint name="shelf/tray" type="slide" axis="0 -1 0" range="0 0.1"/>
        <geom type="box" size="0.1 0.005 0.005" material="wood"/>
      </body>
    </body>
    <body name="gem"><freejoint name="gem/free"/><geom name="gem" type="mesh" mesh="gem" material="red"/></body>
    <body name="can"><freejoint name="can/free"/>
      <geom name="can" type="cylinder" size="0.03 0.05" pos="0 0 0.05" rgba="0.2 0.5 0.8 1"/></body>
    <body name="crate"><freejoint name="crate/free"/>
      <geom name="crate" type="box" size="0.04 0.04 0.04" pos="0 0 0.04" rgba="0.3 0.7 0.3 1"/></body>
  </worldbody>
</mujoco>
"""

OBJECTS = {
    "shelf": {"asset": "shelf", "kind": "fixture", "on": "floor"},
    "gem": {"asset": "gem", "on": "shelf"},
    "can": {"asset": "can", "on": "floor"},
    "crate": {"asset": "crate", "on": "floor"},
}
GAP = 0.0005  # m, as scenes have it by default


def small_model() -> mujoco.MjModel:
    """Return the small scene's model."""
    return mujoco.MjModel.from_xml_string(MODEL)


def small_config(geometry: str = "physics", changes: Mapping[str, Mapping] | None = None) -> SceneConfig:
    """Return the small scene's config; `changes` replace words of single objects."""
    objects = {name: {**part, **(changes or {}).get(name, {})} for name, part in OBJECTS.items()}
    return SceneConfig.load({"floor": {"size": [1.0, 1.0]}, "geometry": geometry, "objects": objects})


def bodies(mjm: mujoco.MjModel) -> dict[str, int]:
    """Return the root bodies of the objects."""
    return {name: mjm.body(name).id for name in OBJECTS}


def layout(mjm: mujoco.MjModel, nrow: int = 1, **poses: tuple[float, float, float, float]) -> LayoutTable:
    """Return equal rows in which objects stand at (x, y, z, yaw) [m, rad], each by default at a place of its own."""
    at = {
        "shelf": (0.0, 0.0, GAP, 0.0),
        "gem": (0.0, -0.04, 2 * GAP + 0.02, 0.3),
        "can": (-0.3, 0.0, GAP, 0.0),
        "crate": (0.3, 0.0, GAP, 0.5),
        **poses,
    }
    qpos, mocap_pos, mocap_quat = mjm.qpos0.copy(), np.zeros((1, 3)), np.zeros((1, 4))
    for name, (x, y, z, yaw) in at.items():
        quat = np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])
        if name == "shelf":
            mocap_pos[0], mocap_quat[0] = (x, y, z), quat
        else:
            adr = mjm.jnt_qposadr[mjm.joint(f"{name}/free").id]
            qpos[adr : adr + 3], qpos[adr + 3 : adr + 7] = (x, y, z), quat
    states = (np.repeat(a[None], nrow, axis=0) for a in (qpos, mocap_pos, mocap_quat))
    return LayoutTable.from_states(*states, present=np.ones((nrow, len(OBJECTS)), bool))


def with_row(rows: LayoutTable, i: int, other: LayoutTable) -> LayoutTable:
    """Return rows of which row `i` is replaced by the first of `other`."""
    states = (rows.qpos.copy(), rows.mocap_pos.copy(), rows.mocap_quat.copy())
    changed = LayoutTable.from_states(*states, present=rows.present)
    changed.qpos[i], changed.mocap_pos[i], changed.mocap_quat[i] = (
        other.qpos[0],
        other.mocap_pos[0],
        other.mocap_quat[0],
    )
    return changed
