"""Couplings between the parts of a hostile model: contact rules, equalities, tendons and actuators."""

from __future__ import annotations

from itertools import pairwise
from xml.etree.ElementTree import SubElement

import numpy as np

from tests.generators.hostile_bodies import Joint, Parts, text


def add_contact_rules(parts: Parts, objects: list[str]) -> None:
    """Explicit pairs, which override bits and excludes, and excludes of bodies; each touches a placed object."""
    rng, contact = parts.rng, parts.section("contact")
    mine = [geom for geom, body in parts.geoms.items() if parts.bodies.get(body) in objects]
    for feature in ("pair", "pair_margin"):
        for _ in range(int(rng.integers(1, 4)) if feature in parts.wanted and mine else 0):
            one = str(rng.choice(mine))
            owner = parts.bodies[parts.geoms[one]]
            others = [g for g, body in parts.geoms.items() if parts.bodies.get(body) != owner]
            if not others:
                continue
            pair = SubElement(contact, "pair", geom1=one, geom2=str(rng.choice(others)))
            parts.used.add(feature)
            if feature == "pair_margin":
                margin = min(float(rng.uniform(0.1, 0.6)) * parts.unit, 0.05)
                pair.set("margin", text(margin))
                pair.set("gap", text(margin * float(rng.choice([0.0, 0.5]))))
    for _ in range(int(rng.integers(1, 4)) if len(parts.bodies) > 1 and parts.has("exclude") else 0):
        one = str(rng.choice([b for b, owner in parts.bodies.items() if owner in objects]))
        other = str(rng.choice([b for b in parts.bodies if b != one]))
        SubElement(contact, "exclude", body1=one, body2=other)


def scalar_pairs(parts: Parts) -> list[tuple[Joint, Joint]]:
    """Hinges and slides of one object that nothing couples yet, two by two."""
    free = [j for j in parts.joints if not j.coupled]
    return [(a, b) for a, b in pairwise(free) if a.owner == b.owner]


def add_joint_couplings(parts: Parts) -> list[Joint]:
    """Joint equalities, fixed tendons, their limits and equalities. Return joints that follow another one."""
    rng, followers = parts.rng, []
    for feature in ("joint_equality", "tendon_equality", "tendon_limit", "fixed_tendon"):
        pairs = scalar_pairs(parts) if feature in parts.wanted else []
        if not pairs:
            continue
        parts.used.add(feature)
        one, other = pairs[int(rng.integers(len(pairs)))]
        ratio = one.high / other.high * float(rng.uniform(0.3, 0.9)) * float(rng.choice([-1.0, 1.0]))
        if feature == "joint_equality":
            bend = 0.1 * abs(ratio) / other.high * float(rng.integers(2))
            coefs = text(0, ratio, bend, 0, 0)
            SubElement(parts.section("equality"), "joint", joint1=one.name, joint2=other.name, polycoef=coefs)
        else:
            name = f"fixed_{feature}"
            tendon = SubElement(parts.section("tendon"), "fixed", name=name)
            SubElement(tendon, "joint", joint=one.name, coef="1")
            SubElement(tendon, "joint", joint=other.name, coef=text(-ratio))
            if feature == "tendon_limit":
                tendon.set("limited", "true")
                tendon.set("range", text(-0.2 * one.high, 0.2 * one.high))
            elif feature == "tendon_equality":
                SubElement(parts.section("equality"), "tendon", tendon1=name, polycoef="0 1 0 0 0")
        if feature != "fixed_tendon":
            one.coupled = other.coupled = True
            followers.append(one)
    free = [j for j in parts.joints if not j.coupled]
    if "constant_equality" in parts.wanted and free:
        parts.used.add("constant_equality")
        joint = free[int(rng.integers(len(free)))]
        joint.coupled = True
        SubElement(parts.section("equality"), "joint", joint1=joint.name, polycoef="0 0 0 0 0")
        followers.append(joint)
    return followers


def add_body_couplings(parts: Parts, free: list[str], loose: list[str]) -> None:
    """Welds and connects: of what stays at home, and of objects that are placed; some of the latter switched off."""
    rng, equality = parts.rng, parts.section("equality")
    for feature in ("weld", "connect"):
        if loose and parts.has(feature):
            body = str(rng.choice(loose))
            more = {"anchor": text(*rng.normal(size=3) * parts.unit)} if feature == "connect" else {}
            if len(loose) > 1 and rng.random() < 0.5:
                more["body2"] = next(b for b in loose if b != body)
            SubElement(equality, feature, more, body1=body)
    for feature in ("weld_placed", "connect_placed", "inactive"):
        if free and parts.has(feature):
            kind = "connect" if feature == "connect_placed" or rng.random() < 0.3 else "weld"
            more = {"anchor": "0 0 0"} if kind == "connect" else {}
            if len(free) > 1:
                more["body2"] = free[1]
            if feature == "inactive":
                more["active"] = "false"
            SubElement(equality, kind, more, body1=free[0])


