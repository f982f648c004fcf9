"""Regions of too many pieces are refused, with how many there are and how many there may be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.limits import MAX_PIECES
from sceniris_gym.errors import SceneKeyError
from tests.layout.scenes import box_mjcf, write_mjcf
from tests.program.scenes import checked, scene_of

RING = {"near": "rack", "distance": {"equal": 2.0, "tolerance": 1e-4}}
# Two boards, and a shelf that is higher.
RACK = "".join(
    f'<geom type="box" size="{x} {y} .01" pos="{px} {py} {z}"/>'
    for x, y, px, py, z in ((0.5, 0.1, 0, 0.4, 0.1), (0.5, 0.1, 0, -0.4, 0.1), (0.2, 0.2, 1.0, 0, 0.3))
)


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
    monkeypatch.setattr("sceniris_gym.program.checks.regions.MAX_PIECES", 3)
    points = [[0.0, 0.4], [0.0, -0.4], [1.0, 0.1], [1.0, 0.0]]
    _check(objects, region={"points": points})
    _check(objects, region={"points": points[:3]}, relations=[RING])
    with pytest.raises(SceneKeyError, match=r"objects\.brick\.region: has 4 points .*room for 3\. Use fewer points"):
        _check(objects, region={"points": points}, relations=[RING])
