"""Supports that lean, that have no cover or that never end are refused, each with what would be right."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.errors import NotSupportedError, SceneKeyError, ScenirisError
from tests.program.scenes import checked, scene_of

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
        r"crate\.on: the plane 'ground' is endless\. Say where .* as in objects\.crate\.region: {box: \[\[-0\.3",
    ),
    "a share of it": (
        {"on": "ground", "region": {"fraction": [[0, 0], [1, 1]]}},
        SceneKeyError,
        "the plane 'ground' is endless",
    ),
    "inside the floor": (
        {"inside": "floor"},
        SceneKeyError,
        r"crate\.inside: nothing covers the floor\. Write 'on: floor'",
    ),
}


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
