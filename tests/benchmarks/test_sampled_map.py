"""The sampled map, which is a baseline."""

import math

import numpy as np

from benchmarks.sampled_map import canonical, sampled_map
from sceniris_gym.reach.solve import random_joints
from tests.reach.arms import tcp_poses
from tests.reach.shapes import gantry, gantry_reaches, poses, random_axes, turn


def test_a_sampled_map_knows_the_poses_that_made_it():
    """The samples' poses are reached; errors are cells that the surface cuts, and those that no sample fell into."""
    mjm, arm = gantry()
    found = sampled_map(arm, "cpu", samples=50_000, step=0.2, tilt_step=math.radians(20), seed=3)
    seen = random_joints(arm, 500, 3)  # the first of the samples
    assert found.verdict(tcp_poses(mjm, arm, seen)).all()
    pos = np.random.default_rng(4).uniform([-0.8, -0.8, 0.0], [0.8, 0.8, 0.8], (5_000, 3))
    asked = poses(pos, random_axes(5_000, 5), np.zeros(5_000))
    truth = gantry_reaches(canonical(pos, asked[:, :3, 2], np.zeros(2)))
    right = (found.verdict(asked) == truth).mean()
    assert 0.7 < right < 0.99
    assert found.nbytes == found.hit.size // 8


def test_outside_of_the_samples_nothing_is_reached():
    """Cells are floored and never clamped."""
    found = sampled_map(gantry()[1], "cpu", samples=1_000, step=0.2, tilt_step=math.radians(20))
    far = np.array([[5.0, 0.0, 0.2], [0.0, 0.0, -3.0], [0.0, -1.5, 0.3]])
    assert not found.verdict(poses(far, np.tile([0.6, 0.0, 0.8], (3, 1)), np.zeros(3))).any()


def test_canonical_coordinates_stay_when_base_and_target_turn():
    """Height, tilt, and the position beside the approach; all four by hand for one pose."""
    axes = random_axes(100, 6)
    asked = poses(np.random.default_rng(7).uniform(-1, 1, (100, 3)), axes, np.zeros(100))
    turned = turn(1.1) @ asked
    before, after = (canonical(p[:, :3, 3], p[:, :3, 2], np.zeros(2)) for p in (asked, turned))
    assert np.allclose(before, after)
    one = canonical(np.array([[0.4, 0.3, 0.2]]), np.array([[0.0, 0.8, -0.6]]), np.array([0.1, 0.0]))
    assert np.allclose(one, [[0.2, math.pi - math.acos(0.6), 0.3, -0.3]])
