"""Notes about an arm's reach: shares of objects within reach, and the approach axis of the hand that reaches most."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from sceniris_gym.commands.approach import reach_notes
from sceniris_gym.commands.init import init
from sceniris_gym.layout.compile import compile_scene
from tests.importers.models.models import FINGERS, arm


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_a_wrong_approach_axis_is_told_with_a_better_one(tmp_path: Path):
    """Most of the board is nearer than the 0.3 m from shoulder to wrist, and the hand has to point down to it."""
    cube = '<body name="cube" pos="0.1 0 0"><freejoint/><geom type="box" size="0.01 0.01 0.01"/></body>'
    board = f'<worldbody><geom name="board" type="box" size="0.2 0.2 0.1" pos="0 0 -0.13"/>{cube}'
    mjcf = arm('<site name="pinch" pos="0 0 0.07"/>' + FINGERS).replace("<worldbody>", board)
    (tmp_path / "arm.xml").write_text(mjcf)
    scene = init(tmp_path / "arm.xml", "cpu")
    assert scene.robot is not None
    share = re.fullmatch(r"(\d+)% of the objects are within reach from above\.", scene.robot.notes[-1])
    assert share is not None
    assert int(share[1]) > 80
    tcp = {"site": "pinch", "roll": 90}
    wrong = compile_scene({**scene.words(), "robot": {"in_model": "base", "tcp": tcp}}, "cpu", overrides={"bank": 8})
    found = re.fullmatch(rf"(\d+)% .*, but {share[1]}% with `tcp: {{site: pinch}}`\.", reach_notes(wrong, ["cube"])[-1])
    assert found is not None
    assert int(found[1]) < 20
