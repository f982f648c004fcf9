"""Looking poses up in a map whose labels are those of a known shape."""

import math

import numpy as np
import pytest
import warp as wp

from benchmarks.sampled_map import canonical
from sceniris_gym.config.tier import Verdict
from sceniris_gym.reach.lookup import MapView, witness
from sceniris_gym.reach.map import ReachMap
from sceniris_gym.reach.solve import as_vec8, random_joints, vec8
from tests.reach.arms import tcp_poses
from tests.reach.shapes import ball, gantry, map_of, poses, random_axes, turn

STEP, TILT_STEP = 0.05, math.radians(7.5)


@pytest.fixture(scope="module")
def shell() -> ReachMap:
    """A map of `shapes.ball`."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        return map_of(ball, monkeypatch, gantry()[1], STEP, TILT_STEP)


def box(num: int, seed: int) -> np.ndarray:
    """Random positions about the arm [m], shape (N, 3)."""
    return np.random.default_rng(seed).uniform([-1.0, -1.0, -0.6], [1.0, 1.0, 1.2], (num, 3))


def test_verdicts_are_those_of_the_shape(shell: ReachMap):
    """Of 20,000 poses under 0.5% are decided wrong, although one in twelve is in a cell that the surface crosses."""
    asked = poses(box(20_000, 1), random_axes(20_000, 2), np.zeros(20_000))
    truth = ball(canonical(asked[:, :3, 3], asked[:, :3, 2], np.zeros(2)))
    verdict = shell.verdict(asked, "cpu")
    assert 0.15 < truth.mean() < 0.8
    assert ((verdict >= Verdict.MIXED_YES) != truth).mean() < 0.005
    assert truth[verdict == Verdict.YES].all()
    assert not truth[verdict == Verdict.NO].any()
    assert all((verdict == v).mean() > 0.02 for v in Verdict)


def test_a_verdict_stays_when_base_and_target_turn_or_the_hand_rolls(shell: ReachMap):
    """Only rounding can change it, in a cell that is crossed by the surface or on a border between cells."""
    asked = poses(box(5_000, 3), random_axes(5_000, 4), np.zeros(5_000))
    before = shell.verdict(asked, "cpu")
    for angle in (0.3, 2.0, math.pi, 4.4):
        changed = shell.verdict(turn(angle) @ asked @ turn(1.7 * angle), "cpu") != before
        assert changed.mean() < 1e-3


def test_outside_of_the_map_nothing_is_reached(shell: ReachMap):
    """Far away, just beyond each side, and at positions that are no numbers: never clamped to the nearest cell."""
    far = np.array([[50.0, 0, 0.3], [0, -3, 0.3], [0, 0, -2], [0, 0, 9], [1e20, 0, 0], [np.nan, 0, 0.3]])
    for approach in ([0.0, 0.0, -1.0], [0.6, 0.0, 0.8], [0.0, -1.0, 0.0]):
        asked = poses(far, np.tile(approach, (len(far), 1)), np.zeros(len(far)))
        assert (shell.verdict(asked, "cpu") == Verdict.NO).all()


def test_indices_are_floored(monkeypatch: pytest.MonkeyPatch):
    """A shape that fills a map of 2 x 1.2 m to its last corner ends there, on all sides alike."""
    everything = map_of(lambda coords: np.ones(len(coords), bool), monkeypatch, gantry()[1], 0.2, math.radians(30))
    for axis in range(3):
        for side in (-1.0, 1.0):
            pos = np.zeros((200, 3))
            pos[:, 2] = 0.3
            pos[:, axis] += side * np.linspace(0.85, 1.6, 200)
            found = everything.verdict(poses(pos, np.tile([1.0, 0.0, 0.0], (200, 1)), np.zeros(200)), "cpu")
            reached = np.abs(pos - [0, 0, 0.3])[:, axis][found >= Verdict.MIXED_YES]
            assert 1.15 <= reached.max() <= 1.2
            assert (np.diff(found.astype(int)) <= 0).all()


@pytest.mark.parametrize("down", [False, True])
def test_at_a_pole_height_and_radius_decide(shell: ReachMap, down: bool):
    """Under 0.2% wrong with a grid of 5 cm, wherever a rounding error of the approach points."""
    pos = box(20_000, 5)
    axes = random_axes(20_000, 6) * 1e-4 + [0.0, 0.0, -1.0 if down else 1.0]
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    coords = np.zeros((len(pos), 4))
    coords[:, 0], coords[:, 1], coords[:, 2] = pos[:, 2], math.pi * down, np.hypot(pos[:, 0], pos[:, 1])
    verdict = shell.verdict(poses(pos, axes, np.zeros(len(pos))), "cpu")
    truth = ball(coords)
    assert ((verdict >= Verdict.MIXED_YES) != truth).mean() < 0.002
    assert truth[verdict == Verdict.YES].all()


def test_beside_a_pole_the_grid_agrees_with_the_pole(shell: ReachMap):
    """Approach axes a quarter of a degree off the vertical are looked up in the grid; few verdicts change."""
    pos = box(20_000, 7)
    upright, off = np.tile([0.0, 0.0, -1.0], (len(pos), 1)), random_axes(len(pos), 8) * [0.004, 0.004, 0.0]
    tilted = (upright + off) / np.linalg.norm(upright + off, axis=1, keepdims=True)
    found = [shell.verdict(poses(pos, axes, np.zeros(len(pos))), "cpu") >= 2 for axes in (upright, tilted)]
    assert (found[0] != found[1]).mean() < 0.01


@wp.kernel(enable_backward=False)
def _witnesses(
    view: MapView,
    pos: wp.array[wp.vec3],
    quat: wp.array[wp.vec4],
    k: int,
    joints: wp.array[vec8],
):
    i = wp.tid()
    joints[i] = witness(view, pos[i], quat[i], k)


def witnesses(reach_map: ReachMap, asked: np.ndarray, k: int) -> np.ndarray:
    """Witness `k` for each TCP pose, shape (N, njoint)."""
    import mujoco

    quats = np.zeros((len(asked), 4))
    for quat, pose in zip(quats, asked, strict=True):
        mujoco.mju_mat2Quat(quat, pose[:3, :3].ravel())
    joints = wp.zeros(len(asked), dtype=vec8, device="cpu")
    arrays = [wp.array(asked[:, :3, 3], dtype=wp.vec3, device="cpu"), wp.array(quats, dtype=wp.vec4, device="cpu")]
    wp.launch(_witnesses, dim=len(asked), inputs=[reach_map.view("cpu"), *arrays, k, joints], device="cpu")
    return joints.numpy()[:, : len(reach_map.arm.joints)]


@pytest.mark.parametrize("limits", [(None, None), ("-2.6 2.6", "-2.8 2.8")])
def test_a_witness_is_turned_to_the_pose(shell: ReachMap, limits: tuple[str | None, str | None]):
    """With witnesses that solve a pose of azimuth and roll 0, base and hand come out as the pose is turned."""
    mjm, arm = gantry(*limits)
    joints = random_joints(arm, 30, 9)
    joints[:, 4] = np.abs(joints[:, 4])  # the approach points forward: the azimuth is the first joint
    flat = joints.copy()
    flat[:, [0, 5]] = 0.0
    for asked, want, base in zip(tcp_poses(mjm, arm, joints), joints, flat, strict=True):
        cells = np.zeros((*shell.wit_cells.shape[:4], 2), np.int32)
        cells[..., 1] = 1
        fields = {name: getattr(shell, name) for name in shell.__dataclass_fields__}
        known = ReachMap(**fields | {"arm": arm, "wit_cells": cells, "wit_joints": base[None].astype(np.float16)})
        got = witnesses(known, asked[None], 3)[0]
        apart = np.abs(got - want)
        apart[[0, 5]] = np.abs((apart[[0, 5]] + math.pi) % (2.0 * math.pi) - math.pi)
        assert apart.max() < 2e-3
        assert (got[[0, 5]] >= arm.lower[[0, 5]] - 1e-3).all() and (got[[0, 5]] <= arm.upper[[0, 5]] + 1e-3).all()


def test_without_a_witness_the_start_pose_turns_to_the_target(shell: ReachMap):
    """There is always a start: the base points at the target, the rest stands at home."""
    asked = poses(np.array([[-3.0, 4.0, 0.2]]), np.array([[0.0, 0.0, -1.0]]), np.zeros(1))
    home = as_vec8(shell.arm.home[None])[0, :6]
    home[0] = math.atan2(4.0, -3.0)
    assert np.allclose(witnesses(shell, asked, 0)[0], home, atol=1e-5)
