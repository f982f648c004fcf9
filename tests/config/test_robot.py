"""The words of a robot: where it comes from, where its tool centre point is, how it stands; and those of starts."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.robot import RobotConfig, TcpConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError
from tests.layout.starting import HELD, LIFTED, SCENE, STANDING

REACHED = {"asset": "can", "on": "floor", "reachable": True}


def scene(robot: dict[str, Any], **words: Any) -> SceneConfig:
    """Return a scene of a floor and a robot."""
    return SceneConfig.load({"floor": {"size": [1, 1]}, "robot": robot, "objects": {}, **words})


def test_a_name_alone_is_a_site_or_a_body():
    """The short form and the long one are the same words, and the same scene."""
    short, long = RobotConfig.model_validate({"asset": "arm.xml", "tcp": "hand"}), {"site": "hand", "body": "hand"}
    assert short.tcp == TcpConfig.model_validate(long)
    assert short.name == "arm"
    assert short.key == "robot.asset"
    assert scene({"asset": "a.xml", "tcp": "hand"}).canonical() == scene({"asset": "a.xml", "tcp": long}).canonical()


def test_names_of_files_are_not_in_the_canonical_form():
    """The names of asset and map are left out. The pose of the robot counts."""
    words = [scene({"asset": f"{x}/arm.xml", "map": f"{x}/arm.reach"}).canonical() for x in "ab"]
    assert words[0] == words[1]
    turned = [scene({"asset": "arm.xml", turn: 90.0}).canonical() for turn in ("roll", "pitch", "yaw")]
    assert len({*turned, words[0]}) == 4


def test_paths_are_relative_to_the_file_that_names_them(tmp_path: Path):
    """The paths of a robot's asset and of its map."""
    (tmp_path / "scene.yaml").write_text("robot: {asset: arms/a.urdf, map: arms/a.reach}\nobjects: {}\n")
    robot = SceneConfig.load(tmp_path / "scene.yaml").robot
    assert robot is not None
    assert (robot.asset, robot.map) == (str(tmp_path / "arms/a.urdf"), str(tmp_path / "arms/a.reach"))


def test_a_robot_of_one_kind_replaces_one_of_another():
    """With overrides as with a base scene: only one of the words may be given."""
    robot = SceneConfig.load(scene({"asset": "panda"}), {"model": "a.xml", "robot.in_model": "arm"}).robot
    assert robot is not None
    assert (robot.asset, robot.in_model) == (None, "arm")


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "two sources": ({"asset": "panda", "in_model": "a"}, "exactly one of asset, in_model, but has asset and in_model"),
    "a base in the model": ({"in_model": "panda", "base": [0, 0, 1]}, "have no 'base': a robot 'in_model' keeps"),
    "no model to be in": ({"in_model": "panda"}, "have a 'model', because a robot is 'in_model'"),
    "a TCP nowhere": ({"asset": "panda", "tcp": {"offset": [0, 0, 0.1]}}, "robot.tcp: .* the 'site' or the 'body'"),
    "an unknown word": ({"asset": "panda", "tcp": {"bodi": "hand"}}, "robot.tcp.bodi: unknown key. Did you mean"),
    "a clearance below 0": ({"asset": "panda", "clearance": -0.1}, "robot.clearance"),
    "drawn nowhere": ({"asset": "panda", "gap": 0.1}, r"should have a support \(on, inside, in\) or a 3D region if"),
    "drawn and fixed": ({"asset": "panda", "on": "floor", "yaw": 90.0}, "have no 'yaw': resets draw its base"),
    "on something unknown": ({"asset": "panda", "on": "shelf"}, "robot.on: unknown support 'shelf'"),
    "words that exclude each other": ({"asset": "panda", "on": "floor", "in": "floor"}, "should have only one of on"),
    "not there and in the model": ({"in_model": "panda", "in_scene": False}, "should be an 'asset' without"),
}


