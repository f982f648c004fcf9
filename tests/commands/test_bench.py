"""Figures of a scene: shares counted again from the layouts, faces by trimesh, memory by the system."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from ruamel.yaml import YAML

from sceniris_gym.commands.bench import REPEATS, bench, faces, peak_bytes
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import MemoryLimitError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.checks import simulation
from tests.layout.crane import crane_map, crane_mjcf, crane_scene
from tests.layout.scenes import box_mjcf, compile_on_cpu, write_mjcf

WORLDS = 16


def test_shares_are_those_of_the_layouts_that_were_timed():
    """The last twenty episodes of four and twenty, made again; two attempts and no restart, so that some fail."""
    hard = {"attempts": 2, "restarts": 0}
    found = bench(SceneConfig.load("mid", hard), WORLDS, "cpu", 3)
    generator = LayoutGenerator(compile_on_cpu("mid", hard), WORLDS, seed=3)
    status, first, attempts = [], [], []
    for _ in range(4 + REPEATS):
        generator.generate()
        layouts = generator.layouts
        status.append(layouts.status.cpu().numpy().copy())
        first.append(layouts.first_pass_valid.cpu().numpy().copy())
        attempts.append(layouts.attempts.cpu().numpy().copy())
    timed = np.array(status[-REPEATS:])
    assert found["valid"] == (timed == LayoutStatus.VALID).mean() < 1.0
    assert found["fallbacks"] == (timed == LayoutStatus.FALLBACK).sum() > 0
    assert found["first_pass_valid"] == np.mean(first[-REPEATS:])
    assert found["candidates_per_layout"] == np.mean(attempts[-REPEATS:])
    assert (found["num_envs"], found["attempts"], found["restarts"]) == (WORLDS, 2, 0)
    for name in ("cold_s", "warm_s", "full_reset_us", "partial_reset_us"):
        assert found[name] > 0.0, name
    assert found["cold_s"] > found["warm_s"]
    assert "narrowing" not in found


def test_a_scene_to_be_reached_is_narrowed_and_drawn(tmp_path: Path):
    """The narrowing by `reachable` is among the figures, and the picture is where it was asked for."""
    asset, cube = crane_mjcf(tmp_path), box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    with (tmp_path / "ring.yaml").open("w") as stream:
        YAML().dump(crane_scene(asset, cube), stream)
    found = bench(SceneConfig.load(tmp_path / "ring.yaml"), WORLDS, "cpu", 0, picture=tmp_path / "ring.png")
    assert found["narrowing"]["thing"]["candidates"] <= WORLDS
    assert found["picture"] == str(tmp_path / "ring.png")
    assert Image.open(tmp_path / "ring.png").size[0] > 100


def test_faces_are_those_of_what_collides_or_is_seen(tmp_path: Path):
    """A box has twelve, a ball none, a mesh those of its hull or all that are drawn; other bodies are not told."""
    plate = '<asset><mesh name="plate" vertex="0 0 0  1 0 0  1 1 0  0 1 0  .3 .3 .2  .5 .5 .1" scale=".1 .1 .1"'
    plate += ' face="0 2 1  0 3 2  0 1 4  1 2 5  1 5 4  2 3 5  3 4 5  3 0 4"/></asset>'
    body = '<geom type="mesh" mesh="plate" group="2" contype="0" conaffinity="0"/><geom type="box" size=".01 .01 .01"/>'
    objects = {
        "sled": {"asset": write_mjcf(tmp_path, "sled", body, plate), "on": "floor", "stands": False},
        "ball": {"asset": write_mjcf(tmp_path, "ball", '<geom type="sphere" size=".02"/>'), "on": "floor"},
        "crate": {"asset": box_mjcf(tmp_path, "crate", 0.1, 0.1, 0.1), "on": "floor"},
    }
    scene = {"floor": {"size": [2.0, 2.0]}, "objects": objects}
    assert faces(compile_on_cpu(scene)) == {"sled": 12, "ball": 0, "crate": 12}
    assert faces(compile_on_cpu(scene, {"geometry": "visual"})) == {"sled": 20, "ball": 0, "crate": 12}


def test_on_a_cpu_the_peak_is_that_of_the_process():
    """As Linux has it in /proc."""
    (line,) = [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")]
    assert peak_bytes("cpu") == pytest.approx(int(line.split()[1]) * 1024, rel=0.02)


def test_memory_is_told_before_it_is_measured_or_refused(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    """With the number of worlds; more than fit are refused with the greatest number."""
    monkeypatch.setattr(simulation, "free_memory", lambda device: 1 << 30)
    with pytest.raises(MemoryLimitError, match=r"100,000 worlds: takes .* GiB or more.*\(at most (\d+,)*\d+\)"):
        bench(SceneConfig.load("mid"), 100_000, "cpu", 0)
    assert "take" not in capsys.readouterr().err
    monkeypatch.setattr("sceniris_gym.commands.bench.LayoutGenerator", _stop)
    with pytest.raises(InterruptedError):
        bench(SceneConfig.load("mid"), WORLDS, "cpu", 0)
    assert capsys.readouterr().err == "16 worlds take 0.00 GiB of 1.00 GiB free on cpu.\n"


def _stop(*args: object, **options: object) -> None:
    raise InterruptedError
