"""Relations that cannot hold together, and relations and regions too many for the device, are refused by their key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.limits import MAX_CORNERS, MAX_PIECES
from sceniris_gym.errors import SceneKeyError
from tests.layout.scenes import box_mjcf, write_mjcf
from tests.program.scenes import checked, pack, scene_of

RING = {"near": "rack", "distance": {"equal": 2.0, "tolerance": 1e-4}}
# Two boards, and a shelf that is higher.
RACK = "".join(
    f'<geom type="box" size="{x} {y} .01" pos="{px} {py} {z}"/>'
    for x, y, px, py, z in ((0.5, 0.1, 0, 0.4, 0.1), (0.5, 0.1, 0, -0.4, 0.1), (0.2, 0.2, 1.0, 0, 0.3))
)


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


@pytest.fixture
def objects(tmp_path: Path) -> dict[str, Any]:
    """A brick on a rack that stays where it is."""
    brick = {"asset": box_mjcf(tmp_path, "brick", 0.16, 0.1, 0.03), "on": "rack"}
    return {"rack": {"asset": write_mjcf(tmp_path, "rack", RACK), "kind": "static"}, "brick": brick}


def _check(objects: dict[str, Any], **words: Any) -> None:
    checked(scene_of({**objects, "brick": {**objects["brick"], **words}}))


def test_a_region_that_is_cut_too_finely_is_refused(objects: dict[str, Any]):
    """Four thin rings; the message says how many pieces there were, and how many there may be."""
    with pytest.raises(SceneKeyError, match=rf"objects\.brick\.relations: .*into \d+ pieces, .*room for {MAX_PIECES}"):
        _check(objects, relations=[RING] * 4)
    _check(objects, relations=[RING])


def test_points_are_counted_once_however_finely_relations_cut(objects: dict[str, Any], monkeypatch: pytest.MonkeyPatch):
    """On each surface that holds them; with relations there is room for so many, and the message has a remedy."""
    monkeypatch.setattr("sceniris_gym.program.checks.relations.MAX_PIECES", 3)
    points = [[0.0, 0.4], [0.0, -0.4], [1.0, 0.1], [1.0, 0.0]]
    _check(objects, region={"points": points})
    _check(objects, region={"points": points[:3]}, relations=[RING])
    with pytest.raises(SceneKeyError, match=r"objects\.brick\.region: has 4 points .*room for 3\. Use fewer points"):
        _check(objects, region={"points": points}, relations=[RING])