@pytest.mark.parametrize(("robot", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_robot_is_refused(robot: dict[str, Any], says: str):
    """By its key, with what would be right."""
    with pytest.raises((SceneKeyError, UnknownNameError), match=says):
        scene(robot)


PANDA = {"asset": "panda"}
WRONG_TOGETHER: dict[str, tuple[dict[str, Any], str]] = {
    "both forms": ({"robot": PANDA, "robots": {"left": PANDA}}, "a single 'robot', or 'robots' by name"),
    "a robot and an object": (
        {"robots": {"can": PANDA}, "objects": {"can": {"asset": "can"}}},
        "both have a 'can'",
    ),
    "one body twice": (
        {"model": "a.xml", "robots": {"a": {"in_model": "arm"}, "b": {"in_model": "arm"}}},
        "'a' and 'b' share 'arm'",
    ),
    "a reserved name": ({"robots": {"floor": PANDA}}, "these names are reserved"),
    "a wrong word": ({"robots": {"left": {**PANDA, "clearance": -1.0}}}, r"robots\.left\.clearance"),
    "nobody": ({"robots": {"a": PANDA, "b": PANDA}, "objects": {"can": REACHED}}, "as in 'reachable: {by: a}'"),
    "another": (
        {"robots": {"left": PANDA}, "objects": {"can": {**REACHED, "by": "lefd"}}},
        r"objects\.can\.by: unknown robot 'lefd'. Did you mean 'left'",
    ),
}


@pytest.mark.parametrize(("words", "says"), WRONG_TOGETHER.values(), ids=WRONG_TOGETHER.keys())
def test_robots_that_do_not_go_together_are_refused(words: dict[str, Any], says: str):
    """Two of one name, two forms, and objects that do not say which robot is to reach them."""
    with pytest.raises((SceneKeyError, UnknownNameError), match=says):
        SceneConfig.load({"floor": {"size": [1, 1]}, "objects": {}, **words})


def test_robots_have_the_names_that_the_scene_gives_them(tmp_path: Path):
    """And paths, overrides and the canonical form as one robot has; the only one need not be named by objects."""
    (tmp_path / "scene.yaml").write_text("robots: {left: {asset: arms/a.urdf, map: arms/a.reach}}\nobjects: {}\n")
    config = SceneConfig.load(tmp_path / "scene.yaml", {"robots.left.base": [0, 0, 1]})
    robot = config.robots["left"]
    assert (robot.name, robot.key, config.key("left")) == ("left", "robots.left.asset", "robots.left")
    assert (robot.asset, robot.base) == (str(tmp_path / "arms/a.urdf"), (0.0, 0.0, 1.0))
    assert "arms" not in config.canonical()
    with pytest.raises(UnknownNameError, match="unknown robot 'right'"):
        SceneConfig.load(config, {"robots.right.base": [0, 0, 1]})
    alone = SceneConfig.load({"floor": {"size": [1, 1]}, "robots": {"left": PANDA}, "objects": {"can": REACHED}})
    assert alone.robot_for("can") == "left"


def test_a_drawn_base_is_placed_before_what_it_reaches_unless_it_refers_to_that():
    """Also where it refers to it by way of another object."""
    objects = {"can": REACHED, "mug": {"asset": "mug", "on": "floor", "relations": [{"front_of": "can"}]}}
    for near, needs in ((None, ("robot",)), ("mug", ())):
        words = {} if near is None else {"relations": [{"near": near, "distance": {"max": 0.5}}]}
        config = scene({**PANDA, "on": "floor", **words}, objects=objects)
        assert config.needs("can") == needs
    assert list(config.parts) == ["can", "mug", "robot"]


def test_kinds_are_read_in_their_order():
    """Their place in the list is their number."""
    kinds = SceneConfig.load(SCENE).start
    assert [kind.robot for kind in kinds] == ["home", "pregrasp", *["grasp"] * 3, "home", "grasp"]
    assert [kind.is_held for kind in kinds] == [i in (LIFTED, HELD) for i in range(len(kinds))]
    assert kinds[STANDING].targets({}) == ("block",)
    assert kinds[0].weight == 3.0


def test_the_word_counts_in_the_hash_only_where_it_is_written():
    """So that scenes without it keep theirs."""
    without = {key: value for key, value in SCENE.items() if key != "start"}
    assert "start" not in SceneConfig.load(without).canonical()
    assert "start" in SceneConfig.load(SCENE).canonical()


def test_a_target_with_variants_stands_for_all_of_them():
    """One of which is there in every world."""
    target = {"variants": {"block": {"asset": "block"}, "can": {"asset": "can"}}, "on": "floor", "reachable": "clear"}
    scene = {"floor": {"size": [1, 1]}, "robot": {"asset": "panda"}, "objects": {"target": target}}
    config = SceneConfig.load({**scene, "start": [{"robot": "grasp", "of": "target", "lift": [0.0, 0.1]}]})
    assert config.start[0].targets(config.variants) == ("target/block", "target/can")
    with pytest.raises(UnknownNameError, match=r"start\.0\.of: unknown object 'target/can'\. Did you mean 'target'"):
        SceneConfig.load({**scene, "start": [{"robot": "grasp", "of": "target/can"}]})
    with pytest.raises(SceneKeyError, match=r"start\.0\.joints: 'target' has variants"):
        SceneConfig.load({**scene, "start": [{"joints": {"target/lid": {"noise": 0.1}}}]})


GRASP = {"robot": "grasp", "of": "block"}
WRONG_START: dict[str, tuple[dict[str, Any], type[ScenirisError], str]] = {
    "an unknown pose": ({"robot": "graps", "of": "block"}, SceneKeyError, "start.0.robot"),
    "nothing to grasp": ({"robot": "grasp"}, SceneKeyError, "and no 'of' if"),
    "home of something": ({"of": "block"}, SceneKeyError, "and no 'of' if"),
    "a weight of 0": ({"weight": 0}, SceneKeyError, "start.0.weight"),
    "a lift upside down": (GRASP | {"lift": [0.2, 0.1]}, SceneKeyError, "low <= high"),
    "a lift by nothing": (GRASP | {"lift": [0, 0]}, SceneKeyError, "high above 0"),
    "a lift without a grasp": ({"robot": "pregrasp", "of": "block", "lift": [0, 0.1]}, SceneKeyError, "only if"),
    "a lift and joints": (GRASP | {"lift": [0, 0.1], "robot_joints": {"*": {"noise": 0.1}}}, SceneKeyError, "not both"),
    "a choice": (GRASP | {"robot_joints": {"*": {"choice": [0.1]}}}, SceneKeyError, "should draw a joint by"),
    "a norm": ({"joints": {"cabinet/upper": {"noise_norm": 0.1}}}, SceneKeyError, "should draw a joint by"),
    "an unknown object": (GRASP | {"of": "blok"}, UnknownNameError, "start.0.of"),
    "one that is out of reach": (GRASP | {"of": "apple"}, SceneKeyError, "'apple' needs the key 'reachable'"),
    "a lifted fixture": (GRASP | {"of": "cabinet", "lift": [0, 0.1]}, SceneKeyError, "'cabinet' is not a free object"),
    "no marker": ({"place": {"apple": "block"}}, UnknownNameError, "Valid: goal"),
    "another support": ({"place": {"cabinet": "goal"}}, SceneKeyError, ""),
    "no joint": ({"joints": {"cabinet": {"noise": 0.1}}}, SceneKeyError, "'object/joint'"),
    "a joint of nothing": ({"joints": {"cabinets/upper": {"noise": 0.1}}}, UnknownNameError, "start.0.joints"),
}


@pytest.mark.parametrize(("kind", "error", "says"), WRONG_START.values(), ids=WRONG_START.keys())
def test_a_wrong_kind_is_refused_with_its_number_and_advice(kind: dict, error: type[ScenirisError], says: str):
    """By the path of its key."""
    scene: dict[str, Any] = deepcopy(SCENE) | {"start": [kind]}
    scene["objects"]["goal"]["on"] = "cabinet/upper_drawer" if "cabinet" in kind.get("place", {}) else "floor"
    with pytest.raises(error) as caught:
        SceneConfig.load(scene)
    assert says in str(caught.value)
    assert "start.0" in str(caught.value)


def test_a_thing_that_carries_another_one_cannot_be_lifted():
    """It would leave the other one in the air."""
    scene: dict[str, Any] = deepcopy(SCENE) | {"start": [GRASP | {"lift": [0.0, 0.1]}]}
    scene["objects"]["apple"] = {"asset": "apple", "on": "block"}
    with pytest.raises(SceneKeyError, match="'apple' stands on 'block'"):
        SceneConfig.load(scene)
