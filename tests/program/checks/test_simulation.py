"""Refusal of solvers that MuJoCo-Warp lacks, with the scene's name."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.layout.compile import compile_scene

MODEL = """<mujoco><option solver="{}"/><worldbody><body name="floor"><geom type="box" size="1 1 .1"/></body>
  <body name="a" pos="0 0 .5"><freejoint/><geom type="box" size=".02 .02 .02"/></body></worldbody></mujoco>"""


def test_a_solver_that_mujoco_warp_lacks_is_refused_as_a_scene(tmp_path: Path):
    """By compile_scene with the scene's name, so not by the first environment; the others compile."""
    (tmp_path / "mine.yaml").write_text("{model: model.xml, bank: 1, objects: {a: {on: floor}}}")
    (tmp_path / "model.xml").write_text(MODEL.format("PGS"))
    with pytest.raises(NotSupportedError, match=r"mine\.yaml: MuJoCo-Warp has no solver PGS\. Use Newton or CG"):
        compile_scene(tmp_path / "mine.yaml", "cpu", cache=False)
    (tmp_path / "model.xml").write_text(MODEL.format("CG"))
    compile_scene(tmp_path / "mine.yaml", "cpu", cache=False)
