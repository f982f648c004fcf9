"""Kernels that are compiled together: the ones that Warp loads later, without a launch before its time."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
import warp as wp

from sceniris_gym.device.loading import on_missing
from sceniris_gym.device.sequence import LaunchSequence, repeat_launches
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.wave.search import default_size
from sceniris_gym.progress import listening
from tests.device.loads import found, loaded
from tests.layout.grasped import cluttered

CPU = wp.get_device("cpu")


def adding(number: int) -> wp.Kernel:
    """Return a kernel with a module of its own, which adds a number and counts down."""

    @wp.kernel(module="unique", enable_backward=False)
    def add(left: wp.array[int], total: wp.array[int]):
        left[0] = left[0] - 1
        total[0] = total[0] + wp.static(number)

    return add


@pytest.mark.parametrize("name", ["mid", "mid_16k", "hard_plus", "clear"])
def test_all_that_a_generator_launches_is_compiled_together(name: str, tmp_path: Path):
    """A block that shares a candidate has several lanes, as on a GPU. Nothing is compiled in vain either."""
    compiled = cluttered(tmp_path, name) if name == "clear" else compile_scene(name, "cpu")
    generator = LayoutGenerator(compiled, 8, size=replace(default_size("cpu"), block_dim=32, narrow_pairs=4096))
    together = found(lambda: generator.launch_generate(None))
    assert together == loaded(lambda: generator.launch_generate(None))


@pytest.mark.parametrize(
    ("device", "direct"), [("cpu", 0), ("cpu", 3), pytest.param("cuda:0", 0, marks=pytest.mark.cuda)]
)
def test_the_first_replay_compiles_all_kernels_and_runs_each_as_often_as_later_ones(
    device: str, direct: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """With an empty cache, in a loop too, and whether or not a graph is captured at once, as on a GPU."""
    monkeypatch.setattr("sceniris_gym.device.sequence._DIRECT_ON_CPU", direct)
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    left, total = (wp.zeros(1, dtype=int, device=device) for _ in range(2))
    once, often, later = (adding(10 * direct + number) for number in (1, 2, 3))

    def launch(kernel: wp.Kernel) -> None:
        wp.launch(kernel, dim=1, inputs=[left, total])

    def launches() -> None:
        launch(once)
        repeat_launches(left, lambda: launch(often), 9)

    def all_launches() -> None:
        launches()
        launch(later)

    run = LaunchSequence(launches, wp.get_device(device))
    run.ahead = all_launches
    told: list[tuple] = []
    for call in (1, 2):
        left.fill_(4)
        with listening(lambda *words: told.append(words)):
            run.replay()
        assert (left.numpy()[0], total.numpy()[0]) == (0, call * (3 * (10 * direct + 2) + 10 * direct + 1))
        assert told == [("compiling kernels", done, 3) for done in (1, 2, 3)]
        assert len(list(tmp_path.iterdir())) == 3


def test_a_launch_of_another_thread_is_never_skipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Only the thread that looks for missing kernels leaves out its launches."""
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    left, total = (wp.zeros(1, dtype=int, device="cpu") for _ in range(2))
    here, there = adding(101), adding(102)
    missing: list = []
    with on_missing(missing.append), ThreadPoolExecutor(1) as pool:
        wp.launch(here, dim=1, inputs=[left, total], device="cpu")
        pool.submit(wp.launch, there, dim=1, inputs=[left, total], device="cpu").result()
    assert [module for module, _ in missing] == [here.module]
    assert total.numpy()[0] == 102


def test_only_the_number_of_blocks_of_a_missing_kernel_is_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """MuJoCo-Warp asks for it before a launch; Warp loads the kernel for this on a GPU, and may find none."""
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    kernel = adding(103)
    missing: list = []

    def suggest(kernel: wp.Kernel, device=None) -> tuple[int, int]:
        if kernel.module.load(device) is None:
            raise RuntimeError("Failed to load module")
        return 7, 7

    monkeypatch.setattr(wp, "get_suggested_block_size", suggest)
    with on_missing(missing.append):
        assert wp.get_suggested_block_size(kernel, CPU) == (1, 1)
    assert missing == [(kernel.module, kernel.module.options["block_dim"])]
    assert wp.get_suggested_block_size is suggest
