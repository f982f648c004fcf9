"""Positions of joined sites from the pivots, in numbers worked out by hand, and sites that join nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.config.relations import Joined
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.program.pack.joining import joined_sites
from tests.program.scenes import Packed, pack, scene_of

BLOCK = """
<mujoco><worldbody><body name="block"><geom type="box" size=".2 .1 .1" pos=".3 0 .1"/>
  <site name="front" pos=".3 -.1 .1" euler="0 0 -90"/><site name="up" euler="0 -90 0"/>
  <body name="lid" pos="0 0 .3"><joint name="hinge" axis="0 1 0" range="0 90"/><geom size=".02"/>
    <site name="knob"/></body>
</body></worldbody></mujoco>"""


def blocks(folder: Path, beside: dict[str, Any], gap: float = 0.0, **other: Any) -> Packed:
    """Two blocks, the second one joined to the first."""
    (folder / "block.xml").write_text(BLOCK)
    words = {"asset": str(folder / "block.xml"), "on": "floor"}
    relation = {"beside": {"of": "a", **beside}} | ({"gap": gap} if gap else {})
    return pack(scene_of({"a": {**words, **other}, "b": {**words, "relations": [relation]}}))


def test_sites_are_measured_from_pivots_at_heading_zero(tmp_path: Path):
    """The pivot is below the middle of the box, 30 cm beside the root, and the lid does not move it."""
    packed = blocks(tmp_path, {"my": "front", "its": "front"}, gap=0.05)
    relation = packed.scene.config.objects["b"].relations[0]
    assert isinstance(relation, Joined)
    found = joined_sites(packed.plan, "b", relation, "here")
    pivot = packed.object("a").variants[0].pivot
    assert found.to == "a"
    assert found.own == pytest.approx([0.3 - pivot[0], -0.1 - pivot[1]])
    assert found.at == pytest.approx(found.own + [0.0, -0.05])
    assert abs(found.turn) == pytest.approx(np.pi)
    i = packed.number("b")
    assert packed["obj_yaw"][i] == pytest.approx([found.turn] * 2)
    assert packed["obj_beside"].tolist() == [-1, packed.plan.slots.index("a")]
    assert packed["rel_sites"][0] == pytest.approx([*found.at, *found.own])


WRONG: dict[str, tuple[dict, dict, type[ScenirisError], str]] = {
    "an unknown site of its own": (
        {"my": "frnt", "its": "front"}, {}, UnknownNameError,
        r"b\.relations\.0\.beside\.my: unknown site of 'b' 'frnt'\. Did you mean 'front'\? Valid: front, knob, up",
    ),
    "an unknown site of the other": (
        {"my": "front", "its": "bottom"}, {}, UnknownNameError,
        r"beside\.its: unknown site of 'a' 'bottom'\..* Valid: front",
    ),
    "one on a lid": ({"my": "knob", "its": "front"}, {}, SceneKeyError, "'knob' is on 'b/lid', which joints move"),
    "one that points up": ({"my": "up", "its": "front"}, {}, SceneKeyError, "the x axis of 'up' is vertical"),
    "of what may lie": (
        {"my": "front", "its": "front"}, {"orientation": "any"}, SceneKeyError, "'a' has the orientation 'any'",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("beside", "other", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_sites_that_join_nothing_are_refused(tmp_path: Path, beside: dict, other: dict, error: type, says: str):
    """With the key, and the sites that there are."""
    with pytest.raises(error, match=says):
        blocks(tmp_path, beside, **other)


def test_words_that_name_no_sites_keep_their_hash():
    """`beside: NAME` is written as it was before sites could be named."""
    objects: dict[str, Any] = {"a": {"asset": "mug", "on": "floor"}}
    objects["b"] = {**objects["a"], "relations": [{"beside": "a", "side": "left"}]}
    assert '"beside":"a"' in SceneConfig.load({"floor": {"size": [1, 1]}, "objects": objects}).canonical()
