"""Draws that joints cannot follow are refused: beyond their limits, or in another object."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.errors import NotSupportedError, SceneKeyError
from tests.program.scenes import checked, scene_of
from tests.program.test_couplings import TIE
from tests.scene.test_couplings import placed


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
        NotSupportedError, match=r"objects.b.joints: joint 'b' is drawn.*joint 'a' follow.*not part of 'b'"
    ):
        checked(scene_of(objects, model=str(tmp_path / "own.xml")))
