"""Words of an object that cannot hold are refused by their key: supports, relations, draws, heaps and `reachable`."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.bounds import MAX_CORNERS, MAX_PIECES
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.tier import Tier
from sceniris_gym.errors import MapError, NotSupportedError, ReachWarning, SceneKeyError, ScenirisError
from sceniris_gym.program.checks.objects import check_reach
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.build import build_model
from tests.layout.crane import crane_map, crane_mjcf, crane_scene
from tests.layout.scenes import box_mjcf, write_mjcf
from tests.program.scenes import checked, pack, scene_of
from tests.scene.heaping import folder, words
from tests.scene.test_couplings import TIE, placed

OWN = """<mujoco><worldbody>
  <body name="ground"><geom type="plane" size="0 0 .1"/></body>
  <body name="ramp" euler="{lean} 0 0"><geom type="box" size=".2 .2 .01"/></body>
  <body name="crate"><freejoint/><geom type="box" size=".02 .02 .02"/></body>
</worldbody></mujoco>"""
NEAR = {"region": {"box": [[-0.3, -0.3], [0.3, 0.3]]}}
REFUSED: dict[str, tuple[dict[str, Any], type[ScenirisError], str]] = {
    "a ramp": (
        {"on": "ramp"},
        NotSupportedError,
        r"crate\.on: the z axis of 'ramp' leans by 10 degrees at home, .* up",
    ),
    "an endless plane": (
        {"on": "ground"},
        SceneKeyError,
        r"crate\.on: the plane 'ground' is endless\. Give .*, as in objects\.crate\.region: {box: \[\[-0\.3",
    ),
    "a share of it": (
        {"on": "ground", "region": {"fraction": [[0, 0], [1, 1]]}},
        SceneKeyError,
        "the plane 'ground' is endless",
    ),
    "inside the floor": (
        {"inside": "floor"},
        SceneKeyError,
        r"crate\.inside: the floor has no inside, because it has no cover\. Write 'on: floor'",
    ),
}
RING = {"near": "rack", "distance": {"equal": 2.0, "tolerance": 1e-4}}
# Two boards, and a shelf that is higher.
RACK = "".join(
    f'<geom type="box" size="{x} {y} .01" pos="{px} {py} {z}"/>'
    for x, y, px, py, z in ((0.5, 0.1, 0, 0.4, 0.1), (0.5, 0.1, 0, -0.4, 0.1), (0.2, 0.2, 1.0, 0, 0.3))
)


def _check(folder: Path, crate: dict[str, Any], lean: float = 10.0) -> None:
    (folder / "own.xml").write_text(OWN.format(lean=lean))
    checked(scene_of({"crate": crate}, model=str(folder / "own.xml")))


@pytest.mark.parametrize(("crate", "error", "says"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_carry_is_refused(tmp_path: Path, crate: dict[str, Any], error: type[ScenirisError], says: str):
    """By the key that names it."""
    with pytest.raises(error, match=says):
        _check(tmp_path, crate)


def test_what_ends_and_stands_upright_carries(tmp_path: Path):
    """A region of the plane, the floor, and a ramp that leans by less than a tenth of a degree."""
    for crate in ({"on": "ground", **NEAR}, {"on": "floor"}, {"on": "ramp"}):
        _check(tmp_path, crate, lean=0.09)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            {"relations": [{"front_of": "a"}, {"between": ["a", "b"]}]},
            r"goal\.relations\.1\.width: 'goal' has no geom that collides, so it has no width\. Give a width \[m\]",
        ),
        (
            {"orientation": "stable"},
            r"goal\.orientation: the object has no collision geometry and no stable pose\. Give",
        ),
    ],
    ids=["a point between", "a stable point"],
)
def test_a_marker_without_an_asset_has_neither_a_width_nor_a_stable_pose(words: dict[str, Any], says: str):
    """It is a point."""
    block = {"asset": "block", "on": "floor"}
    goal = {"kind": "marker", "on": "floor", **words}
    with pytest.raises(SceneKeyError, match=rf"objects\.{says}"):
        checked(scene_of({"a": block, "b": block, "goal": goal}))


def test_draws_that_take_a_follower_beyond_its_limits_are_refused(tmp_path: Path):
    """With the positions, the limits and what to draw less of."""
    with pytest.raises(SceneKeyError) as caught:
        checked(placed(tmp_path, TIE.replace(".5", "-1"), {"left": {"fraction": [0, 1]}}))
    for text in (
        "objects.pair.joints",
        "equality 'pair/gear' (joint)",
        "'pair/right' follow 'pair/left'",
        "from -0.3 to 0.1",
        "[-0.1, 0.2]",
        "Draw 'pair/left' from a smaller range",
    ):
        assert text in str(caught.value)


def test_a_joint_of_something_else_cannot_follow(tmp_path: Path):
    """Two objects of an own model; where nothing is drawn both stay as they are."""
    doors = "".join(
        f'<body name="{n}" pos="{x} 0 0"><joint name="{n}"/><geom size=".1"/></body>' for x, n in enumerate("ab")
    )
    (tmp_path / "own.xml").write_text(
        f"<mujoco><worldbody>{doors}</worldbody><equality><joint joint1='a' joint2='b'/></equality></mujoco>"
    )
    objects: dict[str, Any] = {"a": {"kind": "static"}, "b": {"kind": "static"}}
    checked(scene_of(objects, model=str(tmp_path / "own.xml")))
    objects["b"]["joints"] = {"b": {"range": [0, 1]}}
    with pytest.raises(
        NotSupportedError,
        match=r"objects.b.joints: .* makes joint 'a' follow the drawn joint 'b', but 'a' is not part of 'b'",
    ):
        checked(scene_of(objects, model=str(tmp_path / "own.xml")))


def test_rows_of_other_shapes_are_refused(tmp_path: Path):
    """One of the blocks is thicker now; as they were settled they are fine."""
    checked(build_model(SceneConfig.load(words(folder()))))
    (tmp_path / "block.xml").write_text(
        '<mujoco><worldbody><body><geom type="box" size=".03 .02 .016"/></body></worldbody></mujoco>'
    )
    changed = {"objects.b.asset": str(tmp_path / "block.xml")}
    with pytest.raises(SceneKeyError, match="was settled with other shapes or masses"):
        checked(build_model(SceneConfig.load(words(folder()), changed)))


def reaching(scene: dict[str, Any]) -> Any:
    """The arms and reach targets of a scene, checked."""
    plan = build_plan(build_model(SceneConfig.load(scene)))
    check_reach(plan)
    return plan.reaching


def test_an_arm_without_a_map_is_told_how_to_build_one(folder: Path, cube: str):
    """For a map tier; `ik` needs none, and decides by default."""
    asset = crane_mjcf(folder, "unmapped")
    for tier in ("map", "map_strict"):
        with pytest.raises(
            MapError, match=r"objects\.thing\.reachable: .*'sceniris-gym reach .*--build -o .*unmapped\.reach'"
        ):
            reaching(crane_scene(asset, cube, reachable=tier))
    for word in ("ik", True):
        assert reaching(crane_scene(asset, cube, reachable=word)).targets[0].tier == Tier.IK


@pytest.mark.parametrize(
    ("form", "error", "says"),
    [
        ({"tilt": 0.1}, {}, "first joint"),
        ({"offset": 0.02}, {}, "TCP is 20 mm off"),
        ({}, {"turn_error": 0.2}, "which maps ignore"),
        (
            {},
            {"false_accepts": 0.0051},
            r"too coarse: 0\.51% of the poses .* \(build it with finer steps than --step 0\.2",
        ),
    ],
    ids=["leaning", "off axis", "limited", "coarse"],
)
def test_an_arm_that_a_map_does_not_fit_goes_through_ik(
    folder: Path, cube: str, form: dict[str, Any], error: dict[str, Any], says: str
):
    """With a warning where a map was asked for, without one where the default was."""
    asset = crane_mjcf(folder, f"odd_{'_'.join([*form, *error])}", **form)
    if error:
        crane_map(asset, **error)
    with pytest.warns(ReachWarning, match=f"objects.thing.reachable: .*{says}.*, so 'ik' decides"):
        assert reaching(crane_scene(asset, cube)).targets[0].tier == Tier.IK
    with warnings.catch_warnings():
        warnings.simplefilter("error", ReachWarning)
        assert reaching(crane_scene(asset, cube, reachable=True)).targets[0].tier == Tier.IK
        assert reaching(crane_scene(asset, cube, reachable="clear")).targets[0].tier == Tier.CLEAR


@pytest.mark.parametrize("false_accepts", [None, 0.0, 0.005])
def test_a_map_that_is_right_often_enough_decides(folder: Path, cube: str, false_accepts: float | None):
    """So does one from before this was measured; nothing is said about it."""
    asset = crane_mjcf(folder, f"right_{false_accepts}")
    crane_map(asset, false_accepts=false_accepts)
    with warnings.catch_warnings():
        warnings.simplefilter("error", ReachWarning)
        for word in ("map", True):
            assert reaching(crane_scene(asset, cube, reachable=word)).targets[0].tier == Tier.MAP


def test_more_corners_than_a_polygon_has_room_for_are_refused(folder: Path):
    """With how many there would be."""
    box = {"asset": str(folder / "box.xml"), "on": "floor", "kind": "fixture"}
    posts = {f"post_{i}": box for i in range(6)}
    relations = [{"between": list(posts), "width": 0.1}] * 4
    with pytest.raises(
        SceneKeyError, match=rf"objects\.thing\.relations: .* with 27 corners, .* at most {MAX_CORNERS}"
    ):
        checked(scene_of({**posts, "thing": {**box, "relations": relations}}))


def test_what_does_not_know_its_turn_cannot_be_beside(folder: Path):
    """`face_to` needs to know where it is first; the message names the relations."""
    box = {"asset": str(folder / "box.xml"), "on": "floor"}
    words = {"orientation": {"face_to": "post"}, "relations": [{"beside": "post", "side": "left"}]}
    with pytest.raises(SceneKeyError, match=r"objects\.thing\.relations: 'beside' needs the object.* 'face_to'"):
        checked(scene_of({"post": {**box, "kind": "fixture"}, "thing": {**box, **words}}))


def test_what_has_no_bounds_needs_a_width(folder: Path):
    """A marker that touches nothing, between two posts; the message names the width that is missing."""
    box = {"asset": str(folder / "box.xml"), "on": "floor", "kind": "fixture"}
    mark: dict[str, Any] = {**box, "kind": "marker", "relations": [{"between": ["a", "b"]}]}
    with pytest.raises(SceneKeyError, match=r"objects\.mark\.relations\.0\.width: 'mark' has no geom"):
        checked(scene_of({"a": box, "b": box, "mark": mark}))
    assert pack(scene_of({"a": box, "b": box, "mark": mark}, geometry="visual"))["rel_width"].tolist() == [-1.0]
    mark["relations"] = [{"between": ["a", "b"], "width": 0.1}]
    assert pack(scene_of({"a": box, "b": box, "mark": mark}))["rel_width"].tolist() == [0.1]


@pytest.fixture
def objects(tmp_path: Path) -> dict[str, Any]:
    """A brick on a rack that stays where it is."""
    brick = {"asset": box_mjcf(tmp_path, "brick", 0.16, 0.1, 0.03), "on": "rack"}
    return {"rack": {"asset": write_mjcf(tmp_path, "rack", RACK), "kind": "static"}, "brick": brick}


def _check_relations(objects: dict[str, Any], **words: Any) -> None:
    checked(scene_of({**objects, "brick": {**objects["brick"], **words}}))


def test_a_region_that_is_cut_too_finely_is_refused(objects: dict[str, Any]):
    """Four thin rings; the message says how many pieces there were, and how many there may be."""
    with pytest.raises(SceneKeyError, match=rf"objects\.brick\.relations: .*into \d+ pieces, .* at most {MAX_PIECES}"):
        _check_relations(objects, relations=[RING] * 4)
    _check_relations(objects, relations=[RING])


def test_points_are_counted_once_however_finely_relations_cut(objects: dict[str, Any], monkeypatch: pytest.MonkeyPatch):
    """On each surface that holds them; with relations there is room for so many, and the message has a remedy."""
    monkeypatch.setattr("sceniris_gym.program.checks.objects.MAX_PIECES", 3)
    points = [[0.0, 0.4], [0.0, -0.4], [1.0, 0.1], [1.0, 0.0]]
    _check_relations(objects, region={"points": points})
    _check_relations(objects, region={"points": points[:3]}, relations=[RING])
    with pytest.raises(SceneKeyError, match=r"objects\.brick\.region: its 4 points .* at most 3\. Use fewer points"):
        _check_relations(objects, region={"points": points}, relations=[RING])
