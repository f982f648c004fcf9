"""Refusals of things that cannot stand, with what would be right."""

from __future__ import annotations

from typing import Any

import mujoco
import pytest

from sceniris_gym.errors import SceneKeyError
from tests.program.scenes import checked, scene_of

MODEL = """<mujoco><option gravity="{gravity}">{flag}</option><worldbody>
  <body name="bench"><geom name="bench" type="box" size=".3 .3 .2" pos="0 0 .2"/></body>
  <body name="stand"><geom type="box" size=".02 .1 .1" pos="0 0 .1"/>
    <body name="board" pos="0 0 .22"><joint name="turn" axis="0 1 0" {joint}/>
      <geom type="box" size=".3 .1 .01"/></body></body>
  <body name="stool" pos="2 0 .0505"><freejoint/><geom type="box" size=".05 .05 .05"/>
    <geom type="box" size=".3 .3 .01" pos="0 0 .06" density="100"/></body>
  <body name="crate" {body}><freejoint/><geom name="crate" type="box" size=".05 .05 .05" {geom}/>{more}</body>
</worldbody>{rest}</mujoco>"""
LID = '<worldbody><body name="lid"><freejoint/><geom type="box" size=".04 .04 .01"/></body></worldbody>'
BEAM = '<geom type="box" size=".1 .02 .02" pos=".3 0 .1"/>'


def made(on: str = "bench", words: dict[str, Any] | None = None, **parts: str) -> None:
    """Check the scene of a crate on a bench or on a board that turns."""
    blank = dict.fromkeys(("flag", "joint", "body", "geom", "more", "rest"), "")
    text = MODEL.format(**{**blank, "gravity": "0 0 -9.81", **parts})
    objects = {"stand": {"kind": "static"}, "stool": {}, "crate": {"on": on, **(words or {})}}
    objects |= {"lid": {"on": "crate", **(words or {})}} if "lid" in text else {}
    checked(scene_of(objects, model=mujoco.MjSpec.from_string(text)))


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "sideways": ({"gravity": "0 -9.81 0"}, r"crate\.on: gravity is \[0\.0, -9\.81, 0\.0\], and should point down"),
    "tilted": ({"gravity": "0 .2 -9.81"}, r"should point down the z axis to 1 degree"),
    "upward": ({"gravity": "0 0 9.81"}, r"should point down"),
    "a flag": ({"flag": '<flag contact="disable"/>'}, r"a flag of the model switches contacts off"),
    "bits": ({"geom": 'contype="2" conaffinity="2"'}, r"'crate' falls through 'bench', as no geom of it collides"),
    "an exclude": (
        {"rest": '<contact><exclude body1="bench" body2="crate"/></contact>'},
        r"'crate' falls through 'bench', .* take an <exclude> out",
    ),
    "gravcomp": ({"body": 'gravcomp="1.2"'}, r"'gravcomp' leaves it no weight"),
    "an overhang": ({"more": BEAM}, r"'crate' falls over: its centre of mass is [0-9.]+ mm outside of its foot"),
    "a soft contact": ({"geom": 'solref="1.5 1" priority="1"'}, r"'crate' sinks into its support by [0-9.]+ mm"),
    "a soft pair": (
        {"rest": '<contact><pair geom1="bench" geom2="crate" solref=".4 1"/></contact>'},
        r"'crate' sinks into its support by [0-9.]+ mm",
    ),
    "no friction": (
        {"geom": 'friction="0 0 0" priority="1"', "rest": LID},
        r"lid\.on: 'lid' slides off 'crate', as the friction between them is 0 and should be 0\.02",
    ),
    "no friction on a tilt": (
        {"gravity": ".1 0 -9.8", "geom": 'condim="1" priority="1"'},
        "'crate' slides off 'bench'",
    ),
    "no friction, whatever the override says": (
        {"gravity": ".1 0 -9.8", "geom": 'condim="1" priority="1"', "flag": '<flag override="enable"/>'},
        "'crate' slides off 'bench'",
    ),
    "a loose stool": (
        {"on": "stool"},
        r"gives way by [0-9.]+ mm under 1 kg, by free body 'stool'\. Place",
    ),
    "a seesaw": ({"on": "stand/board"}, r"its support gives way by [0-9.]+ mm under 1 kg, by joint 'turn'"),
    "weak friction": ({"on": "stand/board", "joint": 'frictionloss=".5"'}, "gives way"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_stand_is_refused_by_name(case: str):
    """The object, its support or the joint is in the message; `stands: false` lets it fall."""
    parts, message = REFUSED[case]
    with pytest.raises(SceneKeyError, match=message):
        made(**parts)
    made(**parts, words={"stands": False})


@pytest.mark.parametrize("joint", ['frictionloss="30"', 'range="0 .1" stiffness="2000"'])
def test_a_joint_that_holds_the_load_is_a_support(joint: str):
    """By its friction, or by its spring."""
    made(on="stand/board", joint=joint, words={"region": {"box": [[-0.1, -0.1], [0.1, 0.1]]}})


def test_a_loose_support_that_holds_the_load_is_one():
    """A stool that is not placed carries things over its foot."""
    made(on="stool", words={"region": {"box": [[-0.02, -0.02], [0.02, 0.02]]}})


def test_nothing_pulls_without_gravity():
    """Things without weight stay where they are put."""
    made(gravity="0 0 0")


def test_more_levels_than_there_is_room_for_are_refused():
    """Thirteen crates on each other."""
    names = [f"c{i}" for i in range(13)]
    bodies = "".join(f'<body name="{n}"><freejoint/><geom type="box" size=".05 .05 .05"/></body>' for n in names)
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    objects = {name: {"on": below} for below, name in zip(["floor", *names], names, strict=False)}
    with pytest.raises(SceneKeyError, match=r"c12\.on: 13 free objects stand on each other, which should be 12"):
        checked(scene_of(objects, model=spec))


def test_visible_pieces_carry_nothing():
    """With visual geometry the contacts are those of the geoms that collide, wherever these end."""
    objects = {"pan": {"asset": "pan", "on": "floor"}, "block": {"asset": "block", "in": "pan"}}
    checked(scene_of(objects, geometry="visual"))
    text = """<mujoco><worldbody><body name="bench">
      <geom type="box" size=".3 .3 .2" pos="0 0 .2" contype="0" conaffinity="0"/>
      <geom type="box" size=".3 .3 .199" pos="0 0 .199" group="3" solref="1.5 1" priority="1"/></body>
      <body name="crate"><freejoint/><geom type="box" size=".05 .05 .05"/></body></worldbody></mujoco>"""
    spec = mujoco.MjSpec.from_string(text)
    with pytest.raises(SceneKeyError, match="'crate' sinks into its support"):
        checked(scene_of({"crate": {"on": "bench"}}, model=spec, geometry="visual"))
