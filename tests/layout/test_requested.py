"""Layouts by seed and episode: those of a generator, in any order, and nothing that depends on earlier calls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import warp as wp

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Status
from sceniris_gym.layout.requested import RequestedLayouts
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import FLOOR, box_mjcf, compile_on_cpu, full_tray

SEEDS = [3, 2**40 + 9, 3, 2**64 - 1, 9]
EPISODES = [0, 2, 1, 1, 0]


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """A stand on a mocap body, and a cube on it."""
    folder = tmp_path_factory.mktemp("stand")
    objects = {
        "stand": {"asset": box_mjcf(folder, "stand", 0.2, 0.2, 0.02), "kind": "fixture", "on": "floor"},
        "cube": {"asset": box_mjcf(folder, "cube", 0.04, 0.04, 0.04), "on": "stand"},
    }
    return compile_on_cpu({"floor": FLOOR, "objects": objects}, bank=2)


def ask(requested: RequestedLayouts, compiled: CompiledScene, mask: list[bool]) -> list[np.ndarray]:
    """Return the joints, the mocap poses and the statuses of layouts of SEEDS and EPISODES."""
    words = np.stack([np.array(SEEDS, object) & 2**32 - 1, np.array(SEEDS, object) >> 32], axis=1).astype(np.uint32)
    nworld, mjm = len(SEEDS), compiled.mjm
    outputs = [
        wp.zeros((nworld, mjm.nq), dtype=float, device="cpu"),
        wp.zeros((nworld, mjm.nmocap), dtype=wp.vec3, device="cpu"),
        wp.zeros((nworld, mjm.nmocap), dtype=wp.quat, device="cpu"),
        wp.zeros(nworld, dtype=int, device="cpu"),
    ]
    inputs = ((words, wp.uint32), (EPISODES, wp.int32), (mask, wp.bool))
    requested.launch(*(wp.array(values, dtype=dtype, device="cpu") for values, dtype in inputs), *outputs)
    return [array.numpy() for array in outputs]


def made_one_by_one(compiled: CompiledScene, split: str = "train") -> tuple[list[np.ndarray], np.ndarray]:
    """Return what a generator of one world makes for each of SEEDS, at its episode."""
    rows, fallback = [], []
    for seed, episode in zip(SEEDS, EPISODES, strict=True):
        generator = LayoutGenerator(compiled, 1, seed=seed, split=split)
        for _ in range(episode + 1):
            generator.generate()
        layouts = generator.layouts
        arrays = (layouts.qpos, layouts.mocap_pos, layouts.mocap_quat)
        rows.append([array.numpy()[0].copy() for array in arrays])
        fallback.append(layouts.status.numpy()[0] == Status.FALLBACK)
    return [np.array(column) for column in zip(*rows, strict=True)], np.array(fallback)


@pytest.mark.parametrize("split", ["train", "eval"])
def test_layouts_are_those_of_a_generator(stand: CompiledScene, split: str):
    """Of seeds beyond 32 bits and later episodes, too; a second call gives the same, whatever came before."""
    requested = RequestedLayouts(stand, len(SEEDS), split)
    expected, _ = made_one_by_one(stand, split)
    for _ in range(2):
        found = ask(requested, stand, [True] * 5)
        assert all(np.array_equal(a, b) for a, b in zip(found[:3], expected, strict=True))
        assert (found[3] == Status.VALID).all()
        ask(requested, stand, [False, True, True, False, False])


def test_the_others_get_the_start_pose(stand: CompiledScene):
    """In rows outside the mask, also after an earlier call made a layout there."""
    requested = RequestedLayouts(stand, len(SEEDS))
    ask(requested, stand, [True] * 5)
    mask = [True, False, False, True, False]
    qpos, pos, quat, status = ask(requested, stand, mask)
    (made, made_pos, _), _ = made_one_by_one(stand)
    assert np.array_equal(qpos[mask], made[mask]) and np.array_equal(pos[mask], made_pos[mask])
    others = ~np.array(mask)
    assert np.array_equal(qpos[others], np.tile(stand.home_qpos.astype(np.float32), (3, 1)))
    body = np.flatnonzero(stand.mjm.body_mocapid >= 0)
    np.testing.assert_allclose(pos[others, 0], np.tile(stand.mjm.body_pos[body], (3, 1)), atol=1e-7)
    np.testing.assert_allclose(quat[others, 0], np.tile(stand.mjm.body_quat[body], (3, 1)), atol=1e-7)
    assert (status == np.where(mask, Status.VALID, Status.NONE)).all()


def test_layouts_from_the_bank_are_flagged(tmp_path: Path):
    """In a tray so full that most attempts fail; it has no mocap body."""
    tray = full_tray(tmp_path)
    assert tray.mjm.nmocap == 0
    expected, from_bank = made_one_by_one(tray)
    qpos, _, _, status = ask(RequestedLayouts(tray, len(SEEDS)), tray, [True] * 5)
    assert from_bank.any()
    assert np.array_equal(status == Status.FALLBACK, from_bank)
    assert np.array_equal(qpos, expected[0])
