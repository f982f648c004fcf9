"""Bounds of motions against MuJoCo C."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.program.pack.moves import moves_of
from sceniris_gym.program.reach import robot_arm
from sceniris_gym.scene.build import build_model


@pytest.mark.parametrize("asset", ["panda", "ur5e", "heron"])
def test_a_bound_of_a_motion_holds(asset: str):
    """For corners of the geoms' boxes in MuJoCo C, when joints move by little from random positions."""
    scene = build_model(SceneConfig.load({"floor": {"size": [2, 2]}, "robot": {"asset": asset}}))
    arm, mjm, data = robot_arm(scene), scene.mjm, mujoco.MjData(scene.mjm)
    bounds, rng = moves_of(scene, "robot", arm), np.random.default_rng(0)
    geoms = np.flatnonzero(np.isin(mjm.geom_bodyid, scene.moving("robot")))
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    tightest = np.inf
    for _ in range(60):
        start = rng.uniform(arm.lower, arm.upper)
        change = rng.normal(0.0, 1e-3, len(arm.joints))
        points = []
        for joints in (start, start + change):
            data.qpos[arm.qposadr] = joints
            mujoco.mj_kinematics(mjm, data)
            local = mjm.geom_aabb[geoms, None, :3] + corners * mjm.geom_aabb[geoms, None, 3:]
            mat = data.geom_xmat[geoms].reshape(-1, 3, 3)
            points.append(data.geom_xpos[geoms, None] + np.einsum("gij,gkj->gki", mat, local))
        moved = np.linalg.norm(points[1] - points[0], axis=2).max(axis=1)
        bound = bounds[mjm.geom_bodyid[geoms]] @ np.abs(change)
        assert (moved <= 1.001 * bound + 1e-9).all()
        tightest = min(tightest, (bound[moved > 0] / moved[moved > 0]).min())
    assert tightest < 3.0
