"""Broken equalities are counted: joints that should follow others, by hand."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.audit.equalities import equalities
from sceniris_gym.scene.layout_table import LayoutTable

PAIR = """<mujoco><worldbody>
  <body><joint name="a" type="slide"/><geom size=".1"/></body>
  <body pos="1 0 0"><joint name="b" type="slide"/><geom size=".1"/></body>
</worldbody><equality><joint name="mirror" joint1="b" joint2="a" polycoef="0 -1"/>{}</equality></mujoco>"""


def _table(qpos: list) -> LayoutTable:
    n = len(qpos)
    return LayoutTable.from_states(np.array(qpos), np.zeros((n, 0, 3)), np.zeros((n, 0, 4)), np.ones((n, 0), bool))


def test_layouts_that_break_an_equality_are_counted_and_the_worst_is_named():
    """Rounding does not count, and neither does an inactive equality."""
    mjm = mujoco.MjModel.from_xml_string(PAIR.format('<joint name="off" joint1="a" active="false"/>'))
    found = equalities(mjm, _table([[0.1, -0.1], [0.1, -0.10001], [0.1, 0.05], [0.2, -0.21]]))
    assert found.broken == 2
    assert found.worst == pytest.approx(0.15)
    assert found.name == "mirror"
    kept = equalities(mjm, _table([[0.25, -0.25]]))
    assert (kept.broken, kept.worst, kept.name) == (0, 0.0, "")


def test_a_model_without_equalities_has_none_to_break():
    """Nothing is looked at."""
    mjm = mujoco.MjModel.from_xml_string(PAIR.format("").split("<equality>")[0] + "</mujoco>")
    assert equalities(mjm, _table([[0.1, 0.5]])).broken == 0
