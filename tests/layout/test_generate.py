"""Layouts as pure functions of their seeds, the bank as the last resort, and what is counted on the way."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from scipy import stats

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import CountError, MaskError, MaskTypeError, ScenirisError, SeedError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Status
from sceniris_gym.layout.seeds import as_seeds
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import REACH_CAUSES, Cause
from sceniris_gym.scene.model import build_model
from tests.layout.scenes import FLOOR, Rows, box_mjcf, compile_on_cpu, make, posed, read
from tests.oracle.solids import Solids


@pytest.fixture(scope="module", params=["physics", "visual"])
def mid(request) -> CompiledScene:
    """The shipped scene `mid`, with both kinds of geometry."""
    return compile_on_cpu("mid", {"geometry": request.param})


@pytest.fixture(scope="module")
def hard(tmp_path_factory) -> CompiledScene:
    """A tray that is so full that one attempt and no restart fail most of the time."""
    folder = tmp_path_factory.mktemp("hard")
    crate = box_mjcf(folder, "crate", 0.1, 0.1, 0.05)
    objects = {f"crate_{i}": {"asset": crate, "on": "floor", "orientation": "fixed"} for i in range(3)}
    return compile_on_cpu({"floor": {"size": [0.4, 0.4]}, "attempts": 1, "restarts": 0, "objects": objects}, bank=16)


def _mask(values: list[bool] | np.ndarray) -> wp.array:
    return wp.array(np.asarray(values, bool), dtype=bool, device="cpu")


def _by_id(
    compiled: CompiledScene, seeds: list[int], episodes: int, split: str = "train"
) -> dict[tuple[int, int], bytes]:
    """The bits of the layouts of some seeds and episodes, each seed in a batch of its own."""
    found = {}
    for seed in seeds:
        generator = LayoutGenerator(compiled, 1, seed=seed, split=split)
        for episode in range(episodes):
            generator.generate()
            found[seed, episode] = read(generator.layouts).bits()
    return found


def _rows(generator: LayoutGenerator) -> dict[tuple[int, int], bytes]:
    rows, layouts = read(generator.layouts), generator.layouts
    ids = zip(layouts.seed.numpy().tolist(), layouts.episode.numpy().tolist(), strict=True)
    return {key: rows[i : i + 1].bits() for i, key in enumerate(ids)}


def test_a_layout_is_the_same_in_any_batch(mid: CompiledScene):
    """Alone, among others, under masks and in another order of resets: the same bits for a seed and an episode."""
    expected = _by_id(mid, list(range(40, 52)), 4)
    generator = LayoutGenerator(mid, 12, seed=40)
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(6):
        generator.generate(_mask(rng.random(12) < 0.5))
        rows = {k: v for k, v in _rows(generator).items() if 0 <= k[1] < 4}
        assert all(expected[k] == v for k, v in rows.items())
        seen |= set(rows)
    assert len(seen) > 25
    backwards = LayoutGenerator(mid, 12, seed=list(range(51, 39, -1)))
    backwards.generate()
    assert all(expected[k] == v for k, v in _rows(backwards).items())


def test_generators_do_not_influence_each_other(mid: CompiledScene):
    """Two generators over one CompiledScene take turns."""
    expected = _by_id(mid, [5, 6], 3)
    first, second = LayoutGenerator(mid, 2, seed=5), LayoutGenerator(mid, 300, seed=5)
    for _ in range(3):
        first.generate()
        second.generate()
        assert all(expected[k] == v for k, v in _rows(first).items())
        assert all(_rows(second)[k] == v for k, v in _rows(first).items())


def test_nothing_of_an_earlier_episode_is_left_in_a_later_one(mid: CompiledScene):
    """A world that has made many layouts makes the next one as a fresh world does."""
    generator = LayoutGenerator(mid, 3, seed=1)
    for _ in range(5):
        generator.generate()
    generator.reseed(77)
    generator.generate()
    assert _rows(generator) == _rows_of(mid, 77, 3)


def _rows_of(compiled: CompiledScene, seed: int, nworld: int) -> dict[tuple[int, int], bytes]:
    generator = LayoutGenerator(compiled, nworld, seed=seed)
    generator.generate()
    return _rows(generator)


def test_what_the_mask_leaves_out_does_not_change_by_a_bit(mid: CompiledScene):
    """Every array of the batch, working space included; an all-false mask changes nothing at all."""
    generator = LayoutGenerator(mid, 8, seed=3)
    generator.generate()
    view = generator.layouts.view
    names = ["seed", "episode", "qpos", "mocap_pos", "mocap_quat", "status", "attempts", "first_pass_valid"]
    names += ["body_pos", "body_quat"]
    before = {n: getattr(view, n).numpy().copy() for n in names}
    counts = view.rejections.numpy().copy()
    generator.generate(_mask([False] * 8))
    assert all((getattr(view, n).numpy() == before[n]).all() for n in names)
    assert (view.rejections.numpy() == counts).all()
    mask = np.array([True, False, False, True, False, True, False, False])
    generator.generate(_mask(mask))
    assert all((getattr(view, n).numpy()[~mask] == before[n][~mask]).all() for n in names)
    assert (view.qpos.numpy()[mask] != before["qpos"][mask]).any(axis=1).all()
    assert (view.episode.numpy() == mask).all()


def test_counts_of_rejections_go_on_beyond_32_bits(mid: CompiledScene):
    """A training of some 10^8 resets gets there."""
    generator = LayoutGenerator(mid, 64)
    generator.generate()
    counted = generator.layouts.rejections.numpy().astype(np.int64)
    generator.layouts.rejections.fill_(2**31 - 1)
    generator.reseed(0)
    generator.generate()
    assert counted.any()
    assert (generator.layouts.rejections.numpy() == counted + (2**31 - 1)).all()


def test_splits_seeds_and_episodes_all_differ(mid: CompiledScene):
    """No two layouts of two splits, twenty seeds and two episodes are equal."""
    train, held = (_by_id(mid, list(range(20)), 2, split) for split in ("train", "eval"))
    assert len(set(train.values()) | set(held.values())) == 80


def test_high_bits_of_a_seed_count(mid: CompiledScene):
    """Seeds that agree in their low 32 bits give different layouts, and the largest seed is one."""
    seeds = [7, 7 + (1 << 32), 7 + (1 << 63), (1 << 64) - 1]
    generator = LayoutGenerator(mid, 4, seed=seeds)
    generator.generate()
    assert generator.layouts.seed.numpy().tolist() == seeds
    assert len({bytes(row.tobytes()) for row in generator.layouts.qpos.numpy()}) == 4


def test_seeds_wrap_around():
    """Seed + i is taken modulo 2^64."""
    generator = LayoutGenerator(compile_on_cpu({"objects": {}}), 3, seed=(1 << 64) - 2)
    assert generator.layouts.seed.numpy().tolist() == [(1 << 64) - 2, (1 << 64) - 1, 0]


def test_reseeding_starts_the_masked_worlds_at_episode_zero(mid: CompiledScene):
    """The others keep their seeds and go on; seeds on the device and on the host mean the same."""
    generator = LayoutGenerator(mid, 4, seed=10)
    for _ in range(2):
        generator.generate()
    mask = _mask([False, True, False, True])
    generator.reseed([100, 101, 102, 103], mask)
    assert generator.layouts.seed.numpy().tolist() == [10, 101, 12, 103]
    assert generator.layouts.episode.numpy().tolist() == [1, -1, 1, -1]
    generator.generate()
    expected = _by_id(mid, [10, 12], 3) | _by_id(mid, [101, 103], 1)
    assert all(expected[k] == v for k, v in _rows(generator).items())
    generator.reseed(wp.array(np.array([1, 2, 3, 4], np.uint64), dtype=wp.uint64, device="cpu"), mask)
    assert generator.layouts.seed.numpy().tolist() == [10, 2, 12, 4]


@pytest.mark.parametrize(
    "seed",
    [-1, 1 << 64, True, np.True_, 1.0, np.float64(2), None, "12", [1, 2], [1, 2, 3, 4], [1, 2, -3], [1, 2, 1 << 64]]
    + [[1, 2, True], [1, 2, 3.0], np.array([1.0, 2.0, 3.0]), np.array([True] * 3), np.array(5), np.ones((3, 1), int)]
    + [{1, 2, 3}, ["1", "2", "3"], "abc"],
    ids=str,
)
def test_a_wrong_seed_is_refused(seed):
    """Negative, too large, no integer, or not one for each world: in the constructor and in `reseed`."""
    compiled = compile_on_cpu({"objects": {}})
    with pytest.raises(SeedError, match="seed"):
        LayoutGenerator(compiled, 3, seed=seed)
    generator = LayoutGenerator(compiled, 3, seed=8)
    with pytest.raises(SeedError, match="seed"):
        generator.reseed(seed)
    assert generator.layouts.seed.numpy().tolist() == [8, 9, 10]


@pytest.mark.parametrize(
    "given",
    [
        40,
        np.uint8(40),
        np.int64(40),
        [40, 41, 42],
        (40, 41, 42),
        range(40, 43),
        [np.int32(40), 41, np.uint64(42)],
        *(np.array([40, 41, 42], dtype) for dtype in (np.uint8, np.int16, np.int32, ">i8", np.uint64, object)),
        np.array([40, 0, 41, 0, 42])[::2],
    ],
    ids=repr,
)
def test_seeds_may_be_integers_of_any_kind(given):
    """One that counts up, or one for each world: in any sequence or array, also one that is strided."""
    found = as_seeds(given, 3)
    assert (found.dtype, found.tolist()) == (np.uint64, [40, 41, 42])


@pytest.mark.parametrize("make", [list, tuple, lambda seeds: np.array(seeds, object), lambda s: np.array(s, np.uint64)])
def test_large_seeds_keep_all_their_bits(make):
    """Beside small ones too: NumPy by itself would make floating-point numbers of such a list."""
    seeds = [2**63 - 1, 2**63, 2**64 - 1, 0, 2**53 + 1]
    assert as_seeds(make(seeds), 5).tolist() == seeds
    mixed: list[Any] = [np.int64(3), np.uint64(2**64 - 1), 2**63 + 1]
    assert as_seeds(mixed, 3).tolist() == [3, 2**64 - 1, 2**63 + 1]
    assert as_seeds(make([2**64 - 1])[0], 3).tolist() == [2**64 - 1, 0, 1]


WRONG = [-1, 2**64, -(2**70), True, np.True_, np.int8(-5), 1.0, np.float64(2), np.nan, None, "3", 1j, [1], np.array(1)]


@pytest.mark.parametrize("wrong", WRONG, ids=repr)
@pytest.mark.parametrize("place", [0, 2])
def test_the_first_wrong_seed_of_many_is_named(wrong, place: int):
    """By its index, in lists, tuples and arrays of objects, beside seeds of all sizes."""
    seeds = [7, 2**63, 2**64 - 1, None]  # the last one is wrong in any case
    seeds[place] = wrong
    objects = np.empty(4, object)
    objects[:] = seeds
    for given in (seeds, tuple(seeds), objects):
        with pytest.raises(SeedError, match=rf"seeds\[{place}\]=.* should be an integer from 0 to 2\^64 - 1"):
            as_seeds(given, 4)


@pytest.mark.parametrize(
    ("seeds", "place"),
    [
        (np.array([5, 6, -7], np.int8), 2),
        (np.array([5, -6, -7]), 1),
        (np.array([1.0, 2.0, 3.0]), 0),
        (np.array([1.0, 2.0, np.nan], np.float32), 0),
        (np.array([True, False, True]), 0),
        (np.array(["1", "2", "3"]), 0),
        (np.array([1, 2, 3], complex), 0),
        (np.array([1, 2, 3], "m8[s]"), 0),
        (np.array([1, 2, 3], "M8[s]"), 0),
    ],
)
def test_arrays_of_other_numbers_are_refused(seeds: np.ndarray, place: int):
    """Negative ones, floating-point ones though they are whole, truth values, texts and times."""
    with pytest.raises(SeedError, match=rf"seeds\[{place}\]="):
        as_seeds(seeds, 3)


@pytest.mark.parametrize(
    "seeds", [[1, 2], [], (1, 2, 3, 4), np.arange(2), np.ones((3, 1), int), np.array(5), {1, 2, 3}, 1.0, None, "12"]
)
def test_a_wrong_number_of_seeds_is_told(seeds):
    """The right number is named."""
    with pytest.raises(SeedError, match="one integer, or a sequence of 3"):
        as_seeds(seeds, 3)


@pytest.mark.parametrize("dtype", [wp.int32, wp.int64, wp.float32])
def test_device_seeds_of_a_wrong_kind_are_refused(dtype):
    """A Warp array of another type or length is no set of seeds."""
    generator = LayoutGenerator(compile_on_cpu({"objects": {}}), 3)
    with pytest.raises(SeedError, match="uint64"):
        generator.reseed(wp.zeros(3, dtype=dtype, device="cpu"))
    with pytest.raises(SeedError, match="3"):
        generator.reseed(wp.zeros(2, dtype=wp.uint64, device="cpu"))


def test_an_unknown_split_is_refused(mid: CompiledScene):
    """The message lists the valid ones."""
    with pytest.raises(ValueError, match="train, eval"):
        LayoutGenerator(mid, 1, split="test")


@pytest.mark.parametrize("split", ["train", "eval"])
def test_an_exhausted_world_takes_an_entry_of_the_bank(hard: CompiledScene, split: str):
    """Row Philox(seed, episode) of the bank, marked as such; which one depends on nothing else."""
    bank = [row.tobytes() for row in hard.program.bank_qpos.numpy()[hard.bank_rows(split)]]
    generator = LayoutGenerator(hard, 400, seed=0, split=split)
    generator.generate()
    rows = read(generator.layouts)
    fallen = rows.status == Status.FALLBACK
    assert 100 < fallen.sum() < 390
    assert (fallen | (rows.status == Status.VALID)).all()
    served = [bank.index(row.tobytes()) for row in rows.qpos[fallen]]
    assert stats.chisquare(np.bincount(served, minlength=len(bank))).pvalue > 0.001
    assert not any(row.tobytes() in bank for row in rows.qpos[~fallen])
    assert (generator.layouts.first_pass_valid.numpy() == ~fallen).all()
    expected = _rows(generator)
    for seed in np.flatnonzero(fallen)[:20].tolist():
        alone = LayoutGenerator(hard, 1, seed=seed, split=split)
        alone.generate()
        assert _rows(alone)[seed, 0] == expected[seed, 0]


def test_no_row_of_an_evaluation_is_one_of_training(hard: CompiledScene):
    """Though half of the worlds fall back: each split has a bank of its own, and both are full."""
    made = {split: make(hard, 2000, split=split) for split in ("train", "eval")}
    assert all((rows.status == Status.FALLBACK).mean() > 0.3 for rows in made.values())
    seen = {row.tobytes() for row in made["train"].qpos}
    assert not any(row.tobytes() in seen for row in made["eval"].qpos)
    assert len(hard.program.bank_qpos.numpy()) == 2 * hard.config.bank


def test_the_size_of_the_bank_is_part_of_the_scene(hard: CompiledScene):
    """Another size is another hash, and changes the worlds that fall back alone; the default leaves the hash."""
    other = compile_scene(SceneConfig.load(hard.config, {"bank": 17}), "cpu")
    assert other.hash != hard.hash
    rows, others = make(hard, 400), make(other, 400)
    fallen = rows.status == Status.FALLBACK
    assert (rows.qpos == others.qpos)[~fallen].all()
    assert (rows.qpos != others.qpos)[fallen].any(axis=1).mean() > 0.8
    plain = SceneConfig.load("mid")
    assert build_model(SceneConfig.load(plain, {"bank": 64})).hash == build_model(plain).hash


def test_bank_entries_are_valid_layouts(hard: CompiledScene):
    """They keep every clearance, by FCL, and they differ."""
    qpos = hard.program.bank_qpos.numpy()
    solids = Solids(hard.mjm, "physics")
    rows = Rows(qpos, hard.program.bank_mocap_pos.numpy(), hard.program.bank_mocap_quat.numpy(), *[np.zeros(32)] * 2)
    names = list(hard.object_names)
    for data in posed(hard, rows):
        for i, a in enumerate(names):
            assert all(solids.distance(data, solids.geoms(a), solids.geoms(b)) >= 0.001 for b in names[:i])
    assert len({row.tobytes() for row in qpos}) == 32


def test_a_failed_world_does_not_touch_its_neighbours(hard: CompiledScene):
    """Beside worlds that fall back, and with the same seeds alone, valid worlds are bit for bit the same."""
    generator = LayoutGenerator(hard, 60, seed=900)
    generator.generate()
    rows = _rows(generator)
    keep = generator.layouts.status.numpy() == Status.VALID
    seeds = generator.layouts.seed.numpy()[keep]
    assert 3 < len(seeds) < 57
    alone = LayoutGenerator(hard, len(seeds), seed=seeds)
    alone.generate()
    assert all(rows[k] == v for k, v in _rows(alone).items())
    assert (alone.layouts.status.numpy() == Status.VALID).all()


def test_every_object_is_in_every_row(hard: CompiledScene):
    """Nothing is switched off or parked anywhere when placement fails: all crates lie on the floor."""
    rows = make(hard, 200)
    for i in range(3):
        at = rows.qpos[:, 7 * i : 7 * i + 3]
        assert (np.abs(at[:, :2]) <= 0.2).all()
        np.testing.assert_allclose(at[:, 2], 0.0005, atol=1e-6)


@pytest.mark.parametrize("restarts", [0, 3])
def test_rejections_and_attempts_add_up(restarts: int, tmp_path: Path):
    """Every candidate is accepted or counted once, by object and cause; the counts run on over resets."""
    crate = box_mjcf(tmp_path, "crate", 0.1, 0.14, 0.05)
    words = {"asset": crate, "on": "floor", "ratio_on_support": 1.0}
    objects = {"cabinet": {"asset": "cabinet", "kind": "fixture", "on": "floor", "joints": {"*": {"fraction": [0, 1]}}}}
    objects |= {f"crate_{i}": words for i in range(4)} | {"apple": {"asset": "apple", "on": "cabinet/lower_drawer"}}
    scene = {"floor": {"size": [0.8, 0.8]}, "attempts": 4, "restarts": restarts, "objects": objects}
    compiled = compile_on_cpu(scene)
    generator = LayoutGenerator(compiled, 300, seed=4)
    attempts = np.zeros(300, int)
    for _ in range(2):
        generator.generate()
        attempts += generator.layouts.attempts.numpy()
    counts = generator.layouts.rejections.numpy()
    status, first = generator.layouts.status.numpy(), generator.layouts.first_pass_valid.numpy()
    assert (status[first == 1] == Status.VALID).all()
    last = generator.layouts.attempts.numpy()
    assert (last[first == 1] <= 6 * 4).all()
    assert last.max() <= 6 * 4 * (restarts + 1)
    assert 0 < first.sum() < 300
    if restarts == 0:
        assert ((status == Status.VALID) == (first == 1)).all()
    else:
        assert (status == Status.VALID).sum() > first.sum()
    named = generator.rejection_counts()
    assert list(named) == list(compiled.placed)
    for i, name in enumerate(compiled.placed):
        causes = [c for c in Cause if c not in (Cause.NONE, Cause.UNSOUND, *REACH_CAUSES)]
        assert named[name] == {c.name.lower(): counts[i, c] for c in causes}
    assert counts[:, Cause.NONE].sum() == 0
    assert {c for c in Cause if counts[:, c].any()} == {Cause.ROOF, Cause.FOOTPRINT, Cause.COLLISION}
    assert attempts.sum() - counts.sum() >= 6 * (status == Status.VALID).sum()


def test_each_world_accounts_for_its_attempts(hard: CompiledScene, mid: CompiledScene):
    """One acceptance for each object that was placed; a world that fails has one object with no attempt left."""
    for compiled in (hard, mid):
        most, total = compiled.config.attempts, 0
        generator = LayoutGenerator(compiled, 1, seed=0)
        for _ in range(100):
            before = generator.layouts.rejections.numpy().sum(axis=1)
            generator.generate()
            rejected = generator.layouts.rejections.numpy().sum(axis=1) - before
            attempts = int(generator.layouts.attempts.numpy()[0])
            if generator.layouts.first_pass_valid.numpy()[0]:
                total += 1
                assert (rejected < most).all()
                assert attempts == len(compiled.placed) + rejected.sum()
            elif compiled.config.restarts == 0:
                failed = int(np.flatnonzero(rejected)[-1])
                assert rejected[failed] == most
                assert attempts == failed + rejected.sum()
        assert total > 10


def test_the_record_of_rejected_candidates_is_bounded_and_changes_no_layout(mid: CompiledScene):
    """Room for ten: the count runs on, the rows do not, and the layouts are those without a record."""
    generator = LayoutGenerator(mid, 200, seed=6, rejected=10)
    generator.generate()
    collisions = generator.layouts.rejections.numpy()[:, Cause.COLLISION].sum()
    assert generator.layouts.view.rejected_count.numpy()[0] == collisions > 10
    assert generator.layouts.view.rejected_qpos.shape[0] == 10
    assert _rows(generator) == _rows_of(mid, 6, 200)


def test_the_streams_of_objects_follow_their_place_in_the_file(tmp_path: Path):
    """A change of a later object leaves the draws of an earlier one alone."""
    crate = box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.05)
    one = {"asset": crate, "on": "floor"}
    alone = make(compile_on_cpu({"floor": FLOOR, "objects": {"a": one}}), 50)
    both = make(compile_on_cpu({"floor": FLOOR, "objects": {"a": one, "b": {**one, "gap": 0.3}}}), 50)
    assert (alone.qpos[:, :7] == both.qpos[:, :7]).all()
    assert not np.allclose(both.qpos[:, :2], both.qpos[:, 7:9])


def test_generation_runs_in_a_captured_graph(mid: CompiledScene):
    """Captured once and replayed, it makes the layouts of one episode after the other."""
    expected = _by_id(mid, [21, 22], 3)
    generator = LayoutGenerator(mid, 2, seed=21)
    with wp.ScopedCapture(device="cpu") as capture:
        generator.generate()
    generator.reseed(21)
    for episode in range(3):
        wp.capture_launch(capture.graph)
        assert {k[1] for k in _rows(generator)} == {episode}
        assert all(expected[k] == v for k, v in _rows(generator).items())


@pytest.mark.parametrize(
    ("mask", "error"),
    [(wp.zeros(2, dtype=wp.bool, device="cpu"), MaskError), (wp.zeros(4, dtype=int, device="cpu"), MaskTypeError)],
    ids=["too short", "of integers"],
)
def test_a_wrong_mask_is_refused(mid: CompiledScene, mask: wp.array, error: type[Exception]):
    """By both methods that take one: a kernel would read beyond its end."""
    generator = LayoutGenerator(mid, 4)
    for method in (generator.generate, lambda mask: generator.reseed(3, mask)):
        with pytest.raises(error, match="mask should"):
            method(mask)


@pytest.mark.cuda
def test_a_mask_on_another_device_is_copied():
    """A kernel could not read it there."""
    generator = LayoutGenerator(compile_scene("mid", "cuda:0"), 4)
    generator.generate(wp.array([True, False, False, True], dtype=wp.bool, device="cpu"))
    assert generator.layouts.episode.numpy().tolist() == [0, -1, -1, 0]
    generator.reseed(0, wp.zeros(4, dtype=wp.bool, device="cpu"))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ({"nworld": 10**13}, "nworld should be at most"),
        ({"nworld": 1.5}, "nworld should be an integer of at least 1, got 1.5"),
        ({"nworld": "3"}, "nworld should be an integer"),
        ({"nworld": True}, "nworld should be an integer"),
        ({"rejected": -1}, "rejected should be an integer of at least 0"),
        ({"split": []}, "unknown split"),
        ({"split": 10**5000}, "unknown split a int"),
        ({"seed": 10**5000}, "seed=a int should be"),
        ({"compiled": None}, "compiled should be a CompiledScene"),
    ],
)
def test_what_is_no_argument_is_refused_in_our_words(mid: CompiledScene, words: dict[str, Any], says: str):
    """Whatever its type; each is a ValueError, too."""
    given = {"compiled": mid, "nworld": 4, **words}
    with pytest.raises(ScenirisError, match=says) as found:
        LayoutGenerator(given.pop("compiled"), given.pop("nworld"), **given)
    assert isinstance(found.value, ValueError)


def test_a_batch_has_a_world_at_least(mid: CompiledScene):
    """None makes no sense."""
    with pytest.raises(CountError, match="nworld should be an integer of at least 1, got 0"):
        LayoutGenerator(mid, 0)
