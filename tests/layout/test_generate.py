"""Layouts as pure functions of their seeds, the bank as the last resort, and what is counted on the way."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, ScenirisError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import REACH_CAUSES, Cause
from sceniris_gym.scene.build import build_model
from tests.layout.scenes import FLOOR, box_mjcf, compile_on_cpu, full_tray, make, prefetched, read


@pytest.fixture(scope="module", params=["physics", "visual"])
def mid(request) -> CompiledScene:
    """The shipped scene `mid`, with both kinds of geometry."""
    return compile_on_cpu("mid", {"geometry": request.param})


@pytest.fixture(scope="module")
def hard(tmp_path_factory) -> CompiledScene:
    """A tray on which most worlds fall back."""
    return full_tray(tmp_path_factory.mktemp("hard"))


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
    generator.reseed(seed=77)
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
    generator.reseed(seed=0)
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
    assert generator.layouts.view.seed.numpy().tolist() == seeds
    assert len({bytes(row.tobytes()) for row in generator.layouts.qpos.numpy()}) == 4


def test_reseeding_starts_the_masked_worlds_at_episode_zero(mid: CompiledScene):
    """The others keep their seeds and go on; seeds on the device and on the host mean the same."""
    generator = LayoutGenerator(mid, 4, seed=10)
    for _ in range(2):
        generator.generate()
    mask = _mask([False, True, False, True])
    generator.reseed(mask, seed=[100, 101, 102, 103])
    assert generator.layouts.seed.numpy().tolist() == [10, 11, 12, 13]  # of the layouts that are there
    assert generator.layouts.episode.numpy().tolist() == [1] * 4
    generator.generate()
    assert generator.layouts.seed.numpy().tolist() == [10, 101, 12, 103]
    assert generator.layouts.episode.numpy().tolist() == [2, 0, 2, 0]
    expected = _by_id(mid, [10, 12], 3) | _by_id(mid, [101, 103], 1)
    assert all(expected[k] == v for k, v in _rows(generator).items())
    generator.reseed(mask, seed=wp.array(np.array([1, 2, 3, 4], np.uint64), dtype=wp.uint64, device="cpu"))
    generator.generate()
    assert generator.layouts.seed.numpy().tolist() == [10, 2, 12, 4]


@pytest.mark.parametrize("make", [LayoutGenerator, lambda *args: prefetched(LayoutGenerator(*args), graph=False)])
def test_episodes_are_chosen_and_worlds_go_on_from_there(mid: CompiledScene, make: Callable):
    """With new seeds or the present ones, one episode for all or one for each; the others go on as they would have."""
    source = make(mid, 4)
    source.generate()
    source.reseed(_mask([True, False, True, False]), layouts={"seed": [7, 8, 9, 10], "episode": [4, 0, 2, 0]})
    source.generate()
    expected = _by_id(mid, [7], 5) | _by_id(mid, [9], 3) | _by_id(mid, [1, 3], 2)
    assert all(expected[k] == v for k, v in _rows(source).items())
    source.reseed(layouts={"seed": source.layouts.seed.numpy(), "episode": 1})
    source.generate()
    source.generate(_mask([True, True, True, False]))
    assert source.layouts.episode.numpy().tolist() == [2, 2, 2, 1]
    assert source.layouts.seed.numpy().tolist() == [7, 1, 9, 3]
    expected = _by_id(mid, [7, 1, 9], 3) | _by_id(mid, [3], 2)
    assert all(expected[k] == v for k, v in _rows(source).items())


@pytest.mark.parametrize("episodes", [-1, 1 << 31, [0, 1], 0.5, "first"])
def test_wrong_episodes_are_refused(mid: CompiledScene, episodes: Any):
    """Negative, too large, not one for each world, or no integers."""
    with pytest.raises(ArgumentError, match=r"layouts(\['episode'\])? should"):
        LayoutGenerator(mid, 4).reseed(layouts={"seed": 0, "episode": episodes})


def test_an_unknown_split_is_refused(mid: CompiledScene):
    """The message lists the valid ones."""
    with pytest.raises(ValueError, match="train, eval"):
        LayoutGenerator(mid, 1, split="test")


def test_the_size_of_the_bank_is_part_of_the_scene(hard: CompiledScene):
    """Another size is another hash, and changes the worlds that fall back alone; the default leaves the hash."""
    other = compile_scene(SceneConfig.load(hard.config, {"bank": 17}), "cpu")
    assert other.hash != hard.hash
    rows, others = make(hard, 400), make(other, 400)
    fallen = rows.status == LayoutStatus.FALLBACK
    assert (rows.qpos == others.qpos)[~fallen].all()
    assert (rows.qpos != others.qpos)[fallen].any(axis=1).mean() > 0.8
    plain = SceneConfig.load("mid")
    assert build_model(SceneConfig.load(plain, {"bank": 64})).hash == build_model(plain).hash


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
    assert (status[first == 1] == LayoutStatus.VALID).all()
    last = generator.layouts.attempts.numpy()
    assert (last[first == 1] <= 6 * 4).all()
    assert last.max() <= 6 * 4 * (restarts + 1)
    assert 0 < first.sum() < 300
    if restarts == 0:
        assert ((status == LayoutStatus.VALID) == (first == 1)).all()
    else:
        assert (status == LayoutStatus.VALID).sum() > first.sum()
    named = generator.rejection_counts()
    assert list(named) == list(compiled.placed)
    unknown = (Cause.NONE, Cause.UNSOUND, Cause.FALLS, *REACH_CAUSES)  # nothing can fall here
    for i, name in enumerate(compiled.placed):
        causes = [c for c in Cause if c not in unknown]
        assert named[name] == {c.name.lower(): counts[i, c] for c in causes}
    assert counts[:, Cause.NONE].sum() == 0
    assert {c for c in Cause if counts[:, c].any()} == {Cause.OVERHEAD, Cause.FOOTPRINT, Cause.COLLISION}
    assert attempts.sum() - counts.sum() >= 6 * (status == LayoutStatus.VALID).sum()


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
    generator = LayoutGenerator._recording(mid, 200, seed=6, rejected=10)
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
    generator.reseed(seed=21)
    for episode in range(3):
        wp.capture_launch(capture.graph)
        assert {k[1] for k in _rows(generator)} == {episode}
        assert all(expected[k] == v for k, v in _rows(generator).items())


@pytest.mark.parametrize(
    ("mask", "error"),
    [
        (wp.zeros(2, dtype=wp.bool, device="cpu"), ArgumentError),
        (wp.zeros(4, dtype=int, device="cpu"), ArgumentError),
        (wp.zeros(4, dtype=float, device="cpu"), ArgumentTypeError),
    ],
    ids=["too short", "of integers that repeat", "of floats"],
)
def test_a_wrong_mask_is_refused(mid: CompiledScene, mask: wp.array, error: type[Exception]):
    """By both methods that take one: a kernel would read beyond its end."""
    generator = LayoutGenerator(mid, 4)
    for method in (generator.generate, lambda mask: generator.reseed(mask, seed=3)):
        with pytest.raises(error, match="worlds should"):
            method(mask)


@pytest.mark.cuda
def test_a_mask_on_another_device_is_copied():
    """A kernel could not read it there."""
    generator = LayoutGenerator(compile_scene("mid", "cuda:0"), 4)
    generator.generate(wp.array([True, False, False, True], dtype=wp.bool, device="cpu"))
    assert generator.layouts.episode.tolist() == [0, -1, -1, 0]
    generator.reseed(wp.zeros(4, dtype=wp.bool, device="cpu"), seed=0)


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
    given: dict[str, Any] = {"compiled": mid, "nworld": 4, **words}
    make = LayoutGenerator._recording if "rejected" in words else LayoutGenerator
    with pytest.raises(ScenirisError, match=says) as found:
        make(given.pop("compiled"), given.pop("nworld"), **given)
    assert isinstance(found.value, ValueError)


def test_a_size_of_another_type_is_refused(mid: CompiledScene):
    """The message names the argument and its type."""
    with pytest.raises(ArgumentTypeError, match="LayoutGenerator: size should be a SearchSize, got <class 'int'>"):
        LayoutGenerator(mid, 2, size=3)  # pyrefly: ignore[bad-argument-type]


def test_a_batch_has_a_world_at_least(mid: CompiledScene):
    """None makes no sense."""
    with pytest.raises(ArgumentError, match="nworld should be an integer of at least 1, got 0"):
        LayoutGenerator(mid, 0)
