"""A scene around one unit, with things wherever it holds things."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco

from sceniris_gym import LayoutGenerator, Layouts, compile_scene


def words_of(path: Path) -> dict[str, Any]:
    """Return the scene of a unit: its joints are drawn, a block is in each part, a can on it, an apple inside of it."""
    model, wall = mujoco.MjModel.from_xml_path(str(path)), path.stem.startswith("wall")
    place = {"region": {"box": [[-0.5, -0.5, 1.4], [0.5, 0.5, 1.4]]}} if wall else {"on": "floor"}
    unit: dict[str, Any] = {"asset": str(path), "kind": "fixture", **place, "orientation": {"yaw": [-5, 5]}}
    if model.njnt:
        unit["joints"] = {"*": {"fraction": [0.0, 1.0]}}
    things: dict[str, Any] = {"can": {"asset": "can", "on": "unit"}}
    for part in (model.body(i).name for i in range(2, model.nbody)):
        if model.body(part).jntnum[0] == 0 or model.joint(part).type[0] == mujoco.mjtJoint.mjJNT_SLIDE:
            things[part] = {"asset": "block", "in": f"unit/{part}"}
    if "drawers" not in path.stem:
        things["apple"] = {"asset": "apple", "in": "unit"}
    return {"floor": {"size": [4, 4]}, "objects": {"unit": unit, **things}, "bank": 8}


def reach_of(path: Path) -> dict[str, Any]:
    """Return a scene in which a Panda has to reach a handle of a unit with all joints at 0, without collisions."""
    grasp = "lid_*" if "lid" in path.stem else "front_0_*"
    unit: dict[str, Any] = {"asset": str(path), "kind": "fixture", "orientation": {"yaw": [-95, -85]}}
    unit |= {"reachable": {"tier": "clear", "grasp": grasp}, "joints": {"*": {"value": 0.0}}}
    if path.stem.startswith("wall"):
        unit["region"] = {"box": [[0.55, -0.3, 0.4], [0.8, 0.3, 0.7]]}
    else:
        unit |= {"on": "floor", "region": {"box": [[0.65, -0.4], [1.0, 0.4]]}}
    robot = {"asset": "panda", "base": [0, 0, 0.2], "joints": {"joint*": {"noise": 0.02}}}
    return {"floor": {"size": [4, 4]}, "robot": robot, "objects": {"unit": unit}, "bank": 8}


def layouts_of(words: dict[str, Any], nworld: int) -> Layouts:
    """Return layouts of a scene."""
    generator = LayoutGenerator(compile_scene(words, "cpu", cache=False), nworld, seed=0)
    generator.generate()
    return generator.layouts
