"""Scenes of a thousand objects compile."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from tests.layout.scenes import box_mjcf


@pytest.mark.slow
def test_a_thousand_objects_of_a_hundred_kinds_among_a_thousand_geoms(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """They are placed apart, and nothing appears in the working folder."""
    working = tmp_path / "working"
    working.mkdir()
    monkeypatch.chdir(working)
    sizes = 0.04 + 0.0004 * np.arange(100)
    kinds = [box_mjcf(tmp_path, f"kind{i}", size, size, size) for i, size in enumerate(sizes)]
    spots = np.random.default_rng(0).uniform(-5.0, 5.0, (1000, 2))
    posts = "".join(f'<geom type="box" size=".02 .02 .3" pos="{x} {y} .3"/>' for x, y in spots)
    (tmp_path / "room.xml").write_text(f"<mujoco><worldbody>{posts}</worldbody></mujoco>")
    objects = {
        f"thing{i}": {"asset": kinds[i % 100], "on": "floor", "orientation": {"yaw": [0, 0]}} for i in range(1000)
    }
    scene = {"floor": {"size": [10, 10]}, "model": str(tmp_path / "room.xml"), "objects": objects, "bank": 2}
    compiled = compile_scene(scene, "cpu", cache=False)
    generator = LayoutGenerator(compiled, 1)
    generator.generate()
    assert generator.layouts.status.numpy()[0] == LayoutStatus.VALID
    places = np.array([generator.layouts.pose(name)[0, :2].numpy() for name in compiled.object_names])
    half = np.array([sizes[i % 100] / 2 for i in range(1000)])
    apart = np.abs(places[:, None] - places[None]).max(axis=2) - half[:, None] - half[None]
    np.fill_diagonal(apart, 1.0)
    assert apart.min() > 0.0
    assert (np.abs(places[:, None] - spots[None]).max(axis=2) > half[:, None] + 0.02).all()
    assert not list(working.iterdir())
