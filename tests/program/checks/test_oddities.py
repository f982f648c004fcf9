"""Warnings of what is accepted but was probably not meant."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import pytest
import trimesh

from sceniris_gym.config.loader import shipped
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ModelWarning
from sceniris_gym.program.checks.oddities import warn_of_oddities
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.build import build_model
from tests.layout.scenes import box_mjcf, write_mjcf
from tests.versions import since_4

SIX_AXES = Path(__file__).parents[2] / "data" / "six_axes.xml"

# A cube with a vertex in the middle of an edge, closed by a face without area.
_CORNERS = [(x, y, z) for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (0.0, 0.2)] + [(-0.1, -0.1, 0.1)]
_FACES = "0 2 6 0 6 4 1 5 7 1 7 3 2 3 7 2 7 6 4 6 7 4 7 5 0 1 3 0 3 2 0 4 8 8 4 5 8 5 1 0 8 1"


def warned(objects: dict, **others: object) -> list[str]:
    """The texts of all warnings about a scene of these objects."""
    scene = build_model(SceneConfig.load({"objects": objects, **others}))
    plan = build_plan(scene)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_oddities(plan)
    assert all(w.category is ModelWarning for w in caught)
    return [str(w.message) for w in caught]


def test_shipped_assets_give_no_warning():
    """Each of them alone, as MuJoCo collides it."""
    for asset, path in shipped("assets", ".xml").items():
        kind = "static" if "<freejoint" not in path.read_text() else "free"
        assert (
            warned(
                {"thing": {"asset": asset, "kind": kind, "region": {"box": [[0, 0, 0], [0, 0, 0]]}}}
                if kind == "free"
                else {"thing": {"asset": asset, "kind": kind}}
            )
            == []
        ), asset


def test_variants_that_share_few_bodies_are_named(tmp_path: Path):
    """Four doors without limits beside four with limits; three of them are as usual."""

    def asset(name: str, count: int, limits: str) -> str:
        box = '<geom type="box" size=".1 .1 .1" mass="1"/>'
        doors = "".join(f'<body pos="0 0 {i + 1}"><joint {limits}/>{box}</body>' for i in range(count))
        (tmp_path / f"{name}.xml").write_text(
            f'<mujoco><worldbody><body name="{name}">{box}{doors}</body></worldbody></mujoco>'
        )
        return str(tmp_path / f"{name}.xml")

    unit = {"kind": "fixture", "region": {"box": [[0, 0, 0], [1, 1, 0]]}}
    for count, told in ((3, 0), (4, 1)):
        files = [asset(f"a{count}", count, 'range="0 1" limited="true"'), asset(f"b{count}", count, "")]
        found = warned({"unit": {**unit, "asset": files}})
        assert len(found) == told, found
    assert "objects.unit: its variants need 9 bodies in the simulation, but none has more than 5" in found[0]


def test_faces_without_area_are_named_with_their_number(tmp_path: Path):
    """With the visual geometry alone, which has faces."""
    vertices = " ".join(f"{v}" for corner in _CORNERS for v in corner)
    rest = f'<asset><mesh name="cube" vertex="{vertices}" face="{_FACES}"/></asset>'
    asset = write_mjcf(tmp_path, "crate", '<geom name="skin" type="mesh" mesh="cube"/>', rest)
    objects = {"crate": {"asset": asset, "kind": "static"}}
    assert warned(objects) == []
    (text,) = warned(objects, geometry="visual")
    assert "faces without area are left out: 1 of geom 'crate/skin'" in text
    assert "remove degenerate faces" in text


@pytest.mark.parametrize("extra", ["0 1 1", "0 1 8"])
def test_a_face_without_area_beside_a_closed_surface_opens_nothing(tmp_path: Path, extra: str):
    """Of an edge of a plain cube, or of that and a vertex on it that nothing else has."""
    faces = "0 2 6 0 6 4 1 5 7 1 7 3 2 3 7 2 7 6 4 6 7 4 7 5 0 1 3 0 3 2 0 4 5 0 5 1"
    vertices = " ".join(f"{v}" for corner in _CORNERS for v in corner)
    rest = f'<asset><mesh name="cube" vertex="{vertices}" face="{faces} {extra}"/></asset>'
    asset = write_mjcf(tmp_path, "crate", '<geom name="skin" type="mesh" mesh="cube"/>', rest)
    (text,) = warned({"crate": {"asset": asset, "kind": "static"}}, geometry="visual")
    assert "faces without area are left out: 1 of geom 'crate/skin'" in text


def test_a_hull_that_fills_a_hollow_is_named_with_its_share(tmp_path: Path):
    """A cup in one mesh: by shared volumes of its outer and inner cylinder."""
    cup = trimesh.creation.annulus(r_min=0.03, r_max=0.04, height=0.1)
    vertices = " ".join(f"{v:.7f}" for v in cup.vertices.ravel())
    faces = " ".join(map(str, cup.faces.ravel()))
    rest = f'<asset><mesh name="cup" vertex="{vertices}" face="{faces}"/></asset>'
    asset = write_mjcf(tmp_path, "cup", '<geom name="wall" type="mesh" mesh="cup"/>', rest)
    (text,) = warned({"cup": {"asset": asset, "kind": "static"}})
    assert "geom 'cup/wall' (2.3 times its volume)" in text
    assert "several convex geoms" in text
    assert warned({"cup": {"asset": asset, "kind": "static"}}, geometry="visual") == []


@pytest.mark.parametrize(("size", "said"), [(354.0, "354"), (0.0008, "0.0008"), (49.0, None), (0.002, None)])
def test_an_implausible_size_is_named(size: float, said: str | None, tmp_path: Path):
    """It is the largest extent that counts."""
    found = warned({"rock": {"asset": box_mjcf(tmp_path, "rock", size, size / 2, size / 2), "kind": "static"}})
    assert [f"'rock' ({said} m)" in text for text in found] == [True] * (said is not None)


@pytest.mark.parametrize(
    ("scale", "said"),
    [(40, "'cup' (4 m, 3.2e+04 kg)"), (8, "'cup' (0.8 m, 256 kg)"), (21, "'cup' (2.1 m,"), (5, None)],
)
def test_a_free_object_of_metres_or_hundreds_of_kilograms_is_named(scale: float, said: str | None, tmp_path: Path):
    """Of half a kilogram and 10 cm before scaling. A fixed one may be as large."""
    box = box_mjcf(tmp_path, "cup", 0.1, 0.1, 0.05)
    free, fixed = ({"asset": box, "scale": scale, **words} for words in ({"on": "floor"}, {"kind": "static"}))
    found = warned({"cup": free, "fixed": fixed}, floor={"size": [20, 20]})
    assert len(found) == (said is not None)
    for text in found:
        assert str(said) in text and "'fixed'" not in text and "correct the asset's `scale`" in text


@pytest.mark.parametrize(("inertia", "number"), [(1.0, 1), (5e-3, 1), (1e-4, 0), (None, 0)])
def test_an_inertia_that_no_mass_of_this_size_has_is_named(inertia: float | None, number: int, tmp_path: Path):
    """At most 0.1 kg times the square of the half diagonal of 6 cm, if all of it were at the corners."""
    values = f'<inertial pos="0 0 0" mass="0.1" diaginertia="{inertia} {inertia} {inertia}"/>'
    box = '<freejoint/><geom type="box" size="0.04 0.04 0.02" mass="0.1"/>'
    asset = write_mjcf(tmp_path, "brick", (values if inertia else "") + box)
    found = warned({"brick": {"asset": asset, "on": "floor"}}, floor={"size": [1, 1]})
    assert [f"'brick' ({inertia:.2g} kg m2, but 0.1 kg within 0.06 m)" in text for text in found] == [True] * number


@pytest.mark.parametrize(("depth", "number"), [(0.015, 1), (0.0005, 0)])
def test_what_stands_inside_of_something_else_is_named_with_the_depth(depth: float, number: int, tmp_path: Path):
    """A static box sunk into a static desk, which MuJoCo does not report."""
    geoms = f"""<mujoco><worldbody>
      <body name="desk"><geom type="box" size=".5 .5 .05" pos="0 0 .05"/></body>
      <body name="base"><geom type="box" size=".1 .1 .1" pos="0 0 {0.2 - depth}"/></body>
      </worldbody></mujoco>"""
    (tmp_path / "own.xml").write_text(geoms)
    objects = {"desk": {"kind": "static"}, "base": {"kind": "static"}}
    found = warned(objects, model=tmp_path / "own.xml")
    assert ["of 'desk' is 15 mm inside" in text for text in found] == [True] * number
    assert all("geom '0 of body desk'" in text and "Correct their positions" in text for text in found)


def test_a_part_of_the_robot_has_the_name_that_a_scene_file_has_for_it():
    """Of its body, whose name in the model begins with the name of the arm's file."""
    robot = {"asset": str(SIX_AXES), "base": [0.0, 0.0, 0.38]}
    (text,) = warned({"table": {"asset": "table", "kind": "static"}}, robot=robot)
    assert re.search(r"geom '\d+ of body robot' of 'robot' is 20 mm inside geom 'table/top' of 'table'", text), text


