"""Surroundings of the placed objects in a hostile model: obstacles of every kind, doors, arms and robots."""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import mujoco
import numpy as np

from tests.generators.hostile_bodies import Parts, add_body, add_geom, add_tree, text
from tests.generators.hostile_making import Making, add_chain
from tests.generators.hostile_words import Thing


def start(making: Making) -> None:
    """Options and flags, and the sections of a model in their order."""
    parts = making.parts
    SubElement(parts.root, "compiler", angle="radian", boundmass="1e-6", boundinertia="1e-13")
    option = SubElement(parts.root, "option", timestep=text(float(parts.rng.choice([0.001, 0.002, 0.005]))))
    flags = {
        "filterparent": "filterparent",
        "contact_off": "contact",
        "constraint_off": "constraint",
        "midphase_off": "midphase",
    }
    found = {flag: "disable" for feature, flag in flags.items() if parts.has(feature)}
    if found:
        SubElement(option, "flag", found)
    for name in ("asset", "worldbody", "contact", "equality", "tendon", "actuator"):
        parts.section(name)


def add_surroundings(making: Making, nobstacle: int) -> None:
    """Floor, planes, a table, static and jointed obstacles, loose bodies, mocap bodies, flexes and height fields."""
    parts, rng, unit, width = making.parts, making.parts.rng, making.parts.unit, making.width
    world = parts.section("worldbody")
    if rng.random() < 0.5:
        SubElement(world, "geom", name="floor", type="plane", size=text(width, width, 0.1))
        parts.geoms["floor"] = "world"
    if parts.has("plane"):
        away, tilt = width + 12 * unit, float(rng.uniform(0.3, 1.2))
        pose = {"pos": text(away, 0, 0), "euler": text(0, -tilt, 0)}
        SubElement(world, "geom", pose, name="slope", type="plane", size="0 0 1")
        parts.geoms["slope"] = "world"
    if parts.has("hfield"):
        bumps = " ".join(text(v) for v in rng.random(16))
        size = text(width, width, unit, unit)
        SubElement(parts.section("asset"), "hfield", name="hills", nrow="4", ncol="4", size=size, elevation=bumps)
        SubElement(world, "geom", name="hills", type="hfield", hfield="hills", pos=text(0, 0, -0.5 * unit))
    if parts.has("flex"):
        step = text(unit, unit, unit)
        more = {"type": "grid", "count": "3 3 1", "spacing": step, "dim": "2", "mass": "1"}
        more |= {"radius": text(0.1 * unit), "pos": text(*making.somewhere())}
        cloth = SubElement(world, "flexcomp", more, name="cloth")
        SubElement(cloth, "edge", equality="true")
        SubElement(cloth, "contact", selfcollide="none")
    if parts.has("table"):
        half, height = float(np.clip(0.7 * width, 0.05, 25.0)), 4.0 * unit + 0.05
        table = add_body(parts, world, "table", np.array([0.0, 0.0, height]))
        SubElement(table, "geom", name="table_top", type="box", size=text(half, half, max(0.3 * unit, 0.002)))
        parts.geoms["table_top"] = "table"
        making.objects["table"] = {"kind": "static"}
        making.things.append(Thing("table", "table", "static"))
    for i in range(nobstacle):
        _add_obstacle(making, f"thing{i}", grown=nobstacle > 30)
    if parts.has("mocap"):
        body = add_body(parts, world, "guide", making.somewhere(), mocap="true")
        add_geom(parts, body, unit, np.zeros(3))
    if parts.has("mocap_weld"):
        at = making.somewhere(6.0, 9.0)
        add_body(parts, world, "grip", at, mocap="true")
        body = add_body(parts, world, "held", at)
        SubElement(body, "freejoint", name="held_free")
        add_geom(parts, body, 0.5 * unit, np.zeros(3))
        SubElement(parts.section("equality"), "weld", body1="grip", body2="held")


def _add_obstacle(making: Making, name: str, grown: bool) -> None:
    parts, rng, unit = making.parts, making.parts.rng, making.parts.unit
    size = unit * float(rng.uniform(0.3, 1.0 if grown else 1.6))
    if "huge" in parts.wanted and name == "thing0":
        size = 25.0
    at = making.somewhere() if size < 20.0 else np.array([making.width + 45.0, 0.0, 0.0])
    body = add_body(parts, parts.section("worldbody"), name, at)
    if not grown and rng.random() < 0.4 and parts.has("loose"):
        SubElement(body, "freejoint", name=f"{name}_free")
        making.loose.append(name)
    add_geom(parts, body, size, np.zeros(3), "box" if grown and rng.random() < 0.7 else None)
    if not grown and rng.random() < 0.4 and parts.has("jointed_obstacle"):
        add_tree(parts, body, 0.5 * size, int(rng.integers(1, 4)))