def add_spatial_tendons(parts: Parts, free: list[str]) -> None:
    """Tendons through sites of two bodies: they only measure, or have a length that they may not exceed."""
    rng = parts.rng
    for feature in ("spatial_tendon", "spatial_limit"):
        if not free or feature not in parts.wanted:
            continue
        parts.used.add(feature)
        tendon = SubElement(parts.section("tendon"), "spatial", name=f"string_{feature}", width="0.001")
        ends = [parts.elements[str(rng.choice(free))], parts.section("worldbody")]
        for i, end in enumerate(ends):
            SubElement(end, "site", name=f"{feature}_{i}", pos=text(*rng.normal(size=3) * parts.unit))
            SubElement(tendon, "site", site=f"{feature}_{i}")
        if feature == "spatial_limit":
            tendon.set("limited", "true")
            tendon.set("range", text(0, 0.5 * parts.unit))


_SERVO = ("position", "intvelocity", "general", "filtered", "delay")
_ACTUATORS = (*_SERVO, "motor", "velocity", "damper", "cylinder_actuator", "muscle")


def add_actuator(parts: Parts, feature: str, joint: Joint, gain: float) -> None:
    """Give a joint an actuator; servos may hold it wherever it is drawn."""
    rng = parts.rng
    parts.used.add(feature)
    kind = {"filtered": "position", "delay": "position", "cylinder_actuator": "cylinder"}.get(feature, feature)
    actuators = parts.section("actuator")
    name = f"act{len(actuators)}_{joint.name}"
    actuator = SubElement(actuators, kind, name=name, joint=joint.name)
    gear = float(rng.choice([1.0, 1.0, -1.0, 2.0]))
    if gear != 1.0:
        actuator.set("gear", text(gear))
    if kind in ("position", "intvelocity"):
        actuator.set("kp", text(gain))
        actuator.set("kv", text(0.1 * gain))
    if feature == "intvelocity":
        reach = abs(gear) * joint.high
        actuator.set("actrange", text(-reach, reach))
    if feature == "filtered":
        actuator.set("timeconst", "0.05")
    if feature == "delay":
        actuator.set("delay", "0.02")
        actuator.set("nsample", str(int(rng.integers(2, 12))))
    if feature == "general":
        actuator.set("dyntype", str(rng.choice(["none", "filterexact", "filter"])))
        actuator.set("dynprm", "0.05")
        actuator.set("gainprm", text(gain))
        actuator.set("biastype", "affine")
        actuator.set("biasprm", text(0, -gain, -0.1 * gain))
    if feature == "muscle":  # else MuJoCo simulates until it has found it, which may take for ever
        actuator.set("lengthrange", text(abs(gear) * joint.low, abs(gear) * joint.high))
    if feature == "velocity":
        actuator.set("kv", text(0.1 * gain))
    if feature == "damper":
        actuator.set("kv", text(0.1 * gain))
        actuator.set("ctrlrange", "0 1")
    if feature == "cylinder_actuator":
        actuator.set("area", text(0.1 * gain))
        actuator.set("timeconst", "0.1")


def add_actuators(parts: Parts, drawn: list[str]) -> None:
    """Actuators of every kind that the model shall have, half of them on drawn joints."""
    rng = parts.rng
    gain = 500.0 * parts.unit**3
    for feature in _ACTUATORS:
        if not parts.joints or feature not in parts.wanted:
            continue
        mine = [j for j in parts.joints if j.name in drawn and not j.coupled]
        pool = mine if mine and rng.random() < 0.6 else parts.joints
        add_actuator(parts, feature, pool[int(rng.integers(len(pool)))], gain)
    tendons = [t.get("name") for t in parts.section("tendon").findall("fixed")]
    if tendons and parts.has("tendon_actuator"):
        name = str(tendons[0])
        SubElement(parts.section("actuator"), "position", name=f"act_{name}", tendon=name, kp=text(gain))
    if parts.bodies and parts.has("adhesion"):
        body = str(rng.choice(sorted(parts.bodies)))
        SubElement(parts.section("actuator"), "adhesion", name=f"suck_{body}", body=body, ctrlrange="0 1", gain="1")


def home_positions(parts: Parts) -> dict[str, float]:
    """Positions of a keyframe: joints that nothing couples are anywhere in the middle half of their limits."""
    return {j.name: float(parts.rng.uniform(-0.5, 0.5)) * j.high for j in parts.joints if not j.coupled}


def quaternion(rng: np.random.Generator) -> np.ndarray:
    """A unit quaternion, uniform over rotations."""
    values = rng.normal(size=4)
    return values / np.linalg.norm(values)