PARTS = {
    "wall": '<body name="wall"><geom name="block" type="box" size=".1 .1 .1" pos="0 0 .1"/></body>',
    "crate": '<body name="crate" pos="0 0 .1"><freejoint/><geom name="side" type="box" size=".05 .05 .05"/></body>',
    "chest": """<body name="chest"><geom name="back" type="box" size=".2 .01 .1" pos="0 .3 .1"/>
      <body name="tray" pos="0 -.19 .1"><joint name="tray" type="slide" axis="0 1 0"/>
        <geom name="front" type="box" size=".1 .1 .05"/></body></body>""",
}
STATIC = {"kind": "static"}
PUSHED = "and contact forces push them apart"
ARM = """<mujoco><worldbody><body name="base"><geom type="box" size=".05 .05 .05" pos="0 0 .05"/>
  <body name="arm" pos="0 0 .3"><joint name="arm" axis="0 1 0"/>
    <geom name="finger" type="capsule" fromto="0 0 0 {reach} 0 0" size=".02"/></body></body></worldbody>
  <keyframe><key name="home" qpos="0"/></keyframe></mujoco>"""


@since_4("mj_geomDistance finds no depth of some boxes")
@pytest.mark.parametrize(
    ("parts", "objects", "said", "cure"),
    [
        (
            "wall crate",
            {"wall": STATIC},
            "geom 'side' of 'crate' is 150 mm inside geom 'block' of 'wall'",
            "as an object",
        ),
        (
            "wall crate",
            {"wall": STATIC, "crate": {}},
            "geom 'side' of 'crate' is 150 mm inside",
            "an `on` or a `region`",
        ),
        ("crate wall", {"crate": {}}, "geom 'side' of 'crate' is 150 mm inside geom 'block' of 'wall'", "a `region`"),
        ("wall chest", {"wall": STATIC, "chest": STATIC}, "geom 'front' of 'chest' is 10 mm inside", "its joints"),
        ("wall crate", {"crate": {"on": "floor"}}, None, ""),
    ],
)
def test_what_moves_is_told_that_it_is_pushed_out_of_what_it_is_in(
    parts: str, objects: dict, said: str | None, cure: str, tmp_path: Path
):
    """A crate, declared or not, and a tray: MuJoCo pushes them out, and each has its own remedy."""
    bodies = "".join(PARTS[name] for name in parts.split())
    (tmp_path / "own.xml").write_text(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    found = warned(objects, model=tmp_path / "own.xml", floor={"size": [2, 2]})
    assert len(found) == (said is not None)
    for text in found:
        assert said is not None
        assert said in text
        assert cure in text
        assert PUSHED in text
        assert "Correct their positions" not in text


def test_nothing_is_pushed_where_contacts_are_off(tmp_path: Path):
    """A flag of the model, or an exclude, that lets a crate stand in a wall."""
    bodies = PARTS["wall"] + PARTS["crate"]
    exclude = '<contact><exclude body1="wall" body2="crate"/></contact>'
    for head, tail in (('<option><flag contact="disable"/></option>', ""), ("", exclude)):
        (tmp_path / "own.xml").write_text(f"<mujoco>{head}<worldbody>{bodies}</worldbody>{tail}</mujoco>")
        assert warned({"wall": STATIC, "crate": {}}, model=tmp_path / "own.xml") == []


@pytest.mark.parametrize(("reach", "number"), [(0.3, 1), (0.1, 0)])
def test_a_link_of_the_robot_is_told_apart_from_its_base(reach: float, number: int, tmp_path: Path):
    """A finger in a wall: its keyframe, or the base."""
    (tmp_path / "arm.xml").write_text(ARM.format(reach=reach))
    wall = '<body name="wall" pos=".35 0 .3"><geom name="block" type="box" size=".1 .1 .1"/></body>'
    (tmp_path / "own.xml").write_text(f"<mujoco><worldbody>{wall}</worldbody></mujoco>")
    robot = {"asset": str(tmp_path / "arm.xml"), "base": [0, 0, 0]}
    found = warned({"wall": STATIC}, model=tmp_path / "own.xml", robot=robot)
    assert len(found) == number
    for text in found:
        assert "geom 'robot/finger' of 'robot' is 70 mm inside geom 'block' of 'wall'" in text
        assert "keyframe or `robot.base`" in text
        assert PUSHED in text


@pytest.mark.parametrize(("low", "number"), [(0.0, 1), (0.03, 0)])
def test_a_link_of_the_robot_that_is_in_its_own_base_is_named(low: float, number: int, tmp_path: Path):
    """MuJoCo pushes a link out of a base that is fixed to the world, though the base is its parent."""
    arm = ARM.replace('pos="0 0 .3"', f'pos="0 0 {0.1 + low}"').format(reach=0.3)
    (tmp_path / "arm.xml").write_text(arm)
    robot = {"asset": str(tmp_path / "arm.xml"), "base": [0, 0, 1]}
    found = warned({}, robot=robot, floor={"size": [1, 1]})
    assert ["geom 'robot/finger' of 'robot' is 20 mm inside geom '1 of body robot'" in text for text in found] == [
        True
    ] * number


def test_a_robot_of_the_model_is_moved_in_the_model(tmp_path: Path):
    """It has neither a base nor a keyframe of its own in the scene."""
    arm = '<body name="arm"><geom name="trunk" type="box" size=".1 .1 .1" pos="0 0 .1"/>{}</body>'
    finger = '<body pos="0 0 .3"><joint axis="0 0 1"/><geom name="finger" type="box" size=".3 .02 .02"/></body>'
    wall = '<body name="wall" pos=".35 0 .3"><geom name="block" type="box" size=".1 .1 .1"/></body>'
    (tmp_path / "own.xml").write_text(f"<mujoco><worldbody>{wall}{arm.format(finger)}</worldbody></mujoco>")
    (text,) = warned({"wall": STATIC}, model=tmp_path / "own.xml", robots={"left": {"in_model": "arm"}})
    assert "geom 'finger' of 'left'" in text
    assert "Correct the position of 'left' or the start pose of its joints" in text


WALL = """<mujoco><worldbody>
  <body name="wall" pos="{at} 3 .5"><geom name="wall" type="box" size="{half} .05 .5"/></body>
  <body name="crate"><freejoint/><geom type="box" size=".05 .05 .05" margin="{margin}"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("half", "at", "words", "margin", "says"),
    [
        (400, 390, {"clearance": 0.0}, 0, "'wall' (790 m, 61 um)"),
        (200, 0, {"clearance": 0.0}, 0, "'wall' (200 m, 15 um)"),
        (400, 390, {}, 0.01, "'wall' (790 m, 61 um)"),
        (400, 390, {}, 0, None),  # the usual clearance is far larger
        (120, 0, {"clearance": 0.0}, 0, None),
        (200, 600, {"clearance": 0.0}, 0, None),  # does not come near
        (400, 390, {"kind": "marker"}, 0, None),
    ],
)
def test_what_reaches_far_is_named_where_rounding_may_use_up_a_clearance(
    tmp_path: Path, half: float, at: float, words: dict, margin: float, says: str | None
):
    """With how far it reaches, and the rounding there."""
    text = WALL.format(half=half, at=at, margin=margin)
    if words.get("kind") == "marker":
        text = text.replace("<freejoint/>", "")
    (tmp_path / "own.xml").write_text(text)
    crate = {"crate": {"on": "floor", **words}}
    found = warned(crate, model=str(tmp_path / "own.xml"), floor={"size": [2, 2]})
    assert len(found) == (says is not None)
    if says is not None:
        assert says in found[0]
        assert "128 m" in found[0]
        assert "'clearance' of at least 0.0001" in found[0]
