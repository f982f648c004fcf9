"""The end of a round: whose layout and whose counts a world takes, and which worlds go on.

Worlds out of restarts get an entry of the bank, each a valid layout, of their own split.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.layout.compile import _with_bank
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.wave.rounds import NEVER, launch_begin_episodes
from sceniris_gym.layout.wave.search import default_size
from sceniris_gym.layout.wave.settle import launch_settle
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import WORLD_FIELDS, Program, copied, fill_struct
from sceniris_gym.program.device_bank import Bank
from tests.layout.scenes import FLOOR, Rows, bank_rows, box_mjcf, compile_on_cpu, full_tray, make, posed, read
from tests.oracle.solids import Solids

RESTARTS = 5


def test_a_world_takes_the_lowest_restart_that_is_done(tmp_path: Path):
    """With attempts and rejections up to it; the others go on while they have restarts left, and then fall back."""
    crate = {"asset": box_mjcf(tmp_path, "crate", 0.1, 0.1, 0.05), "on": "floor"}
    words = {"floor": {"size": [1.0, 1.0]}, "restarts": RESTARTS, "objects": {"crate": crate}}
    work = LayoutGenerator(compile_on_cpu(words, bank=8), 4, size=replace(default_size("cpu"), rows=8))._work
    layouts, search = work.layouts, work.search
    launch_begin_episodes(work, None)
    search.restarts_at_once.fill_(3)
    search.restart.assign([0, 0, 1, 3])
    search.best.assign([0, 2, NEVER, NEVER])
    rows = [[0, 4, 5], [1, 6, 7], [2, 8, 9], [3, 10, 11]]
    assert search.ticket.numpy().tolist() == [0, 1, 2, 3]
    search.row_attempts.assign(1 << np.arange(12))
    state = np.zeros(layouts.qpos.shape, np.float32)
    state[:, 3] = 1.0
    state[:, 0] = 0.01 * np.arange(12)
    layouts.qpos.assign(state)
    counts = np.zeros(layouts.row_rejections.shape, np.int32)
    counts[:, 0, 2] = 1 << np.arange(12)
    layouts.row_rejections.assign(counts)
    search.waiting.fill_(True)
    launch_settle(work)

    tried = [sum(1 << row for row in rows[world][:number]) for world, number in enumerate((1, 3, 3, 3))]
    assert layouts.attempts.numpy().tolist() == tried
    assert layouts.row_rejections.numpy()[:4, 0, 2].tolist() == tried
    assert layouts.status.numpy().tolist()[:2] == [LayoutStatus.VALID, LayoutStatus.VALID]
    assert layouts.status.numpy()[3] == LayoutStatus.FALLBACK
    assert layouts.qpos.numpy()[:3, 0].tolist() == state[[0, 7, 2], 0].tolist()
    assert layouts.first_pass_valid.numpy()[:2].tolist() == [1, 0]
    assert search.pending.numpy().tolist() == [False, False, True, False]
    assert (search.restart.numpy()[2], search.best.numpy()[2]) == (4, NEVER)
    assert not search.waiting.numpy().any()


@pytest.fixture(scope="module")
def hard(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """A tray on which most worlds fall back."""
    return full_tray(tmp_path_factory.mktemp("hard"))


@pytest.mark.parametrize("split", ["train", "eval"])
def test_an_exhausted_world_takes_an_entry_of_the_bank(hard: CompiledScene, split: str):
    """All entries are taken equally often, and the entry of a world depends on its seed and episode alone."""
    bank = [row.tobytes() for row in hard.bank.qpos.numpy()[bank_rows(hard, split)]]
    generator = LayoutGenerator(hard, 400, seed=0, split=split)
    generator.generate()
    rows = read(generator.layouts)
    fallen = rows.status == LayoutStatus.FALLBACK
    assert 100 < fallen.sum() < 390
    assert (fallen | (rows.status == LayoutStatus.VALID)).all()
    served = [bank.index(row.tobytes()) for row in rows.qpos[fallen]]
    assert stats.chisquare(np.bincount(served, minlength=len(bank))).pvalue > 0.001
    assert not any(row.tobytes() in bank for row in rows.qpos[~fallen])
    assert (generator.layouts.first_pass_valid.numpy() == ~fallen).all()
    for seed in np.flatnonzero(fallen)[:20].tolist():
        assert make(hard, 1, seed=seed, split=split).bits() == rows[seed : seed + 1].bits()


def test_no_row_of_an_evaluation_is_one_of_training(hard: CompiledScene):
    """Though half of the worlds fall back: each split has a bank of its own, and both are full."""
    made = {split: make(hard, 2000, split=split) for split in ("train", "eval")}
    assert all((rows.status == LayoutStatus.FALLBACK).mean() > 0.3 for rows in made.values())
    seen = {row.tobytes() for row in made["train"].qpos}
    assert not any(row.tobytes() in seen for row in made["eval"].qpos)
    assert len(hard.bank.qpos.numpy()) == 2 * hard.config.bank


def test_bank_entries_are_valid_layouts(hard: CompiledScene):
    """They keep every clearance, by FCL, and they differ."""
    qpos = hard.bank.qpos.numpy()
    solids = Solids(hard.mjm, "physics")
    rows = Rows(qpos, hard.bank.mocap_pos.numpy(), hard.bank.mocap_quat.numpy(), *[np.zeros(32)] * 2)
    names = list(hard.object_names)
    for data in posed(hard, rows):
        for i, a in enumerate(names):
            assert all(solids.distance(data, solids.geoms(a), solids.geoms(b)) >= 0.001 for b in names[:i])
    assert len({row.tobytes() for row in qpos}) == 32


def test_a_failed_world_does_not_touch_its_neighbours(hard: CompiledScene):
    """Beside worlds that fall back, and with the same seeds alone, valid worlds are bit for bit the same."""
    rows = make(hard, 60, seed=900)
    keep = rows.status == LayoutStatus.VALID
    seeds = 900 + np.flatnonzero(keep)
    assert 3 < len(seeds) < 57
    assert make(hard, len(seeds), seed=seeds).bits() == rows[keep].bits()


def test_every_object_is_in_every_row(hard: CompiledScene):
    """Nothing is switched off or parked anywhere when placement fails: all crates lie on the floor."""
    rows = make(hard, 200)
    for i in range(3):
        at = rows.qpos[:, 7 * i : 7 * i + 3]
        assert (np.abs(at[:, :2]) <= 0.2).all()
        np.testing.assert_allclose(at[:, 2], 0.0005, atol=1e-6)


def test_a_scene_without_a_bank_serves_no_fallback(hard: CompiledScene):
    """While the bank is being filled: a world that runs out of restarts holds no layout, and says so."""
    bank = copied(Bank, hard.bank)
    bank.ntrain = 0
    rows, filled = make(replace(hard, bank=bank), 60, seed=900), make(hard, 60, seed=900)
    assert set(rows.status.tolist()) == {LayoutStatus.NONE, LayoutStatus.VALID}
    assert ((rows.status == LayoutStatus.NONE) == (filled.status == LayoutStatus.FALLBACK)).all()
    assert rows[rows.status == LayoutStatus.VALID].bits() == filled[filled.status == LayoutStatus.VALID].bits()


def mixed_tray(folder: Path) -> CompiledScene:
    """Compile a tray with variants, a group and two kinds of starts, one attempt each: large variants fail most."""
    on = {"on": "floor", "orientation": "fixed"}
    things = {f"m{i}": {"asset": box_mjcf(folder, f"m{i}", 0.1, 0.1, 0.05), **on} for i in range(3)}
    sizes = {"small": 0.05, "middle": 0.12, "large": 0.2}
    variants = {name: {"asset": box_mjcf(folder, name, size, size, 0.05)} for name, size in sizes.items()}
    placed = {"q": {"asset": box_mjcf(folder, "q", 0.03, 0.03, 0.03), **on}, "goal": {"kind": "marker", "on": "floor"}}
    words = {"floor": {"size": [0.4, 0.4]}, "attempts": 1, "restarts": 0}
    groups = {"g": {"of": [*things], "count": [0, 3]}}
    start = [{}, {"place": {"q": "goal"}}]
    objects = {"x": {"variants": variants, **on}, **things, **placed}
    return compile_on_cpu({**words, "objects": objects, "groups": groups, "start": start}, bank=32)


@pytest.mark.parametrize("split", ["train", "eval"])
def test_a_fallback_is_nearest_to_what_was_drawn(tmp_path: Path, split: str):
    """First the same kind of start, then the same variant, then the most members of a group; by seed and episode."""
    compiled = mixed_tray(tmp_path)
    usual, patient = LayoutGenerator(compiled, 600, split=split), copied(Program, compiled.program)
    patient.attempts = 500  # makes all layouts, of the same choices
    made = LayoutGenerator(replace(compiled, program=patient), 600, split=split)
    usual.generate()
    made.generate()
    fell = (usual.layouts.status.numpy() == LayoutStatus.FALLBACK) & (made.layouts.status.numpy() == LayoutStatus.VALID)
    assert 150 < fell.sum() < 500

    variants = [compiled.slots.index(name) for name in compiled.config.variants["x"]]

    def apart(world: int, present: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Return how far rows are from what a world drew."""
        other = present != made.layouts.present.numpy()[world]
        kind = start != made.layouts.start.numpy()[world]
        return 1e6 * kind + 1e3 * other[:, variants].any(axis=1) + np.delete(other, variants, axis=1).sum(axis=1)

    rows = bank_rows(compiled, split)
    bank = [getattr(compiled.bank, name).numpy()[rows] for name in ("present", "start")]
    states = [state.tobytes() for state in compiled.bank.qpos.numpy()[rows]]
    for world in np.flatnonzero(fell).tolist():
        served = [getattr(usual.layouts, name).numpy()[[world]] for name in ("present", "start")]
        assert apart(world, *served) == apart(world, *bank).min()
        assert usual.layouts.qpos.numpy()[world].tobytes() in states
    for world in np.flatnonzero(fell)[:5].tolist():
        assert make(compiled, 1, seed=world, split=split).qpos.tobytes() == usual.layouts.qpos.numpy()[world].tobytes()
    ids = {usual.layouts.qpos.numpy()[world].tobytes() for world in np.flatnonzero(fell)}
    assert len(ids) > len(states) // 2  # and many rows are served


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """A free cube, and a stand with a mocap root."""
    folder = tmp_path_factory.mktemp("sound")
    cube, stand = box_mjcf(folder, "cube", 0.04, 0.04, 0.04), box_mjcf(folder, "stand", 0.1, 0.1, 0.02)
    objects = {"stand": {"asset": stand, "kind": "fixture", "on": "floor"}, "cube": {"asset": cube, "on": "floor"}}
    return compile_on_cpu({"floor": FLOOR, "objects": objects}, bank=4)


