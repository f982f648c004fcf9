"""Tables of layouts: copies of what a generator has made, the same rows however they are made, and TCP poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import warp as wp

from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.seeds import as_seeds
from sceniris_gym.layout.tables import RequestedLayouts, make_table, make_tables
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import COLUMNS, LayoutTable
from tests.layout.scenes import FLOOR, box_mjcf, compile_on_cpu, full_tray


def assert_same(left: LayoutTable, right: LayoutTable) -> None:
    """Check that two tables agree to the bit."""
    for name in COLUMNS:
        np.testing.assert_array_equal(getattr(left, name), getattr(right, name), err_msg=name)


def test_a_table_is_a_copy_of_the_batch(crane: CompiledScene):
    """Column by column, of all worlds or of the first ones, and later resets do not change it."""
    generator = LayoutGenerator(crane, 6, seed=2)
    generator.generate()
    table, layouts = generator.table(), generator.layouts
    for name in ("qpos", "attempts", "status", "seed", "episode", "grasp"):
        np.testing.assert_array_equal(getattr(table, name), getattr(layouts, name).numpy(), err_msg=name)
    np.testing.assert_array_equal(table.valid, layouts.status.numpy() == LayoutStatus.VALID)
    assert table.present.dtype == table.valid.dtype == table.first_pass_valid.dtype == bool
    assert table.mocap_pos.shape == (6, crane.mjm.nmocap, 3)
    assert table.grasp_qpos.shape == (6, 1, 4)  # the crane's own joints, not the room that there is for others
    assert_same(generator.table(4), table[slice(0, 4)])
    before = [getattr(table, name).copy() for name in COLUMNS]
    generator.generate()
    for name, values in zip(COLUMNS, before, strict=True):
        np.testing.assert_array_equal(getattr(table, name), values, err_msg=name)
    assert not np.array_equal(generator.table().qpos, table.qpos)


def test_rows_do_not_depend_on_how_many_are_made_at_once(crane: CompiledScene):
    """Ten at once, in threes, or the last six alone."""
    whole = make_table(crane, 10, 40)
    assert_same(make_table(crane, 10, 40, chunk=3), whole)
    tables = make_tables(LayoutGenerator(crane, 3), as_seeds(40, 10))
    assert [len(table) for table in tables] == [3, 3, 3, 1]
    assert_same(make_table(crane, 6, 44), whole[slice(4, 10)])
    assert whole.seed.tolist() == list(range(40, 50))
    assert not whole.episode.any()


def test_seeds_go_round_and_splits_differ(crane: CompiledScene):
    """Behind the largest seed comes 0; the other split has other layouts; what is no seed is refused."""
    around = make_table(crane, 3, 2**64 - 1)
    assert around.seed.tolist() == [2**64 - 1, 0, 1]
    np.testing.assert_array_equal(around.qpos[1:], make_table(crane, 2, 0).qpos)
    assert not np.array_equal(make_table(crane, 2, 0, split="eval").qpos, around.qpos[1:])
    with pytest.raises(ArgumentError, match="seed=-1"):
        make_table(crane, 2, -1)


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
        fallback.append(layouts.status.numpy()[0] == LayoutStatus.FALLBACK)
    return [np.array(column) for column in zip(*rows, strict=True)], np.array(fallback)


@pytest.mark.parametrize("split", ["train", "eval"])
def test_layouts_are_those_of_a_generator(stand: CompiledScene, split: str):
    """Of seeds beyond 32 bits and later episodes, too; a second call gives the same, whatever came before."""
    requested = RequestedLayouts(stand, len(SEEDS), split)
    expected, _ = made_one_by_one(stand, split)
    for _ in range(2):
        found = ask(requested, stand, [True] * 5)
        assert all(np.array_equal(a, b) for a, b in zip(found[:3], expected, strict=True))
        assert (found[3] == LayoutStatus.VALID).all()
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
    assert (status == np.where(mask, LayoutStatus.VALID, LayoutStatus.NONE)).all()


def test_layouts_from_the_bank_are_flagged(tmp_path: Path):
    """In a tray so full that most attempts fail; it has no mocap body."""
    tray = full_tray(tmp_path)
    assert tray.mjm.nmocap == 0
    expected, from_bank = made_one_by_one(tray)
    qpos, _, _, status = ask(RequestedLayouts(tray, len(SEEDS)), tray, [True] * 5)
    assert from_bank.any()
    assert np.array_equal(status == LayoutStatus.FALLBACK, from_bank)
    assert np.array_equal(qpos, expected[0])
