"""Names in a scene: its parts, their keys, and the objects that variants belong to."""

from __future__ import annotations

from sceniris_gym.config.scene import SceneConfig
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
