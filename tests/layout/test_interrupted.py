"""Ctrl-C in the middle of a reset that is launched kernel by kernel: the next one gives what that one would have."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.pipeline import LayoutPipeline
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.crane import crane_map, crane_mjcf, crane_scene
from tests.layout.scenes import box_mjcf, prefetched

NWORLD = 12
Source = LayoutGenerator | LayoutPipeline


@pytest.fixture
def scenes(tmp_path: Path) -> list[CompiledScene]:
    """A scene with regions that relations leave and with restarts, and one with a stage after placing."""
    asset, cube = crane_mjcf(tmp_path), box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    crane = {**crane_scene(asset, cube, reachable="clear"), "bank": 4}
    return [compile_scene(scene, "cpu") for scene in ("hard_plus", crane)]


class Launches:
    """Counts launches, and interrupts one of them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.made, self.last = 0, -1
        for name in ("launch", "launch_tiled"):
            monkeypatch.setattr(wp, name, self._counted(getattr(wp, name)))

    def _counted(self, launch: Callable) -> Callable:
        def counted(*args: object, **kwargs: object) -> None:
            if self.made == self.last:
                raise KeyboardInterrupt
            self.made += 1
            launch(*args, **kwargs)

        return counted

    def number(self, function: Callable[[], None]) -> int:
        """Return the number of launches that a function makes."""
        self.made, self.last = 0, -1
        function()
        return self.made

    def interrupt(self, function: Callable[[], None], after: int) -> None:
        """Call a function that is interrupted after so many launches, if it makes more."""
        self.made, self.last = 0, after
        with suppress(KeyboardInterrupt):
            function()
        self.last = -1


def _bits(source: Source, mask: wp.array) -> dict[str, bytes]:
    """The bits of what the masked worlds were served, and of what is counted. NaN is one value here."""
    names = ("qpos", "mocap_pos", "mocap_quat", "present", "grasp", "grasp_qpos", "pregrasp_qpos", "status", "attempts")
    which = np.flatnonzero(mask.numpy())
    served = {name: getattr(source.layouts, name).numpy()[which] for name in (*names, "first_pass_valid")}
    counted = {name: getattr(source.layouts, name).numpy() for name in ("seed", "episode", "rejections")}
    return {name: np.where(a == a, a, np.nan).tobytes() for name, a in (served | counted).items()}


def _named(source: Source) -> np.ndarray:
    """The seeds and episodes of the layouts, shape (2, nworld)."""
    return np.array([getattr(source.layouts, name).numpy().astype(np.int64) for name in ("seed", "episode")])


def _mask(rng: np.random.Generator, share: float) -> wp.array:
    return wp.array(rng.random(NWORLD) < share, dtype=wp.bool, device="cpu")


def _ahead(compiled: CompiledScene) -> tuple[Source, Callable[[wp.array], None]]:
    source = prefetched(LayoutGenerator(compiled, NWORLD, seed=3), graph=False)

    def reset(mask: wp.array) -> None:
        source.launch_generate(mask)
        source.after_reset()

    return source, reset


def _in_place(compiled: CompiledScene) -> tuple[Source, Callable[[wp.array], None]]:
    source = LayoutGenerator(compiled, NWORLD, seed=3)
    return source, source.launch_generate


@pytest.mark.parametrize("way", [_ahead, _in_place])
def test_an_interrupted_reset_did_not_happen_or_was_done(
    scenes: list[CompiledScene], way: Callable, monkeypatch: pytest.MonkeyPatch
):
    """Wherever it is interrupted, whichever worlds are reset next: bits and counts are those without it, or with it.

    It was done where all of it was launched, and perhaps layouts ahead of later ones were being made already.
    """
    launches = Launches(monkeypatch)
    rng = np.random.default_rng(0)
    for compiled in scenes:
        plain = LayoutGenerator(compiled, NWORLD, seed=3)
        source, reset = way(compiled)
        spare = way(compiled)[1]
        number = launches.number(lambda reset=spare: reset(_mask(rng, 1.0)))
        done = []
        for step in range(60):
            first, mask = _mask(rng, 0.8), _mask(rng, 0.6)
            before = _named(source)
            after = int(rng.integers(8 if step % 2 else number))
            launches.interrupt(lambda reset=reset, mask=first: reset(mask), after)
            advanced = (_named(source) != before).any(axis=0)
            done.append(bool(advanced.any()))
            if done[-1]:
                assert (advanced == first.numpy()).all()
                plain.launch_generate(first)
            if step % 10 == 9:  # new seeds, and episodes as an evaluation chooses them
                for one in (source, plain):
                    one.reseed(layouts={"seed": np.arange(step, step + NWORLD), "episode": step % 3})
            reset(mask)
            plain.launch_generate(mask)
            assert _bits(source, mask) == _bits(plain, mask), f"step {step}"
        assert any(done) and not all(done)