def add_doors(making: Making) -> None:
    """A frame with two doors that overlap by 0.2 mm at home, each drawn: no deeper than that is fine."""
    parts, unit = making.parts, making.parts.unit
    if unit < 0.01 or not parts.has("home_touch"):
        return
    at = np.array([-making.width - 4.0 * unit, making.width + 4.0 * unit, 2.0 * unit])
    frame = add_body(parts, parts.section("worldbody"), "doors", at)
    add_geom(parts, frame, 0.2 * unit, np.array([0.0, 3.0 * unit, 0.0]), "box")
    words = {}
    for side, sign in (("left", -1.0), ("right", 1.0)):
        door = add_body(parts, frame, f"door_{side}", np.array([sign * 2.0 * unit, 0.0, 0.0]), "doors")
        SubElement(door, "joint", name=f"hinge_{side}", axis="0 0 1", range="-1 1", limited="true", damping="0.01")
        half = np.array([unit + 0.0001 / 1.0, 0.1 * unit, unit])
        SubElement(door, "geom", name=f"leaf_{side}", type="box", size=text(*half), pos=text(-sign * unit, 0.0, 0.0))
        parts.geoms[f"leaf_{side}"] = f"door_{side}"
        words[f"hinge_{side}"] = {"range": [-0.3, 0.3]}
    making.objects["doors"] = {"kind": "static", "joints": words}
    making.things.append(Thing("doors", "doors", "static", drawn=tuple(words)))


def add_arm(making: Making) -> None:
    """A static chain of the model that its servos hold; some of its joints may be drawn."""
    parts, rng, unit = making.parts, making.parts.rng, making.parts.unit
    if not parts.has("held_arm"):
        return
    at = np.array([making.width + 8.0 * unit, 0.0, 0.0])
    base = add_body(parts, parts.section("worldbody"), "arm0", at)
    links = add_chain(making, parts, base, "arm0_", int(rng.integers(2, 5)))
    names = [str(link.findall("joint")[0].get("name")) for link in links]
    making.objects["arm0"] = {"kind": "static"}
    making.things.append(Thing("arm0", "arm0", "static", held=tuple(names)))


def make_robot(making: Making) -> tuple[str, dict[str, Any], Thing]:
    """A robot in a file of its own, with a fixed or a free base, servos, a keyframe, and fingers that mimic."""
    parts, rng, unit = making.parts, making.parts.rng, making.parts.unit
    bot = Parts(Element("mujoco", model="bot"), rng, {"box", "capsule"}, unit)
    SubElement(bot.root, "compiler", angle="radian", boundmass="1e-6", boundinertia="1e-13")
    base = add_body(bot, bot.section("worldbody"), "base", np.zeros(3))
    if parts.has("free_base_robot"):
        SubElement(base, "freejoint", name="root")
    else:
        parts.used.add("robot")
    links = add_chain(making, bot, base, "", int(rng.integers(2, 6)))
    link, joints = links[-1], list(bot.joints)
    words: dict[str, Any] = {}
    if parts.has("mimic"):
        for side, sign in (("left", 1.0), ("right", -1.0)):
            finger = add_body(bot, link, f"finger_{side}", np.array([0.0, sign * unit, 1.2 * unit]), "base")
            reach = text(0, 0.5 * unit) if sign > 0 else text(-0.5 * unit, 0)
            SubElement(finger, "joint", name=side, type="slide", axis="0 1 0", range=reach, limited="true")
            add_geom(bot, finger, 0.2 * unit, np.zeros(3), "box")
        SubElement(bot.section("equality"), "joint", joint1="left", joint2="right", polycoef="0 -1 0 0 0")
        words = {"left": {"fraction": [0.2, 0.8]}} if rng.random() < 0.5 else {"*": {"noise": 0.2 * unit}}
    elif rng.random() < 0.5:
        words = {"*": {"noise": 0.05}}
    plain = mujoco.MjModel.from_xml_string(tostring(bot.root, encoding="unicode"))
    qpos = plain.qpos0.copy()
    for joint in joints:
        qpos[plain.joint(joint.name).qposadr[0]] = 0.3 * rng.uniform(joint.low, joint.high)
    SubElement(SubElement(bot.root, "keyframe"), "key", name="home", qpos=text(*qpos))
    indent(bot.root)
    drawn = tuple(f"bot/{j.name}" for j in joints) if "*" in words else ()
    if "mimic" in parts.used:
        drawn = (*drawn, "bot/left", "bot/right") if words else drawn
    held = tuple(f"bot/{j.name}" for j in joints)
    at = [-making.width - 10.0 * unit - 0.1, 0.0, 0.0]
    thing = Thing("robot", "bot", "static", drawn=drawn, held=held)
    robot = {"asset": "bot.xml", "base": at, "joints": words}
    return tostring(bot.root, encoding="unicode"), robot, thing
