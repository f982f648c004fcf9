"""Compilation ahead of all modules that a generator launches on a GPU: recorded launches against their list."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import warp as wp

from sceniris_gym.device import kernel_log
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.loading import kernel_modules, load_kernels
from sceniris_gym.layout.wave.search import default_size
from tests.layout.grasped import cluttered


@pytest.mark.parametrize("name", ["mid", "mid_16k", "hard_plus", "clear"])
def test_all_that_is_launched_is_compiled_ahead(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A block that shares a candidate has several lanes, as on a GPU. Nothing is compiled in vain either."""
    compiled = cluttered(tmp_path, name) if name == "clear" else compile_scene(name, "cpu")
    generator = LayoutGenerator(compiled, 8, size=replace(default_size("cpu"), block_dim=32, narrow_pairs=4096))
    launched: set[wp.Module] = set()
    launch, launch_tiled = wp.launch, wp.launch_tiled

    def record(kernel: wp.Kernel, *args, **words):
        assert words["block_dim"] == 32
        launched.add(kernel.module)
        return launch(kernel, *args, **words)

    def record_tiled(kernel: wp.Kernel, *args, **words):
        assert words["block_dim"] == 32
        launched.add(kernel.module)
        return launch_tiled(kernel, *args, **words)

    monkeypatch.setattr(wp, "launch", record)
    monkeypatch.setattr(wp, "launch_tiled", record_tiled)
    generator.launch_generate(None)
    assert launched == set(kernel_modules(generator._work, staged=name == "clear"))


def test_it_is_said_before_kernels_are_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    """The notice counts the modules that Warp's cache lacks; there is none if it has them all."""
    generator = LayoutGenerator(compile_scene("mid", "cpu"), 1)
    generator.generate()
    monkeypatch.setattr(kernel_log, "_told", set())
    capsys.readouterr()
    load_kernels(generator._work, staged=False)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    load_kernels(generator._work, staged=False)
    number = len(kernel_modules(generator._work, staged=False))
    assert f": {number} modules of this package" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
