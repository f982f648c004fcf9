"""One step of the program: what is drawn for it, what carries it and is above it; obstacles, and what may lean."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.device import Cover, ObjectKind
from sceniris_gym.program.placed_object import JointRange, obstacles
from sceniris_gym.program.plan import build_plan
from tests.layout.scenes import write_mjcf
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
    assert (step.stable_poses, step.surfaces) == ([], [])


def test_a_support_leans_with_a_joint_that_follows(tmp_path: Path):
    """As it does with one that is drawn itself."""
    tray = """<geom type="box" size=".1 .1 .01"/>
      <body name="knob" pos=".3 0 .2"><joint name="knob" axis="0 0 1" range="-30 30"/><geom size=".01"/></body>
      <body name="tray" pos="0 0 .2"><joint name="tilt" axis="1 0 0" range="-30 30"/>
        <geom type="box" size=".1 .1 .01"/></body>"""
    rest = '<equality><joint joint1="tilt" joint2="knob"/></equality>'
    asset = write_mjcf(tmp_path, "stand", tray, rest)
    stand = {"asset": asset, "kind": "fixture", "on": "floor"}
    for joints, tilts in (({}, False), ({"knob": {"noise": 0.2}}, True)):
        scene = scene_of({"stand": {**stand, "joints": joints}, "apple": {"asset": "apple", "on": "stand/tray"}})
        assert build_plan(scene).objects[-1].tilts == tilts


def test_the_size_of_the_floor_is_its_full_extents():
    """It lies around the origin of the world, at height 0."""
    plan = build_plan(scene_of({"apple": {"asset": "apple", "on": "floor"}}, floor={"size": [2.0, 0.5]}))
    (ground,) = plan.objects[0].surfaces[0]
    assert (ground.body, ground.height) == (0, 0.0)
    assert ground.outline.bounds == (-1.0, -0.25, 1.0, 0.25)


@pytest.mark.parametrize(
    ("orientation", "tilts"), [("fixed", False), ({"yaw": [-30, 30]}, False), ("stable", True), ("any", True)]
)
def test_a_support_leans_as_its_object_may_lie(folder: Path, orientation: str | dict, tilts: bool):
    """A box that stands upright in all draws, or not."""
    box = {"asset": str(folder / "box.xml"), "on": "floor", "orientation": orientation}
    assert build_plan(scene_of({"box": box, "apple": {"asset": "apple", "on": "box"}})).objects[-1].tilts == tilts


def test_a_support_without_a_level_surface_is_told_with_those_that_have_one(folder: Path):
    """The floor first, then other objects and their parts by name; with `inside` there is no floor."""
    objects = {
        "pear": {"asset": "pear", "on": "floor"},
        "tray": {"asset": str(folder / "box.xml"), "kind": "static"},
        "cabinet": {"asset": "cabinet", "kind": "static"},
    }
    for word, floor in (("on", "floor, "), ("inside", "")):
        says = rf"objects\.apple\.{word}: 'pear' has no level surface.* Valid: {floor}cabinet, .*tray\."
        with pytest.raises(SceneKeyError, match=says):
            build_plan(scene_of({**objects, "apple": {"asset": "apple", word: "pear"}}))


def test_one_of_several_supports_without_room_is_named():
    """The error's key is the same for all of them."""
    objects = {"table": {"asset": "table", "kind": "static"}, "tin": {"asset": "tin", "kind": "static"}}
    book = {"asset": "book", "on": ["table", "tin"], "ratio_on_support": 1}
    with pytest.raises(SceneKeyError, match=r"objects\.book\.on: 'tin': no area of the support is left"):
        build_plan(scene_of({**objects, "book": book}))


def test_each_support_is_told_once(tmp_path: Path):
    """A body and its only geom are one support, and so are an object and its body; the object is none of its own."""
    room = """<mujoco><worldbody>
      <geom name="ball" size=".1" pos="0 0 3"/>
      <body name="table" pos="2 0 0"><geom name="top" type="box" size=".3 .3 .02"/></body>
      <body name="rack" pos="4 0 0"><geom name="board" type="box" size=".3 .3 .02"/>
        <geom name="hook" size=".1" pos="0 0 1"/></body>
      <body name="desk" pos="6 0 0"><geom name="plate" type="box" size=".3 .3 .02"/></body>
    </worldbody></mujoco>"""
    (tmp_path / "room.xml").write_text(room)
    objects = {"workbench": {"body": "desk", "kind": "static"}, "apple": {"asset": "apple", "on": "ball"}}
    with pytest.raises(SceneKeyError, match=r"Valid: floor, board, rack, table, workbench\.$"):
        build_plan(scene_of(objects, model=str(tmp_path / "room.xml")))


def test_pieces_are_sorted_by_body_and_planes_come_first(tmp_path: Path):
    """Whatever their order in the file."""
    body = '<geom type="box" size=".2 .2 .05" pos="0 0 .05"/><geom type="plane" size="1 1 .1"/><geom size=".1"/>'
    scene = scene_of(
        {"apple": {"asset": "apple"}, "slab": {"asset": write_mjcf(tmp_path, "slab", body), "kind": "static"}}
    )
    found = obstacles(scene)
    assert [p.body for p in found] == sorted(p.body for p in found)
    own = [p.type for p in found if p.body == scene.bodies["slab"]]
    assert own == [PieceType.PLANE, PieceType.BOX, PieceType.SPHERE]
