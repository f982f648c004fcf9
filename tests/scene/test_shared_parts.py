"""The tree that variants with joints share: which of their bodies are the same part, and which trees are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import NotSupportedError
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.shared_parts import shared_parts

BODY = '<geom type="box" size=".1 .1 .1" mass="1"/>'
DOOR = '<joint type="hinge" range="0 1" limited="true"/>'
DRAWER = '<joint type="slide" range="0 1" limited="true"/>'


def tree(name: str, *parts: str) -> str:
    """Return a root with some bodies below it."""
    return f'<body name="{name}">{BODY}{"".join(f"<body>{part}{BODY}</body>" for part in parts)}</body>'


def test_bodies_are_matched_in_order_by_their_joints():
    """A door with a handle, two drawers, and a door without limits beside a body without a joint.

    Parts are in the order that the bodies have in each of these trees.
    """
    handle = f"<body>{DOOR}{BODY}</body>"
    trees = tree("a", DOOR + handle), tree("b", DRAWER, DRAWER), tree("c", "<joint/>", "", DOOR, DRAWER)
    mjm = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{''.join(trees)}</worldbody></mujoco>")
    roots = [mjm.body(name).id for name in "abc"]
    a, b, c = roots
    assert [(part.label, part.parent, part.bodies) for part in shared_parts(mjm, roots, {})] == [
        ("", -1, (a, b, c)),
        ("free_hinge_0", 0, (-1, -1, c + 1)),
        ("fixed_0", 0, (-1, -1, c + 2)),
        ("hinge_0", 0, (a + 1, -1, c + 3)),
        ("slide_0", 0, (-1, b + 1, c + 4)),
        ("slide_1", 0, (-1, b + 2, -1)),
        ("hinge_0/hinge_0", 3, (a + 2, -1, -1)),
    ]


def test_bodies_are_matched_by_their_names_first():
    """The second drawer of one tree and the only drawer of another; others fill the places that are left.

    These trees do not agree about an order of the parts.
    """
    trees = tree("a", DRAWER, DRAWER, DRAWER), tree("b", DRAWER, DRAWER), tree("c", DOOR, DRAWER)
    mjm = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{''.join(trees)}</worldbody></mujoco>")
    a, b, c = (mjm.body(name).id for name in "abc")
    named = {a + 2: "top", a + 1: "low", b + 1: "top", c + 1: "top", c + 2: "low"}
    assert [(part.label, part.bodies) for part in shared_parts(mjm, [a, b, c], named)] == [
        ("", (a, b, c)),
        ("slide_0", (a + 1, b + 2, c + 2)),
        ("slide_1", (a + 2, b + 1, -1)),
        ("slide_2", (a + 3, -1, -1)),
        ("hinge_0", (-1, -1, c + 1)),
    ]


GEOM = '<geom type="box" size=".1 .1 .1" mass="1"/>'
BALL = f'{GEOM}<body pos="0 0 .3"><joint type="ball"/>{GEOM}</body>'
TWO = f'{GEOM}<body pos="0 0 .3"><joint type="slide"/><joint axis="1 0 0"/>{GEOM}</body>'
DEEP = f'{GEOM}<body pos="0 0 .3"><joint/>{GEOM}<body><joint/>{GEOM}<body><joint/>{GEOM}</body></body></body>'


@pytest.mark.parametrize(
    ("body", "message"),
    [(BALL, "should have one slide, one hinge or no joint"), (TWO, "should have one slide"), (DEEP, "2 levels below")],
)
def test_trees_that_cannot_be_shared_are_refused(tmp_path: Path, body: str, message: str):
    """Ball joints, several joints of a body, and more than two levels, with the body's name; free objects as before."""
    (tmp_path / "odd.xml").write_text(f'<mujoco><worldbody><body name="odd">{body}</body></worldbody></mujoco>')
    unit: dict[str, Any] = {"asset": ["cabinet", str(tmp_path / "odd.xml")], "kind": "fixture", "on": "floor"}
    scene = {"floor": {"size": [4, 4]}, "objects": {"unit": unit}}
    with pytest.raises(NotSupportedError, match=rf"objects\.unit/odd: body '.*' .*{message}"):
        build_model(SceneConfig.load(scene))
    unit |= {"asset": ["cabinet", "can"], "kind": "free"}
    with pytest.raises(NotSupportedError, match=r"unit/cabinet: has several bodies, .*'kind: fixture'"):
        build_model(SceneConfig.load(scene))


NAMED = {
    "tendons": '<tendon><fixed><joint joint="j" coef="1"/></fixed></tendon>',
    "tendons over sites": '<tendon><spatial><site site="s"/><site site="u"/></spatial></tendon>',
    "equalities": '<equality><joint joint1="j" joint2="k"/></equality>',
    "equalities of bodies": '<equality><weld body1="door" body2="lid"/></equality>',
    "actuators": '<actuator><position joint="j" kp="1"/></actuator>',
    "actuators at sites": '<actuator><general site="s" refsite="u" gear="1 0 0 0 0 0"/></actuator>',
    "sensors": '<sensor><jointpos joint="j"/></sensor>',
    "sensors of bodies": '<sensor><framepos objtype="xbody" objname="lid"/></sensor>',
    "excludes": '<contact><exclude body1="odd" body2="door"/></contact>',
    "pairs": '<contact><pair geom1="a" geom2="b"/></contact>',
}
"""Elements of an asset that name its parts, by the kinds that errors name."""


@pytest.mark.parametrize("kind", NAMED)
def test_elements_that_name_parts_of_variants_are_refused(tmp_path: Path, kind: str):
    """They would be lost in the simulation, where parts of variants share bodies and joints."""
    parts = (
        f'<body name="{body}" pos="{x} 0 .3"><joint name="{joint}" range="0 1" limited="true"/>'
        f'<geom name="{geom}" size=".1" mass="1"/><site name="{site}"/></body>'
        for body, joint, geom, site, x in (("door", "j", "a", "s", 0), ("lid", "k", "b", "u", 0.5))
    )
    body = f'<worldbody><body name="odd">{GEOM}{"".join(parts)}</body></worldbody>'
    (tmp_path / "odd.xml").write_text(f"<mujoco>{body}{NAMED[kind]}</mujoco>")
    unit: dict[str, Any] = {"asset": ["cabinet", str(tmp_path / "odd.xml")], "kind": "fixture", "on": "floor"}
    match = rf"objects\.unit/odd: is named as 'unit/odd.*' by one of the model's {kind.split()[0]}"
    with pytest.raises(NotSupportedError, match=match):
        build_model(SceneConfig.load({"floor": {"size": [4, 4]}, "objects": {"unit": unit}}))
