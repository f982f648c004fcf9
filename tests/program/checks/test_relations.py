"""Relations that cannot hold together, or that are too many for the device, are refused by their key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.limits import MAX_CORNERS
from sceniris_gym.errors import SceneKeyError
from tests.program.scenes import checked, pack, scene_of


def test_more_corners_than_a_polygon_has_room_for_are_refused(folder: Path):
    """With how many there would be."""
    box = {"asset": str(folder / "box.xml"), "on": "floor", "kind": "fixture"}
    posts = {f"post_{i}": box for i in range(6)}
    relations = [{"between": list(posts), "width": 0.1}] * 4
    with pytest.raises(SceneKeyError, match=rf"objects\.thing\.relations: .* of 27 corners, .*room for {MAX_CORNERS}"):
        checked(scene_of({**posts, "thing": {**box, "relations": relations}}))


def test_what_does_not_know_its_turn_cannot_be_beside(folder: Path):
    """`face_to` needs to know where it is first; the message names the relations."""
    box = {"asset": str(folder / "box.xml"), "on": "floor"}
    words = {"orientation": {"face_to": "post"}, "relations": [{"beside": "post", "side": "left"}]}
    with pytest.raises(SceneKeyError, match=r"objects\.thing\.relations: 'beside' depends on how .* 'face_to'"):
        checked(scene_of({"post": {**box, "kind": "fixture"}, "thing": {**box, **words}}))


def test_what_has_no_bounds_needs_a_width(folder: Path):
    """A marker that touches nothing, between two posts; the message names the width that is missing."""
    box = {"asset": str(folder / "box.xml"), "on": "floor", "kind": "fixture"}
    mark: dict[str, Any] = {**box, "kind": "marker", "relations": [{"between": ["a", "b"]}]}
    with pytest.raises(SceneKeyError, match=r"objects\.mark\.relations\.0\.width: is missing\. 'mark' has nothing"):
        checked(scene_of({"a": box, "b": box, "mark": mark}))
    assert pack(scene_of({"a": box, "b": box, "mark": mark}, geometry="visual"))["rel_width"].tolist() == [-1.0]
    mark["relations"] = [{"between": ["a", "b"], "width": 0.1}]
    assert pack(scene_of({"a": box, "b": box, "mark": mark}))["rel_width"].tolist() == [0.1]
