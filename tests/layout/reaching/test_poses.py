"""Poses of a candidate's robot: MuJoCo C has the same bodies in the same places."""

from __future__ import annotations

from collections.abc import Iterator
from unittest.mock import patch

import mujoco
import numpy as np
import pytest

from sceniris_gym.grasping.grasps import Grasp
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.reaching.poses import OPENING_MARGIN, launch_pose
from sceniris_gym.layout.reaching.search import PREGRASP_DISTANCE, ReachStep
from sceniris_gym.layout.reaching.stage import ReachStage
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.reach.solve import POS_TOL
from tests.layout.grasped import cluttered, is_clear, waiting

N = 60


@pytest.fixture(scope="module", params=["ik", "clear"])
def compiled(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """The cluttered scene for both tiers."""
    return cluttered(tmp_path_factory.mktemp(request.param), request.param)


def _passed(generator: LayoutGenerator, stage: ReachStage) -> Iterator[tuple[int, mujoco.MjData, Grasp]]:
    """Run a wave but for its end; yield each candidate that passed, the layout that it is in, and its grasp.

    The MjData is the same one each time.
    """
    with patch("sceniris_gym.layout.reaching.stage.launch_accept_grasps", lambda *_: None):
        stage._wave(*stage._arms[0])
    search, compiled, layouts = stage.search, generator.compiled, generator.layouts
    assert compiled.reaching is not None
    grasps = compiled.reaching.targets[0].grasp_set.grasps
    rows, data = search.row.numpy(), mujoco.MjData(compiled.mjm)
    number = search.grasp.numpy() - stage._arms[0][0].reach_graspadr.numpy()[0]
    for c in np.flatnonzero(search.failed.numpy()[: search.candidates.numpy()[0]] == ReachStep.PASSED):
        data.qpos[:] = layouts.qpos.numpy()[rows[c]]
        data.mocap_pos[:], data.mocap_quat[:] = (a.numpy()[rows[c]] for a in (layouts.mocap_pos, layouts.mocap_quat))
        yield int(c), data, grasps[number[c]]


def test_the_whole_robot_stands_as_mujoco_poses_it(compiled: CompiledScene):
    """Joints in the grasp, for `clear` in the pre-grasp too, each with poses of its own; the gripper is opened."""
    generator, stage = waiting(compiled, N, busy=24 * N, grasps=24 * N)
    assert compiled.reaching is not None
    own, mjm = compiled.reaching.arms[0], compiled.mjm
    robot, checked = compiled.scene.subtree(own.robot), 0
    own_qpos = [mjm.jnt_qposadr[j] for j in range(mjm.njnt) if mjm.jnt_bodyid[j] in robot]
    for c, data, grasp in _passed(generator, stage):
        search = stage.search
        qpos = search.qpos.numpy()[c]
        for pose, solved in enumerate((search.grasp_qpos, search.pregrasp_qpos)[: 1 + is_clear(compiled)]):
            joints = search.qpos.numpy()[c + pose * len(search.failed), own.arm.qposadr]
            np.testing.assert_array_equal(joints, solved.numpy()[c, : len(own.arm.joints)])
        left, right = (qpos[mjm.joint(f"picker/{side}").qposadr[0]] for side in ("left", "right"))
        assert left + right == pytest.approx(min(grasp.opening + OPENING_MARGIN, 0.08), abs=1e-6)
        data.qpos[own_qpos] = qpos[own_qpos]
        for pose, solved in enumerate((search.grasp_qpos, search.pregrasp_qpos)[: 1 + is_clear(compiled)]):
            data.qpos[own.arm.qposadr] = solved.numpy()[c, : len(own.arm.joints)]
            mujoco.mj_kinematics(mjm, data)
            at = c + pose * len(search.failed)
            np.testing.assert_allclose(search.body_pos.numpy()[at, robot], data.xpos[robot], atol=2e-6)
            turned = np.abs((search.body_quat.numpy()[at, robot] * data.xquat[robot]).sum(axis=1))
            np.testing.assert_allclose(turned, 1.0, atol=1e-6)
        checked += 1
    assert checked > N // 3


@pytest.mark.parametrize("pose", [0, 1])
def test_the_hand_alone_stands_where_solved_joints_bring_it(compiled: CompiledScene, pose: int):
    """Without any joints of the arm: its fingers are where the whole robot has them, 8 cm back in the pre-grasp."""
    if not is_clear(compiled):
        return
    generator, stage = waiting(compiled, N, busy=24 * N, grasps=24 * N)
    candidates = [(c, data.qpos.copy()) for c, data, _ in _passed(generator, stage)]
    search, reach, mjm = stage.search, stage._arms[0][0], compiled.mjm
    launch_pose(generator._work, reach, ReachStep.HAND_AT_GRASP, ReachStep.HAND_AT_PREGRASP, search)
    starts, solved, checked = search.ik_start.numpy(), search.grasp_qpos.numpy(), 0
    fingers = [mjm.body(f"picker/{side}").id for side in ("left", "right")]
    site, arm, data = mjm.site("picker/tcp").id, reach.arm_qposadr.numpy(), mujoco.MjData(mjm)
    for c, qpos in candidates:
        if starts[c] == 0:
            data.qpos[:] = qpos
            data.qpos[arm] = solved[c, : len(arm)]
            gripper = reach.grip_qposadr.numpy()
            data.qpos[gripper] = search.qpos.numpy()[c + pose * len(search.failed), gripper]
            mujoco.mj_kinematics(mjm, data)
            expected = data.xpos[fingers] - pose * PREGRASP_DISTANCE * data.site_xmat[site].reshape(3, 3)[:, 2]
            off = np.linalg.norm(search.body_pos.numpy()[c + pose * len(search.failed), fingers] - expected, axis=1)
            assert off.max() < 3 * POS_TOL  # of position and of 0.5 degrees over 10 cm
            checked += 1
    assert checked > 3
