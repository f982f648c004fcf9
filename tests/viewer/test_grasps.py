"""The layer of grasps: where they are, and the arm in them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.layout.reading import grasp_poses
from sceniris_gym.viewer.shown import GRASP, PREGRASP, START, grasp_pose, poses_of_arm, sketch_grasps, with_arm
from tests.viewer.worlds_on_show import world_of

SCENE = "tabletop_lift"


def test_grasps_are_those_of_the_layout():
    """The same poses as in tables of layouts, for each reach target; an arrow along the approach leads to each."""
    world = world_of(SCENE, 3)
    wanted = grasp_poses(world.compiled, world.table, world.table.grasp)[0]
    for k, pose in enumerate(wanted):
        found = grasp_pose(world, k)
        assert found is not None
        assert np.concatenate(found) == pytest.approx(pose, abs=1e-5)
    sketch = sketch_grasps(world)
    assert len(sketch.arrows) == len(sketch.axes) == len(wanted) == 3
    assert [arrow[1] for arrow, _ in sketch.arrows] == pytest.approx(wanted[:, :3], abs=1e-5)


def test_the_arm_jumps_into_every_pose():
    """Its TCP is in the grasp, or 8 cm before it; nothing else of the layout moves but the fingers."""
    world = world_of(SCENE)
    poses = poses_of_arm(world)
    assert poses[0] == START
    assert len(poses) == 7
    assert with_arm(world, START) is world.table
    reaching = world.compiled.reaching
    assert reaching is not None
    for k, name in enumerate(reaching.names):
        pos, quat = grasp_pose(world, k) or (np.zeros(3), np.zeros(4))
        axis = np.zeros(3)
        mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, 1.0]), quat)
        for step, back in ((GRASP, 0.0), (PREGRASP, 0.08)):
            table = with_arm(world, f"{step} of {name}")
            assert table is not None
            moved = type(world)(world.compiled, table)
            assert moved.data.site_xpos[reaching.arms[0].arm.tcp_site] == pytest.approx(pos - back * axis, abs=2e-3)
            there, here = sketch_grasps(moved).labels, sketch_grasps(world).labels
            assert [text for text, _ in there] == [text for text, _ in here]
            body = world.compiled.scene.bodies[name]
            assert moved.data.xpos[body] == pytest.approx(world.data.xpos[body])


def test_a_scene_without_reach_targets_has_none():
    """Nothing to draw, and the arm stays."""
    world = world_of("mid")
    assert poses_of_arm(world) == [START]
    assert sketch_grasps(world).arrows == []
    assert with_arm(world, "grasp of apple") is world.table
