"""Rows that were settled with other shapes are refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import HeapError
from sceniris_gym.scene.build import build_model
from tests.program.scenes import checked
from tests.scene.heaping import folder, words


def test_rows_of_other_shapes_are_refused(tmp_path: Path):
    """One of the blocks is thicker now; as they were settled they are fine."""
    checked(build_model(SceneConfig.load(words(folder()))))
    (tmp_path / "block.xml").write_text(
        '<mujoco><worldbody><body><geom type="box" size=".03 .02 .016"/></body></worldbody></mujoco>'
    )
    changed = {"objects.b.asset": str(tmp_path / "block.xml")}
    with pytest.raises(HeapError, match="was settled with other shapes or masses"):
        checked(build_model(SceneConfig.load(words(folder()), changed)))
