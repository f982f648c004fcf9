"""Claims of reach: one for each target, with the columns of its table."""

from __future__ import annotations

import numpy as np

from sceniris_gym import LayoutGenerator, compile_scene
from sceniris_gym.layout.claims import judge_reach, reach_claims


def test_claims_have_the_grasps_of_the_table():
    """They hold in layouts as they were made, and not if the arm's joints are others."""
    compiled = compile_scene("drawer_pick", "cpu")
    generator = LayoutGenerator(compiled, 2)
    generator.generate()
    table = generator.table()
    (claim,) = reach_claims(compiled, table)
    assert (claim.name, claim.robot, claim.tier.word) == ("banana", "robot", "clear")
    np.testing.assert_array_equal(claim.pose, table.grasp_pose[:, 0])
    assert judge_reach(compiled, table, [claim]) == []
    table.grasp_qpos[1] += 0.1
    assert [found.row for found in judge_reach(compiled, table, reach_claims(compiled, table))] == [1]
    assert reach_claims(compile_scene("table_top", "cpu"), table) == []
