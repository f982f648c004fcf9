"""The words of a robot: where it comes from, where its tool centre point is, how it stands."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.robot import RobotConfig, TcpConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError


def scene(robot: dict[str, Any], **words: Any) -> SceneConfig:
    """Return a scene of a floor and a robot."""
    return SceneConfig.load({"floor": {"size": [1, 1]}, "robot": robot, "objects": {}, **words})


def test_a_name_alone_is_a_site_or_a_body():
    """The short form and the long one are the same words, and the same scene."""
    short, long = RobotConfig.model_validate({"model": "arm.xml", "tcp": "hand"}), {"site": "hand", "body": "hand"}
    assert short.tcp == TcpConfig.model_validate(long)
    assert short.name == "arm"
    assert short.key == "robot.model"
    assert scene({"model": "a.xml", "tcp": "hand"}).canonical() == scene({"model": "a.xml", "tcp": long}).canonical()


def test_names_of_files_are_not_in_the_canonical_form():
    """Of model and map alike; where the robot stands is."""
    words = [scene({"model": f"{x}/arm.xml", "map": f"{x}/arm.reach"}).canonical() for x in "ab"]
    assert words[0] == words[1]
    turned = [scene({"model": "arm.xml", turn: 90.0}).canonical() for turn in ("roll", "pitch", "yaw")]
    assert len({*turned, words[0]}) == 4


def test_paths_are_relative_to_the_file_that_names_them(tmp_path: Path):
    """Of a robot's model and of its map."""
    (tmp_path / "scene.yaml").write_text("robot: {model: arms/a.urdf, map: arms/a.reach}\nobjects: {}\n")
    robot = SceneConfig.load(tmp_path / "scene.yaml").robot
    assert robot is not None
    assert (robot.model, robot.map) == (str(tmp_path / "arms/a.urdf"), str(tmp_path / "arms/a.reach"))


def test_a_robot_of_one_kind_replaces_one_of_another():
    """With overrides as with a base scene: only one of the words may be given."""
    robot = SceneConfig.load(scene({"asset": "panda"}), {"robot.model": "arm.xml"}).robot
    assert robot is not None
    assert (robot.asset, robot.model) == (None, "arm.xml")


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "two sources": ({"asset": "panda", "model": "a.xml"}, "exactly one of asset, model, in_model, but has asset and"),
    "a base in the model": ({"in_model": "panda", "base": [0, 0, 1]}, "have no 'base': a robot that is in the model"),
    "no model to be in": ({"in_model": "panda"}, "'in_model' only together with 'model'"),
    "a TCP nowhere": ({"asset": "panda", "tcp": {"offset": [0, 0, 0.1]}}, "robot.tcp: .* the 'site' or the 'body'"),
    "an unknown word": ({"asset": "panda", "tcp": {"bodi": "hand"}}, "robot.tcp.bodi: unknown key. Did you mean"),
    "a clearance below 0": ({"asset": "panda", "clearance": -0.1}, "robot.clearance"),
}


@pytest.mark.parametrize(("robot", "says"), WRONG.values(), ids=WRONG.keys())
def test_a_wrong_robot_is_refused(robot: dict[str, Any], says: str):
    """By its key, with what would be right."""
    with pytest.raises(SceneKeyError, match=says):
        scene(robot)