def _with(compiled: CompiledScene, name: str, change: Callable[[np.ndarray], np.ndarray]) -> CompiledScene:
    program = copied(Program, compiled.program)
    values = getattr(program, name).numpy()
    changed = change(values[0] if name in WORLD_FIELDS else values)
    fill_struct(Program, program, {name: changed}, compiled.device)
    return replace(compiled, program=program)


BROKEN = {
    "a height out of bounds": ("obj_gap", lambda x: np.full_like(x, 1e6)),
    "a turn of nan": ("obj_yaw", lambda x: np.full_like(x, np.nan)),
    "poses of no length": ("stable_quat", np.zeros_like),
    "a joint beyond what is drawn": ("bound_qpos", lambda x: 0.0 * x),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_what_is_not_sound_is_replaced_by_a_valid_layout(compiled: CompiledScene, kind: str):
    """The bank was made before it broke, so worlds fall back on it, and say so; the counts name the cause."""
    generator = LayoutGenerator(_with(compiled, *BROKEN[kind]), 32)
    generator.generate()
    rows = read(generator.layouts)
    assert (rows.status == LayoutStatus.FALLBACK).all()
    assert np.isfinite(rows.qpos).all()
    assert (np.abs(rows.qpos[:, :3]) < 1.0).all()
    np.testing.assert_allclose(np.linalg.norm(rows.qpos[:, 3:], axis=1), 1.0, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(rows.mocap_quat, axis=2), 1.0, atol=1e-5)
    assert generator.rejection_counts()["cube"]["unsound"] == 32


def test_a_scene_without_a_sound_layout_is_refused(compiled: CompiledScene):
    """By the cause."""
    with pytest.raises(InfeasibleSceneError, match=r"mostly because of unsound.*Look for such numbers"):
        _with_bank(_with(compiled, *BROKEN["a turn of nan"]))


def test_sound_layouts_are_served_as_they_are(compiled: CompiledScene):
    """And nothing is counted."""
    generator = LayoutGenerator(compiled, 32)
    generator.generate()
    assert (read(generator.layouts).status == LayoutStatus.VALID).all()
    assert "unsound" not in generator.rejection_counts()["cube"]
