"""Objects dropped onto their supports."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.program.dropping import STILL, drop, moved, only
from sceniris_gym.program.plan import build_plan
from tests.program.scenes import scene_of

BOXES = """<mujoco><worldbody><geom name="floor" type="plane" size="3 3 .1"/>
  <body name="crate" pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
  <body name="other" pos="0 0 .05"><freejoint/><geom type="box" size=".5 .5 .05"/></body></worldbody></mujoco>"""


def test_an_object_falls_onto_its_support_through_all_others():
    """By the height at which it was dropped, and without a turn."""
    scene = scene_of({"crate": {"on": "floor"}}, model=mujoco.MjSpec.from_string(BOXES))
    (o,) = build_plan(scene).objects
    before, after = drop(only(scene.mjm, o), scene, o, 0, 0.1 + STILL, {})
    assert before[2] == pytest.approx(0.1 + STILL)
    assert after[2] == pytest.approx(0.1, abs=1e-3)
    assert moved(before, after, np.array([0.1, 0.0, 0.0])) == pytest.approx(STILL, abs=1e-3)
