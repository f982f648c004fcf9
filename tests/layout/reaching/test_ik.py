"""Inverse kinematics of candidates: their starts, solutions that MuJoCo C confirms, and branches of pre-grasps."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import warp as wp
from scipy import stats

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.reaching import ik
from sceniris_gym.layout.reaching.search import STARTS
from sceniris_gym.layout.reaching.waves import launch_look_up, launch_open_wave
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.solve import POS_TOL, ROT_TOL, ArmView, arm_view, as_vec8, vec8
from tests.layout.grasped import arm_mjcf, cluttered, is_clear, taken, waiting

N = 60


@pytest.fixture(scope="module", params=["ik", "clear"])
def compiled(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """The cluttered scene for both tiers."""
    return cluttered(tmp_path_factory.mktemp(request.param), request.param)


def _starts(compiled: CompiledScene, split: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return the starts of the first grasp of N worlds, (N, STARTS, 6), and the layouts' joints of the arm, (N, 6)."""
    generator, stage = waiting(compiled, N, busy=STARTS * N, grasps=STARTS * N)
    reach, search = stage._arms[0][0], stage.search
    work = replace(generator._work, split=split)
    launch_open_wave(work, reach, search)
    launch_look_up(work, reach, search)
    order = search.first.numpy()[:, None] + np.arange(STARTS)
    assert (search.ik_start.numpy()[order] == np.arange(STARTS)).all()
    return search.grasp_qpos.numpy()[order, :6], generator.layouts.qpos.numpy()[:, reach.arm_qposadr.numpy()]


def test_the_first_start_is_the_pose_of_the_layout_and_others_are_random(compiled: CompiledScene):
    """Without a map: uniform within limits, from -pi to pi for a hinge without limits, and others for another split."""
    starts, home = _starts(compiled)
    assert (starts[:, 0] == home).all()
    drawn = starts[:, 1:].reshape(-1, 6)
    low = np.radians([-170, -120, 0, -170, -115, -180])
    high = np.radians([170, 120, 155, 170, 115, 180])
    for i in range(6):
        assert stats.kstest((drawn[:, i] - low[i]) / (high[i] - low[i]), "uniform").pvalue > 1e-3
    assert (_starts(compiled)[0] == starts).all()
    other = _starts(compiled, split=1)[0]
    assert (other[:, 0] == home).all()
    assert (other[:, 1:] != starts[:, 1:]).all()


@wp.kernel(enable_backward=False)
def _shift(
    arm: ArmView, there: wp.array[vec8], before: wp.array[vec8], q_out: wp.array[vec8], near_out: wp.array[bool]
):
    i = wp.tid()
    q, near = ik.nearest_turns(arm, there[i], before[i])
    q_out[i] = q
    near_out[i] = near


def test_joints_without_limits_take_the_nearest_turn(tmp_path):
    """Only the last joint of the arm turns freely; the branch is another one if any joint moves by more than 0.8."""
    mjm = mujoco.MjModel.from_xml_path(arm_mjcf(tmp_path))
    view = arm_view(SerialArm.from_model(mjm, "picker"), "cpu")
    rng = np.random.default_rng(0)
    there = rng.uniform(-2.0, 2.0, (500, 6))
    change = rng.uniform(-0.9, 0.9, (500, 6))
    turns = 2.0 * math.pi * rng.integers(-1, 2, 500)
    before = there + change
    before[:, 5] += turns
    arrays = [wp.array(as_vec8(joints), dtype=vec8, device="cpu") for joints in (there, before)]
    q, near = wp.zeros(500, dtype=vec8, device="cpu"), wp.zeros(500, dtype=bool, device="cpu")
    wp.launch(_shift, dim=500, inputs=[view, *arrays], outputs=[q, near], device="cpu")
    np.testing.assert_allclose(q.numpy()[:, :6], there + change, atol=1e-5)
    assert (near.numpy() == (np.abs(change) <= 0.8).all(axis=1)).all()
    assert 50 < near.numpy().sum() < 450


def test_accepted_joints_hold_by_mujoco(compiled: CompiledScene):
    """Within limits, at the grasp to 1 mm and 0.5 degrees, and clear of the robot itself: without exception."""
    generator = LayoutGenerator(compiled, 300, seed=3)
    generator.generate()
    found = list(taken(compiled, generator.layouts, "grasp_qpos"))
    assert len(found) == 600
    assert max(t.far for t in found) <= POS_TOL
    assert max(t.turned for t in found) <= ROT_TOL
    assert all(t.within for t in found)
    assert not any(t.itself for t in found)
    # among the posts the arm would hit something now and then
    assert any(t.others for t in found) != is_clear(compiled)


def test_pre_grasps_of_clear_hold_by_mujoco(compiled: CompiledScene):
    """8 cm back along the approach, without contact, joints close to those of the grasp; nan for other tiers."""
    generator = LayoutGenerator(compiled, 300, seed=4)
    generator.generate()
    layouts = generator.layouts
    if not is_clear(compiled):
        assert np.isnan(layouts.pregrasp_qpos.numpy()).all()
        return
    found = list(taken(compiled, layouts, "pregrasp_qpos"))
    assert len(found) == 600
    assert max(t.far for t in found) <= POS_TOL
    assert max(t.turned for t in found) <= ROT_TOL
    assert not any(t.itself or t.others for t in found)
    change = layouts.pregrasp_qpos.numpy() - layouts.grasp_qpos.numpy()
    assert np.nanmax(np.abs(change)) <= ik.SAME_BRANCH + 1e-6
    assert np.isnan(change[:, :, 6:]).all()
