"""The objects of a hostile model that its scene places, and the words that place them and draw their joints."""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from tests.generators.hostile_bodies import add_body, add_geom, add_tree
from tests.generators.hostile_making import Making
from tests.generators.hostile_words import Thing


def add_object(making: Making, name: str) -> None:
    """A body that the scene places: what it is made of, and the words that place it."""
    parts, rng, unit = making.parts, making.parts.rng, making.parts.unit
    size = unit * float(rng.uniform(0.6, 1.2))
    body = add_body(parts, parts.section("worldbody"), name, making.somewhere(2.0, 6.0))
    kind = "free"
    if rng.random() < 0.4 and parts.has("fixture"):
        kind = "fixture"
    elif rng.random() < 0.4 and parts.has("marker"):
        kind = "marker"
    if kind == "free":
        SubElement(body, "freejoint", name=f"{name}_free")
        making.free.append(name)
    flat = bool({"hull", "mesh"} & parts.wanted) or rng.random() < 0.5
    stacking = size > 0.03 and "stacked" in parts.wanted and not making.things
    root = "box" if stacking or (flat and "stable" in parts.wanted) else None
    first = add_geom(parts, body, size, np.zeros(3), root)
    if stacking:
        first.attrib.pop("euler", None)  # its top is level
    if not stacking:
        for _ in range(int(rng.integers(0, 3)) if not (flat and "stable" in parts.wanted) else 0):
            add_geom(parts, body, 0.7 * size, rng.normal(size=3) * 0.5 * size)
    words: dict[str, Any] = {} if kind == "free" else {"kind": kind}
    if rng.random() < 0.6 and "nested" in parts.wanted and kind != "marker":
        add_tree(parts, body, 0.7 * size, int(rng.integers(1, 4)))
    support = _place(making, words)
    turned = words.get("on") == "floor" or "region" in words
    lies = support in ("world", "table") and kind == "free" and flat and not stacking
    if lies and rng.random() < 0.6 and parts.has("stable"):
        words |= {"orientation": "stable", "ratio_on_support": 1.0}  # what hangs over an edge may tip
    elif turned and not stacking and rng.random() < 0.5 and parts.has("any"):
        words["orientation"] = "any"
    elif rng.random() < 0.3:
        words["orientation"] = "fixed"
    if parts.has("clearance"):
        words["clearance"] = float(rng.choice([0.0, 0.002, 0.01])) if unit > 0.02 else 0.0
    making.objects[name] = words
    stable = words.get("orientation") == "stable"
    making.things.append(Thing(name, name, kind, placed=True, support=support, stable=stable))


def _place(making: Making, words: dict[str, Any]) -> str | None:
    """Draw where an object goes; return the body that carries it."""
    parts, rng, unit, width = making.parts, making.parts.rng, making.parts.unit, making.width
    carriers = [t.name for t in making.things if t.placed and t.support and t.kind != "marker"]
    if rng.random() < 0.5 and parts.has("region_3d"):
        words["region"] = {"box": [[-width, -width, 6.0 * unit + 0.1], [width, width, min(14.0 * unit + 0.2, 99.0)]]}
        return None
    first = f"{carriers[0]}_g0" if carriers else ""
    stacks = first in parts.geoms and "stacked" in parts.wanted and making.things[0].name == carriers[0]
    fits = stacks and _is_level(parts.elements[carriers[0]]) and all(t.support != carriers[0] for t in making.things)
    if stacks and (fits or rng.random() < 0.1):  # what does not fit is mostly refused, and rightly so
        words["on"] = carriers[0]
        parts.used.add("stacked")
        return carriers[0]
    if "table" in making.objects and rng.random() < 0.6:
        words["on"] = "table"
        return "table"
    words["on"] = "floor"
    return "world"


def _is_level(body: Element) -> bool:
    """Return whether a body has a level top that is wide enough for something."""
    geom = body.find("geom")
    if geom is None or geom.get("type") != "box" or geom.get("euler"):
        return False
    return min(float(half) for half in str(geom.get("size")).split()[:2]) > 0.01


def draw_joints(making: Making, followers: list[str]) -> None:
    """Words that draw the joints of some objects; a joint that follows another one is mostly left out."""
    parts, rng = making.parts, making.parts.rng
    for i, thing in enumerate(making.things):
        joints = [j for j in parts.joints if j.owner == thing.name and (j.name not in followers or rng.random() < 0.3)]
        feature = "drawn_static" if thing.kind == "static" else "drawn"
        if not joints or thing.drawn or feature not in parts.wanted:
            continue
        parts.used.add(feature)
        chosen = [joints[k] for k in rng.permutation(len(joints))[: int(rng.integers(1, 4))]]
        words = {}
        for joint in chosen:
            low, high = 0.4 * joint.low, 0.4 * joint.high
            words[joint.name] = [
                {"fraction": [0.3, 0.7]},
                {"range": [low, high]},
                {"noise": 0.2 * joint.high},
                {"choice": [low, 0.0, high]},
                {"value": low},
            ][int(rng.integers(5))]
        making.objects[thing.name] = {**making.objects[thing.name], "joints": words}
        making.things[i] = Thing(**(vars(thing) | {"drawn": tuple(words)}))
