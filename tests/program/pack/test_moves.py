"""Bounds of motions against MuJoCo C."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.program.pack.moves import moves_of
from sceniris_gym.program.plan import build_plan
from sceniris_gym.scene.build import build_model
from tests.layout.scenes import write_mjcf


@pytest.mark.parametrize("asset", ["panda", "ur5e", "heron"])
def test_a_bound_of_a_motion_holds(asset: str):
    """For corners of the geoms' boxes in MuJoCo C, when joints move by little from random positions."""
    block = {"asset": "block", "on": "floor", "reachable": "ik"}
    plan = build_plan(build_model({"floor": {"size": [2, 2]}, "robot": {"asset": asset}, "objects": {"block": block}}))
    scene, arm = plan.scene, plan.reaching.arms[0].arm
    mjm, data = scene.mjm, mujoco.MjData(scene.mjm)
    bounds, rng = moves_of(plan, plan.reaching.arms[0]), np.random.default_rng(0)
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


@pytest.mark.parametrize("drawn", [False, True])
def test_a_slide_without_limits_carries_as_far_as_it_goes(tmp_path: Path, drawn: bool):
    """A finger that follows another one, and a drawn slide of a tool on it: both 0.3 m out, turned by the wrist."""
    geom = '<geom type="box" size=".01 .01 .02"/>'
    finger = '<body name="{0}"><joint name="{0}" type="slide" axis="0 {1} 0"{2}/>' + geom + "{3}</body>"
    tool = '<body name="tool"><joint name="tool" type="slide" axis="1 0 0"/><geom size=".01"/></body>'
    fingers = finger.format("left", 1, ' range="0 .3"', "") + finger.format("right", -1, "", tool)
    site = '<site name="tcp" pos="0 0 .02"/>'
    turn = f'<joint name="turn" axis="0 0 1" range="-1 1"/><geom size=".02"/>{site}{fingers}'
    couple = '<equality><joint joint1="right" joint2="left"/></equality>'
    file = write_mjcf(tmp_path, "arm", f'<geom size=".05"/><body name="hand" pos="0 0 .5">{turn}</body>', couple)
    joints = {"joints": {"tool": {"range": [0.0, 0.4]}}} if drawn else {}
    words = {"asset": write_mjcf(tmp_path, "cube", '<geom type="box" size=".02 .02 .02"/>'), "reachable": "ik"}
    objects = {"cube": {**words, "region": {"box": [[0, 0, 0.5], [0.1, 0.1, 0.6]]}}}
    scene = build_model(SceneConfig.load({"robot": {"asset": file, **joints}, "objects": objects}))
    plan = build_plan(scene)
    (one,) = plan.reaching.arms
    mjm, data = scene.mjm, mujoco.MjData(scene.mjm)
    bound = moves_of(plan, one)
    at = {"left": 0.3, "right": 0.3, "tool": 0.4 if drawn else 0.0}
    for name, value in at.items():
        data.qpos[mjm.joint(f"arm/{name}").qposadr[0]] = value
    mujoco.mj_kinematics(mjm, data)
    for name in at:
        body = mjm.body(f"arm/{name}").id
        away = data.xpos[body] - data.xpos[mjm.body("arm/hand").id]
        assert np.linalg.norm(away[:2]) <= bound[body, 0], name
