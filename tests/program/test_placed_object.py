"""One step of the program: what its joints are drawn from, what carries it, and what has to be above it."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.program.device import Cover, ObjectKind
from sceniris_gym.program.placed_object import JointRange
from sceniris_gym.program.plan import build_plan
from tests.program.scenes import scene_of


def test_a_joint_is_drawn_from_an_interval_or_from_points():
    """A choice leaves the interval aside."""
    assert JointRange(3, -0.5, 0.25).intervals == [(-0.5, 0.25)]
    assert JointRange(3, 0.0, 0.0, (0.1, -0.2)).intervals == [(0.1, 0.1), (-0.2, -0.2)]


@pytest.mark.parametrize(
    ("words", "roof"),
    [
        ({"on": "floor"}, Cover.EITHER),
        ({"on": "cabinet"}, Cover.OPEN),
        ({"in": "cabinet/upper_drawer"}, Cover.EITHER),
        ({"inside": "cabinet/upper_drawer"}, Cover.COVERED),
        ({"on": "wall"}, Cover.EITHER),
        ({"region": {"box": [[0, 0, 1], [1, 1, 2]]}}, Cover.EITHER),
    ],
    ids=str,
)
def test_a_roof_is_asked_for_by_the_word_and_under_objects_only(tmp_path: Path, words: dict, roof: Cover):
    """The floor and static geometry of no object are open wherever there is room."""
    wall = '<body name="wall"><geom name="wall" type="box" size=".5 .5 .1" pos="3 0 .1"/></body>'
    (tmp_path / "own.xml").write_text(f"<mujoco><worldbody>{wall}</worldbody></mujoco>")
    objects = {"cabinet": {"asset": "cabinet", "kind": "static"}, "apple": {"asset": "apple", **words}}
    scene = scene_of(objects, model=str(tmp_path / "own.xml"))
    (apple,) = build_plan(scene).objects
    assert apple.cover == roof
    assert apple.kind == ObjectKind.FREE
    name = next((value for word, value in words.items() if word != "region"), None)
    body = None if name is None else scene.mjm.body("world" if name == "floor" else name).id
    assert apple.ground == body


def test_what_only_draws_joints_stands_on_nothing(folder: Path):
    """It has no poses and no surfaces."""
    gadget = {"asset": str(folder / "gadget.xml"), "kind": "static", "joints": {"slide": {"value": 0.1}}}
    (step,) = build_plan(scene_of({"gadget": gadget})).objects
    assert (step.kind, step.ground, step.cover) == (ObjectKind.STATIC, None, Cover.EITHER)
    assert (step.variants, step.surfaces) == ([], [])
