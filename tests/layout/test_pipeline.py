"""A maker, prefetching and a chooser in one pipeline: what is asked for is served, made ahead or not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import warp as wp

from sceniris_gym.errors import FixedError, ScenirisError
from sceniris_gym.layout.ahead import Ahead
from sceniris_gym.layout.columns import columns
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.layout.pipeline import Chooser, LayoutPipeline
from sceniris_gym.layout.seeds import launch_open
from sceniris_gym.levels import LevelReplay
from sceniris_gym.levels.sampler import LevelSampler
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import compile_on_cpu, prefetched

NWORLD = 3


class Backwards(Chooser):
    """A chooser of somebody's own: each world goes from episode 9 of a seed back to its beginning."""

    def __init__(self, layouts: Layouts) -> None:
        self.layouts, self.heard, self.next = layouts, [], np.full(NWORLD, 9)

    def launch_choose(self, mask: wp.array | None) -> None:
        """Choose the episode before."""
        chosen = np.ones(NWORLD, bool) if mask is None else mask.numpy()
        self.next = np.where(chosen, np.maximum(self.next - 1, 0), self.next)
        self._ask()

    def launch_forget(self, seeds: wp.array | None, mask: wp.array | None) -> None:
        """Begin again."""
        self.heard.append("forget")
        self.next[:] = 9
        self._ask()

    def launch_set_params(self, columns: wp.array, values: wp.array, mask: wp.array | None) -> None:
        """Hear it."""
        self.heard.append("set_params")

    def launch_finish(self, success: wp.array, finished: wp.array) -> None:
        """Hear it."""
        self.heard.append("finish")

    def after_reset(self) -> None:
        """Hear it."""
        self.heard.append("after_reset")

    def _ask(self) -> None:
        self.layouts.view.next_seed.assign(self.layouts.view.seed.numpy() * 0 + np.arange(30, 30 + NWORLD))
        self.layouts.view.next_episode.assign(self.next)


@pytest.fixture(scope="module")
def mid() -> CompiledScene:
    """The shipped scene `mid`."""
    return compile_on_cpu("mid")


@pytest.mark.parametrize("ahead", [False, True])
def test_worlds_get_what_a_chooser_asks_for(mid: CompiledScene, ahead: bool):
    """The layouts of these seeds and episodes as another generator has them; the chooser hears of all that happens."""
    maker = LayoutGenerator(mid, NWORLD, seed=30, params="objects.*.region")
    chooser, other = Backwards(maker.layouts), LayoutGenerator(mid, NWORLD, seed=30)
    pipeline = LayoutPipeline(maker, ahead=prefetched(maker).ahead if ahead else None, chooser=chooser)
    pipeline.reseed(seed=30)
    for episode in (9, 8, 7):
        pipeline.launch_generate(None)
        pipeline.after_reset()
        assert pipeline.layouts.episode.numpy().tolist() == [episode] * NWORLD
        other.reseed(layouts={"seed": np.arange(30, 30 + NWORLD), "episode": episode})
        other.generate()
        np.testing.assert_array_equal(pipeline.layouts.qpos.numpy(), other.layouts.qpos.numpy())
    pipeline.launch_generate(wp.array([True, False, False], dtype=wp.bool, device="cpu"))
    assert pipeline.layouts.episode.numpy().tolist() == [6, 7, 7]
    name, row = next(iter(maker.layouts.params.named(maker.layouts.params.default[None]).items()))
    pipeline.set_params({name: row[0]})
    assert chooser.heard == ["forget", *["after_reset"] * 3, "set_params"]


def test_a_key_is_opened_without_touching_what_is_served(mid: CompiledScene):
    """Key and parts of each row stay to the bit until the next layout is made."""
    generator = LayoutGenerator(mid, NWORLD, seed=4)
    generator.generate()
    names = columns("key", "pose", "grasp", "count")
    before = {name: getattr(generator.layouts, name).numpy().tobytes() for name in names}
    launch_open(generator.layouts.view, wp.array([True, False, True], dtype=wp.bool, device="cpu"))
    assert {name: getattr(generator.layouts, name).numpy().tobytes() for name in names} == before
    assert generator.layouts.view.pending_episode.numpy().tolist() == [1, 0, 1]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (lambda maker, other: {"maker": 3}, "maker should be a LayoutSource"),
        (lambda maker, other: {"ahead": True}, "ahead should be a Ahead"),
        (lambda maker, other: {"ahead": Ahead(other)}, r"ahead should be made from the same maker: Ahead\(maker\)"),
        (lambda maker, other: {"chooser": 3}, "chooser should be a Chooser"),
        (lambda maker, other: {"chooser": LevelSampler(LevelReplay(), other.layouts)}, "belongs to another maker"),
        (lambda maker, other: {"split": "bogus"}, "split should be train, got 'bogus'"),
        (lambda maker, other: {"split": "eval"}, "split should be train, got 'eval'"),
    ],
)
def test_parts_that_do_not_fit_are_refused(mid: CompiledScene, words: Callable[..., dict], message: str):
    """Another type, another maker's, or another split than the maker's own."""
    maker, other = LayoutGenerator(mid, NWORLD), LayoutGenerator(mid, NWORLD + 1)
    with pytest.raises(ScenirisError, match=f"LayoutPipeline: .*{message}"):
        LayoutPipeline(**{"maker": maker, **words(maker, other)})  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize("twin", ["self", "none", "worlds", "split", "params"])
def test_a_twin_that_makes_other_layouts_is_refused(mid: CompiledScene, twin: str):
    """Its rows would be copied into those of the maker."""
    twins: dict[str, Any] = {
        "worlds": LayoutGenerator(mid, NWORLD - 1),
        "split": LayoutGenerator(mid, NWORLD, split="eval"),
        "params": LayoutGenerator(mid, NWORLD, params="objects.*.region"),
        "none": None,
    }

    class Own(LayoutGenerator):
        def twin(self) -> Any:
            """Return another, or itself."""
            return twins.get(twin, self)

    with pytest.raises(ScenirisError, match=r"Ahead: maker\.twin\(\) should"):
        Ahead(Own(mid, NWORLD))


def test_the_parts_of_a_pipeline_cannot_be_exchanged(mid: CompiledScene):
    """Captured resets would not see it."""
    pipeline = LayoutPipeline(LayoutGenerator(mid, NWORLD, split="eval"))
    assert pipeline.split == "eval"
    for name in LayoutPipeline._FIXED:
        with pytest.raises(FixedError, match=rf"LayoutPipeline\.{name}"):
            setattr(pipeline, name, None)
