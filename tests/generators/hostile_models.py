"""Hostile models: random MJCF with everything that MuJoCo has, and a scene that places some of its bodies.

A model is a pure function of its seed. Nothing here knows how layouts are made; `hostile_judge` says whether they are
right.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import mujoco
import numpy as np

from tests.generators import hostile_couplings as couplings
from tests.generators.hostile_bodies import Parts, text
from tests.generators.hostile_features import stream, wanted_features
from tests.generators.hostile_making import Making
from tests.generators.hostile_objects import add_object, draw_joints
from tests.generators.hostile_surroundings import add_arm, add_doors, add_surroundings, make_robot, start
from tests.generators.hostile_words import Home, Thing, home_state


@dataclass(frozen=True)
class HostileModel:
    """A model with its scene.

    Attributes:
        seed: What it is made from.
        files: Contents by name of file: model.xml, and robots.
        scene: The scene, as `compile_scene` takes it, but with file names instead of paths.
        features: What the model has, names of FEATURES.
        things: What the scene names, in plain words for the judge.
        home: What stays where the model has it.
    """

    seed: int
    files: dict[str, str]
    scene: dict[str, Any]
    features: frozenset[str]
    things: list[Thing]
    home: Home

    def write(self, folder: Path) -> dict[str, Any]:
        """Write the files to a folder and return the scene with their paths."""
        for name, content in self.files.items():
            (folder / name).write_text(content)
        scene: dict[str, Any] = {**self.scene, "model": str(folder / "model.xml")}
        if "robot" in scene:
            scene["robot"] = {**scene["robot"], "asset": str(folder / scene["robot"]["asset"])}
        return scene


def make(seed: int) -> HostileModel:
    """Make the model of a seed. Every model compiles in MuJoCo C."""
    rng, wanted = stream(seed, "model"), wanted_features(seed)
    unit = float(np.exp(rng.uniform(np.log(0.02), np.log(0.12))))
    nobject, nobstacle = int(rng.integers(1, 6)), int(rng.integers(0, 12))
    if "tiny" in wanted:
        unit = float(np.exp(rng.uniform(np.log(0.0017), np.log(0.005))))
    if "huge" in wanted:
        unit, nobstacle = float(rng.uniform(0.8, 4.0)), min(nobstacle, 6)
    if "many" in wanted:
        nobject, nobstacle = int(rng.integers(1, 3)), int(rng.integers(520, 690))
    elif "crowd" in wanted:
        nobstacle = int(rng.integers(60, 110))
    parts = Parts(Element("mujoco", model=f"hostile_{seed}"), rng, wanted, unit)
    parts.used |= wanted & {"tiny", "huge", "many", "crowd"}
    width = float(np.clip(unit * 6.0 * np.sqrt(nobject + nobstacle + 2), 0.1, 95.0))
    making = Making(parts, width)
    start(making)
    add_surroundings(making, nobstacle)
    for i in range(nobject):
        add_object(making, f"obj{i}")
    add_doors(making)
    add_arm(making)
    followers = couplings.add_joint_couplings(parts)
    draw_joints(making, [j.name for j in followers])
    drawn = [name for thing in making.things for name in thing.drawn]
    couplings.add_body_couplings(parts, making.free, making.loose)
    couplings.add_spatial_tendons(parts, making.free)
    couplings.add_actuators(parts, drawn)
    couplings.add_contact_rules(parts, list(making.objects))
    return _finish(making, seed)


def _finish(making: Making, seed: int) -> HostileModel:
    """The scene around the objects; keyframe, robot and asset; and what the model says of home."""
    parts, rng, width = making.parts, making.parts.rng, making.width
    for section in ("asset", "contact", "equality", "tendon", "actuator"):
        if len(parts.section(section)) == 0:
            parts.root.remove(parts.section(section))
    if "keyframe" in parts.wanted or "key_mocap" in parts.wanted:
        _add_keyframe(making)
    scene: dict[str, Any] = {
        "floor": {"size": [2.0 * width, 2.0 * width]},
        "objects": making.objects,
        "attempts": 60,
        "restarts": 20,
    }
    indent(parts.root)
    files = {"model.xml": tostring(parts.root, encoding="unicode")}
    mjm = mujoco.MjModel.from_xml_string(files["model.xml"])
    home = Home.of(mjm)
    if _touches_inside(mjm, {thing.body for thing in making.things if thing.drawn}):
        parts.used.add("touching_inside")
    if parts.wanted & {"robot", "free_base_robot", "mimic"}:
        files["bot.xml"], robot, thing = make_robot(making)
        scene["robot"] = robot
        making.things.append(thing)
    if parts.unit > 0.02 and parts.has("asset"):
        asset = str(rng.choice(["apple", "can", "mug", "banana"]))
        making.objects["guest"] = {"asset": asset, "on": "floor"}
        making.things.append(Thing("guest", "guest", "free", placed=True, support="world"))
    return HostileModel(seed, files, scene, frozenset(parts.used), making.things, home)


def _touches_inside(mjm: mujoco.MjModel, roots: set[str]) -> bool:
    """Return whether two bodies of one of these trees touch at home."""
    data = home_state(mjm)
    mujoco.mj_fwdPosition(mjm, data)
    trees = mjm.body_rootid[mjm.geom_bodyid[data.contact.geom]]
    return any(one == other and mjm.body(one).name in roots for one, other in trees)


def _add_keyframe(making: Making) -> None:
    """Keyframe 'home': joints away from 0, and mocap bodies away from their bodies' places."""
    parts, rng = making.parts, making.parts.rng
    mjm = mujoco.MjModel.from_xml_string(tostring(parts.root, encoding="unicode"))
    key = {"name": "home"}
    if parts.has("keyframe"):
        qpos = mjm.qpos0.copy()
        for name, value in couplings.home_positions(parts).items():
            qpos[mjm.joint(name).qposadr[0]] = value
        key["qpos"] = text(*qpos)
        ctrl = np.zeros(mjm.nu)
        for i in range(mjm.nu):
            low, high = mjm.actuator_ctrlrange[i] if mjm.actuator_ctrllimited[i] else (-0.01, 0.01)
            ctrl[i] = rng.uniform(low, high) * (0.01 if "constraint_off" not in parts.used else 0.0)
        if mjm.nu:
            key["ctrl"] = text(*ctrl)
    if mjm.nmocap and parts.has("key_mocap"):
        pos = np.array([making.somewhere() for _ in range(mjm.nmocap)])
        quat = np.array([couplings.quaternion(rng) for _ in range(mjm.nmocap)])
        key["mpos"], key["mquat"] = text(*pos.ravel()), text(*quat.ravel())
    SubElement(SubElement(parts.root, "keyframe"), "key", key)
