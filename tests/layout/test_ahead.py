"""Layouts that are made ahead are those that would be made in place, whatever is reset, reseeded or captured."""

from __future__ import annotations

import gc
import itertools
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.device.sequence import LaunchSequence
from sceniris_gym.errors import ArgumentError, ArgumentTypeError
from sceniris_gym.layout import ahead
from sceniris_gym.layout.ahead import Ahead
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.pipeline import LayoutPipeline
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.crane import crane_map, crane_mjcf, crane_scene
from tests.layout.scenes import box_mjcf, prefetched

NWORLD = 24
MADE = ("seed", "episode", "qpos", "mocap_pos", "mocap_quat", "present", "grasp", "grasp_qpos", "pregrasp_qpos")
COUNTED = ("status", "attempts", "first_pass_valid")


def _crane(folder: Path, device: str) -> CompiledScene:
    """A crane that is to reach a cube clear of all else, and another cube that is there or not."""
    asset, cube = crane_mjcf(folder), box_mjcf(folder, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    scene = crane_scene(asset, cube, reachable="clear")
    scene["objects"]["other"] = {"asset": cube, "on": "floor", "reachable": "map"}
    scene["groups"] = {"some": {"of": ["other"], "count": [0, 1]}}
    return compile_scene({**scene, "bank": 4}, device)


def _bits(source: LayoutGenerator | LayoutPipeline) -> dict[str, bytes]:
    """The bits of all that is made. NaN is one value here: joints that are not solved have either sign of it."""
    made = {name: getattr(source.layouts, name).cpu().numpy() for name in (*MADE, *COUNTED)}
    return {name: np.where(values == values, values, np.nan).tobytes() for name, values in made.items()}


def _reset(source: LayoutPipeline, launches: Callable[[], None]) -> None:
    """Make the launches of a reset, and prefetch, as a randomizer does."""
    launches()
    source.after_reset()


def _same(compiled: CompiledScene, graph: bool) -> None:
    """Compare both sources over resets of some worlds, of none and of all, with new seeds in between."""
    rng, device = np.random.default_rng(0), wp.get_device(compiled.device)
    plain = LayoutGenerator(compiled, NWORLD, seed=5)
    source = prefetched(LayoutGenerator(compiled, NWORLD, seed=5))
    mask = wp.zeros(NWORLD, dtype=wp.bool, device=device)
    launches = LaunchSequence(lambda: source.launch_generate(mask), device, graph=graph).replay
    for step in range(24):
        chosen = rng.random(NWORLD) < (1.0, 0.0, 0.1, 0.6)[step % 4]
        if step % 5 == 4:  # also back to seeds whose layouts were made already
            some = rng.random(NWORLD) < 0.5
            which = wp.array(some, dtype=wp.bool, device=device)
            seeds = wp.array(rng.integers(0, 40, NWORLD), dtype=wp.uint64, device=device)
            plain.launch_reseed(seeds, which)
            source.launch_reseed(seeds, which)
        mask.assign(chosen)
        plain.generate(mask)
        _reset(source, launches)
        if step % 6 == 5:  # twice in a row, before anything made ahead is done
            plain.generate(mask)
            _reset(source, launches)
        assert _bits(plain) == _bits(source), f"step {step}"


@pytest.mark.usefixtures("recorded")
@pytest.mark.parametrize("graph", [True, False])
def test_layouts_made_ahead_are_those_made_in_place(tmp_path: Path, graph: bool):
    """Bit for bit, of two scenes: one with a stage after placing, one with regions that relations leave."""
    _same(_crane(tmp_path, "cpu"), graph)
    _same(compile_scene("hard_plus", "cpu"), graph)


@pytest.mark.usefixtures("recorded")
@pytest.mark.cuda
@pytest.mark.parametrize("graph", [True, False])
def test_layouts_made_ahead_on_a_gpu_are_those_made_in_place(tmp_path: Path, graph: bool):
    """The same with two streams."""
    _same(_crane(tmp_path, "cuda:0"), graph)
    _same(compile_scene("hard_plus", "cuda:0"), graph)


@pytest.mark.cuda
def test_prefetches_are_launched_where_the_device_decides_on_them(monkeypatch: pytest.MonkeyPatch):
    """Seldom where a few worlds are reset, and for every reset of all worlds, also after resets of a few."""
    compiled, replay, launched = compile_scene("hard_plus", "cuda:0"), LaunchSequence.replay, []
    monkeypatch.setattr(LaunchSequence, "replay", lambda self: (launched.append(self.priority), replay(self)))
    source = prefetched(LayoutGenerator(compiled, NWORLD, seed=5))
    masks = torch.eye(NWORLD, dtype=torch.bool, device="cuda:0")
    in_place = []
    for number in range(130):
        mask = masks[number % NWORLD] if number < 120 else torch.ones_like(masks[0])
        _reset(source, lambda mask=mask: source.launch_generate(wp.from_torch(mask)))
        torch.cuda.synchronize()
        in_place.append(int(wp.to_torch(source.ahead.missing).sum()))
        if number == 119:
            assert 0 < launched.count(-1) < 60
    assert not any(in_place[NWORLD:120])
    assert not any(in_place[124:]), in_place


@pytest.mark.cuda
def test_layouts_are_made_ahead_on_another_gpu():
    """Not the one that Warp and torch take where they are not told."""
    if wp.get_cuda_device_count() < 2:
        pytest.skip("needs two GPUs, and there is one here")
    _same(compile_scene("hard_plus", "cuda:1"), True)


@pytest.mark.cuda
def test_a_reset_without_graphs_is_made_up_for_on_a_gpu(monkeypatch: pytest.MonkeyPatch):
    """After an interruption on either stream the next resets have the bits of an uninterrupted generator."""
    compiled, launch, left = compile_scene("hard_plus", "cuda:0"), wp.launch, [0]

    def counted(*args: object, **kwargs: object) -> None:
        left[0] -= 1
        if left[0] == 0:
            raise KeyboardInterrupt
        launch(*args, **kwargs)

    monkeypatch.setattr(wp, "launch", counted)
    plain = LayoutGenerator(compiled, NWORLD, seed=5)
    source = prefetched(LayoutGenerator(compiled, NWORLD, seed=5), graph=False)
    for after in range(3, 120, 9):
        before, left[0] = source.layouts.episode.cpu().numpy(), after
        with suppress(KeyboardInterrupt):
            _reset(source, lambda: source.launch_generate(None))
        left[0] = 0
        for _ in range(1 + int(source.layouts.episode.cpu().numpy()[0] != before[0])):
            plain.launch_generate(None)
        _reset(source, lambda: source.launch_generate(None))
        assert _bits(plain) == _bits(source), f"after {after} launches"


def test_nobody_waits_for_what_is_being_made(monkeypatch: pytest.MonkeyPatch):
    """A layout that is not done is made in place, with the same bits, and nothing is begun until then."""
    make, asked, due = Ahead._make_beside, itertools.count(), []

    def late(source: Ahead) -> None:
        due.append(int(source._due.numpy()[0]))
        if next(asked) % 3 == 2:
            make(source)

    monkeypatch.setattr(Ahead, "_make_beside", late)
    _same(compile_scene("hard_plus", "cpu"), True)
    assert sum(due) > 20


def test_what_is_ready_is_not_made_again():
    """Nothing is missing in a second reset, or where a world was not reset; after new seeds it is."""
    compiled = compile_scene("mid", "cpu")
    source = prefetched(LayoutGenerator(compiled, NWORLD))
    mask = wp.ones(NWORLD, dtype=wp.bool, device="cpu")
    missing = []
    for step in range(4):
        if step == 3:
            source.launch_reseed(wp.array(np.arange(100, 100 + NWORLD), dtype=wp.uint64, device="cpu"), None)
        mask.assign(np.arange(NWORLD) % (step + 1) == 0)
        source.generate(mask)
        missing.append(int(source.ahead.missing.numpy().sum()))
    assert missing == [NWORLD, 0, 0, NWORLD // 4]


def test_params_that_are_set_to_what_they_are_leave_what_is_ready():
    """A curriculum sets them at every reset; other numbers make it stale."""
    source = prefetched(LayoutGenerator(compile_scene("mid", "cpu"), NWORLD, params="objects.apple.region"))
    (name, rows) = next(iter(source.layouts.params.named(source.layouts.params.default[None]).items()))
    missing = []
    for row in (rows[0], rows[0], 0.5 * rows[0]):
        source.set_params({name: row})
        source.generate()
        missing.append(int(source.ahead.missing.numpy().sum()))
    assert missing == [NWORLD, 0, NWORLD]


@pytest.mark.parametrize("last", ["_begin", "_publish"])
def test_an_interrupted_reset_is_made_up_for(last: str, monkeypatch: pytest.MonkeyPatch):
    """A reset is interrupted before layouts ahead are launched, or after worlds are chosen; the next is right."""
    source = prefetched(LayoutGenerator(compile_scene("mid", "cpu"), NWORLD))
    launch = wp.launch

    def interrupted(kernel: wp.Kernel, *args: object, **kwargs: object) -> None:
        if kernel is getattr(ahead, last):
            raise KeyboardInterrupt
        launch(kernel, *args, **kwargs)

    monkeypatch.setattr(wp, "launch", interrupted)
    with pytest.raises(KeyboardInterrupt):
        _reset(source, lambda: source.launch_generate(None))
    monkeypatch.setattr(wp, "launch", launch)
    source.generate(wp.zeros(NWORLD, dtype=wp.bool, device="cpu"))
    for _ in range(2):
        source.generate()
        assert not source.ahead.missing.numpy().any()


def _not_ahead(source: Any, *worlds: int) -> list[int]:
    """Reset these worlds, and return those whose next layouts are not made yet."""
    source.generate(np.isin(np.arange(NWORLD), worlds))
    made = source.ahead._ahead.layouts.episode.cpu().numpy() - source.layouts.episode.cpu().numpy()
    return np.flatnonzero(made != 1).tolist()


def test_few_worlds_wait_until_more_are_reset():
    """One of 24 waits until seven do, or until it has waited for 32 resets of other worlds or of none."""
    source = prefetched(LayoutGenerator(compile_scene("mid", "cpu"), NWORLD))
    assert _not_ahead(source, *range(NWORLD)) == []
    assert _not_ahead(source, 3) == [3]
    assert _not_ahead(source, 7, 9, 10, 20, 21) == [3, 7, 9, 10, 20, 21]
    assert _not_ahead(source, 8) == []
    for _ in range(40):
        assert _not_ahead(source) == []
    assert [_not_ahead(source, 5), *(_not_ahead(source) for _ in range(31))] == [[5]] * 31 + [[]]


def test_more_worlds_wait_until_one_is_missed():
    """Up to 16 of 24 wait for each other, and six again once a world was reset that waited."""
    source = prefetched(LayoutGenerator(compile_scene("mid", "cpu"), NWORLD))
    _not_ahead(source, *range(NWORLD))
    found = []
    for _ in range(40):
        found.append(next(n for n in range(NWORLD) if not _not_ahead(source, n)) + 1)
    assert found[:6] == [7, 7, 8, 8, 8, 9]
    assert found[-14:] == [16] * 14
    assert _not_ahead(source, 3) == [3]
    assert _not_ahead(source, 3) == [3]
    assert _not_ahead(source, 7, 9, 10, 20) == [3, 7, 9, 10, 20]
    assert _not_ahead(source, 22) == []


def test_memory_is_kept_until_all_that_writes_to_it_is_done(monkeypatch: pytest.MonkeyPatch):
    """Also where the garbage collector finds source and generator in one cycle, and frees its parts in any order."""
    generator = LayoutGenerator(compile_scene("mid", "cpu"), 4)
    array, freed, order = generator._work.search.cause, wp.array.__del__, []
    address = array.ptr

    def free(self: wp.array) -> None:
        order.extend(["freed"] * (getattr(self, "ptr", None) == address and bool(getattr(self, "deleter", None))))
        freed(self)

    monkeypatch.setattr(wp.array, "__del__", free)
    monkeypatch.setattr(ahead, "_wait", lambda *_: order.append("waited"))
    source = prefetched(generator)
    cycle = [source, generator]
    cycle.append(cycle)
    del array, generator, source, cycle
    for _ in range(2):
        gc.collect()
    assert order == ["waited", "freed"]


def test_rejections_are_those_of_the_layouts_that_are_served():
    """In both places where they can be read: what is made twice counts once, what is never served does not count."""
    compiled = compile_scene("mid", "cpu")
    source, twin = prefetched(LayoutGenerator(compiled, NWORLD)), LayoutGenerator(compiled, NWORLD)
    for step in range(6):
        if step % 3 == 2:  # what was made ahead is made in vain
            for one in (source, twin):
                one.launch_reseed(wp.array(np.arange(step, step + NWORLD), dtype=wp.uint64, device="cpu"), None)
        source.generate()
        twin.generate()
        assert source.rejection_counts() == twin.rejection_counts()
        assert (source.layouts.rejections.cpu().numpy() == twin.layouts.rejections.cpu().numpy()).all()


def test_a_generator_that_nobody_can_stand_in_for_is_refused():
    """One of a class of its own, which may make other layouts, and one that records what it rejects; so is a stream."""
    compiled = compile_scene("mid", "cpu")

    class Own(LayoutGenerator):
        """A generator of a user's."""

    with pytest.raises(ArgumentTypeError, match="Own: cannot prefetch, as prefetching takes a second source"):
        Ahead(Own(compiled, 4))
    with pytest.raises(ArgumentTypeError, match="maker should be a LayoutSource, got"):
        Ahead(compiled)  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(ArgumentError, match="while it records rejected candidates"):
        Ahead(LayoutGenerator._recording(compiled, 4, rejected=8))
    with pytest.raises(ArgumentTypeError, match="stream should be a Stream, got"):
        Ahead(LayoutGenerator(compiled, 4), 0)
    elsewhere = Mock(spec=wp.Stream, device="cuda:1")
    with pytest.raises(ArgumentError, match="stream should be on cpu, got a stream on cuda:1"):
        Ahead(LayoutGenerator(compiled, 4), elsewhere)


def test_nothing_is_made_ahead_where_graphs_cannot_repeat_launches(monkeypatch: pytest.MonkeyPatch):
    """With an old driver a replay makes what was made before once more, also while it is served."""
    monkeypatch.setattr(ahead, "repeats_in_graphs", lambda _: False)
    source = prefetched(LayoutGenerator(compile_scene("mid", "cpu"), NWORLD))
    plain = LayoutGenerator(source.layouts.compiled, NWORLD)
    for _ in range(2):
        source.generate()
        plain.generate()
        assert (_bits(source), source.ahead.missing.numpy().all()) == (_bits(plain), True)


@pytest.mark.cuda
def test_a_captured_reset_is_not_disturbed_by_what_is_made_beside_it():
    """A graph of the caller's own, replayed in turn with resets outside of it, gives one layout after another."""
    compiled = compile_scene("hard_plus", "cuda:0")
    plain = LayoutGenerator(compiled, NWORLD, seed=5)
    source = prefetched(LayoutGenerator(compiled, NWORLD, seed=5))
    mask = wp.ones(NWORLD, dtype=wp.bool, device="cuda:0")
    reset = LaunchSequence(lambda: source.launch_generate(mask), wp.get_device("cuda:0")).replay
    _reset(source, reset)
    plain.generate(mask)
    stream = wp.Stream("cuda:0")
    with wp.ScopedStream(stream), wp.ScopedCapture("cuda:0") as capture:
        _reset(source, reset)
    for _ in range(4):
        with wp.ScopedStream(stream, sync_exit=True):
            wp.capture_launch(capture.graph)
        plain.generate(mask)
        assert _bits(plain) == _bits(source)
        _reset(source, reset)
        plain.generate(mask)
        assert _bits(plain) == _bits(source)


@pytest.mark.cuda
def test_what_is_made_ahead_and_the_steps_do_not_wait_for_each_other():
    """On torch's default stream too, which Warp alone would not let anything run beside."""
    device = wp.get_device("cuda:0")
    compiled = compile_scene("mid", "cuda:0")
    plain = LayoutGenerator(compiled, NWORLD, seed=5)
    source = prefetched(LayoutGenerator(compiled, NWORLD, seed=5))
    mask = wp.ones(NWORLD, dtype=wp.bool, device=device)
    reset = LaunchSequence(lambda: source.launch_generate(mask), device).replay
    with wp.ScopedStream(wp.stream_from_torch(torch.cuda.default_stream()), sync_enter=False):
        _reset(source, reset)
        wp.synchronize_device(device)
        torch.cuda._sleep(500_000_000)  # cycles: about 0.3 s, so that the next reset is not done when another follows
        _reset(source, reset)
        torch.cuda._sleep(2_000_000_000)
        _reset(source, reset)
        beside, asleep = source.ahead._done, wp.record_event()
        time.sleep(0.7)
        assert beside is not None
        assert (beside.is_complete, asleep.is_complete) == (True, False)
        for _ in range(3):
            plain.generate(mask)
        assert _bits(plain) == _bits(source)


@pytest.mark.cuda
def test_the_next_layouts_are_made_after_a_reset_that_nothing_follows():
    """As in an evaluation, which resets all worlds together, and seldom."""
    device = wp.get_device("cuda:0")
    source = prefetched(LayoutGenerator(compile_scene("mid", "cuda:0"), NWORLD))
    missing = []
    for _ in range(3):
        wp.synchronize_device(device)  # also before the first reset, which may otherwise queue behind other programs
        source.generate()
        wp.synchronize_device(device)
        missing.append(int(source.ahead.missing.numpy().sum()))
    assert missing == [NWORLD, 0, 0]


@pytest.mark.cuda
def test_layouts_are_made_ahead_whatever_device_is_the_default_one():
    """Warp's functions for events mean the stream of that one."""
    compiled = compile_scene("mid", "cuda:0")
    with wp.ScopedDevice("cpu"):
        source = prefetched(LayoutGenerator(compiled, NWORLD))
        source.generate()
        source.rejection_counts()
    wp.synchronize_device("cuda:0")


@pytest.mark.cuda
def test_memory_is_kept_where_a_source_goes_while_something_is_captured():
    """Nobody may wait for an event then, and memory that is still written to must not be freed."""
    compiled = compile_scene("mid", "cuda:0")
    sources = [prefetched(LayoutGenerator(compiled, NWORLD)) for _ in range(2)]
    for source in sources:
        source.generate()
    del source
    gc.collect()  # sources of other tests
    with wp.ScopedStream(wp.Stream("cuda:0")), wp.ScopedCapture("cuda:0"):
        sources.pop()
        gc.collect()
        assert len(ahead._kept_longer) == 1
    sources.pop()
    gc.collect()
    assert not ahead._kept_longer
