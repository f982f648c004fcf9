"""`LayoutGenerator.table`: rows on the host, with the poses of grasps."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.reading import grasp_poses
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene


def test_a_table_has_the_first_layouts(crane: CompiledScene):
    """As many as asked for, copied: the next reset leaves them as they are."""
    generator = LayoutGenerator(crane, 4, seed=3)
    generator.generate()
    table, two = generator.table(), generator.table(2)
    assert (len(table), len(two), table.seed.tolist()) == (4, 2, [3, 4, 5, 6])
    kept = table.qpos.copy()
    generator.generate()
    np.testing.assert_array_equal(table.qpos, kept)
    for wrong in (-1, 1.5):
        with pytest.raises(ArgumentError, match=r"LayoutGenerator\.table: nrow"):
            generator.table(wrong)  # pyrefly: ignore[bad-argument-type]


def test_a_tcp_is_where_the_grasp_is_on_the_object(crane: CompiledScene):
    """The object's pose times the grasp's, by SciPy; nan where there is none."""
    assert crane.reaching is not None
    (target,) = crane.reaching.targets
    table = make_table(crane, 8, 0)
    chosen = table.grasp.copy()
    chosen[3] = -1
    found = grasp_poses(crane, table, chosen)
    assert np.isnan(found[3]).all()
    adr = crane.mjm.jnt_qposadr[crane.mjm.joint("thing/free").id]
    for row in (0, 1, 2, 4, 5, 6, 7):
        grasp = target.grasp_set.grasps[chosen[row, 0]]
        assert grasp.body == mujoco.mj_name2id(crane.mjm, mujoco.mjtObj.mjOBJ_BODY, "thing")
        turn = Rotation.from_quat(np.roll(table.qpos[row, adr + 3 : adr + 7], -1))
        tcp = turn * Rotation.from_quat(np.roll(grasp.quat, -1))
        np.testing.assert_allclose(found[row, 0, :3], table.qpos[row, adr : adr + 3] + turn.apply(grasp.pos), atol=1e-6)
        np.testing.assert_allclose(
            Rotation.from_quat(np.roll(found[row, 0, 3:], -1)).as_matrix(), tcp.as_matrix(), atol=1e-6
        )
    np.testing.assert_array_equal(make_table(crane, 8, 0).grasp_pose[[0, 7]], found[[0, 7]])
