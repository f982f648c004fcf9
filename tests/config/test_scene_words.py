"""Names in a scene: its parts, their keys, and the objects that variants belong to; and words of cameras."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.scene_words import CameraConfig
from sceniris_gym.errors import SceneKeyError
from tests.config.scenes import TABLE

ARM = {"asset": "panda", "base": [0.0, -0.4, 0.0]}
DRAWN = {"asset": "panda", "on": "floor"}


def test_parts_have_the_keys_that_they_are_written_under():
    """Objects, and the robots whose base is drawn: the only robot, or one of several by its name."""
    alone = SceneConfig.load(TABLE, {"robot": DRAWN})
    assert list(alone.parts) == [*TABLE["objects"], "robot"]
    assert [alone.key(name) for name in ("apple", "robot")] == ["objects.apple", "robot"]
    several = SceneConfig.load(TABLE, {"robots": {"left": ARM, "right": DRAWN}})
    assert [*several.all_robots] == ["left", "right"]
    assert list(several.parts) == [*TABLE["objects"], "right"]
    assert several.key("right") == "robots.right"


def test_variants_belong_to_their_object():
    """The members of another group belong to nobody."""
    overrides = {
        "objects.thing": {"asset": ["can", "mug"], "on": "table"},
        "groups.some": {"of": ["can", "mug"], "count": 1},
    }
    config = SceneConfig.load(TABLE, overrides)
    assert config.owners == {"thing/can": "thing", "thing/mug": "thing"}
    assert config.variants == {"thing": ("thing/can", "thing/mug")}


def test_up_is_the_z_axis_unless_the_camera_looks_along_it():
    """Then it is x; a direction that is given is taken."""
    aside = CameraConfig(pos=(1, 0, 1), look_at=(0, 0, 0))
    assert aside.upward.tolist() == [0, 0, 1]
    assert aside.backward.tolist() == [1, 0, 1]
    assert CameraConfig(pos=(0, 0, 1), look_at=(0, 0, 0)).upward.tolist() == [1, 0, 0]
    assert CameraConfig(pos=(0, 0, 1), look_at=(0, 0, 0), up=(0, 1, 0)).upward.tolist() == [0, 1, 0]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"look_at": [0, 0, 0]}, r"cameras\.eye\.pos: is missing"),
        ({"pos": [0, 0, 1], "look_at": [0, 0, 1]}, r"cameras\.eye: .*'look_at' that differs"),
        ({"pos": [0, 0, 1], "look_at": [0, 0, 0], "up": [0, 0, 2]}, r"cameras\.eye: .*'up' that is not parallel"),
        ({"pos": [0, 0, 1], "look_at": [0, 0, 0], "fovy": 0}, r"cameras\.eye\.fovy: 0 should be from 1 to 179 degrees"),
        ({"pos": [0, 0, 1], "lookat": [0, 0, 0]}, r"Did you mean 'look_at'"),
    ],
)
def test_wrong_words_are_refused(words: dict[str, Any], message: str):
    """With the key and what would be right."""
    with pytest.raises(SceneKeyError, match=message):
        SceneConfig.load({"cameras": {"eye": words}})


def test_equal_scenes_with_other_cameras_have_the_same_canonical_text():
    """Cameras shape no layout; they are words that overrides change."""
    plain = SceneConfig.load({"floor": {"size": [1, 1]}})
    eye = {"pos": [1, 0, 1], "look_at": [0, 0, 0]}
    seen = SceneConfig.load({"floor": {"size": [1, 1]}, "cameras": {"eye": eye}}, {"cameras.eye.fovy": 60})
    assert seen.cameras["eye"].fovy == 60
    assert plain.canonical() == seen.canonical()
    np.testing.assert_allclose(seen.cameras["eye"].pos, eye["pos"])
