"""A layout that no scene can be in is never served, whatever went wrong before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.layout.compile import _with_bank
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Status
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Program, copied
from tests.layout.scenes import FLOOR, box_mjcf, compile_on_cpu, read


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """A free cube, and a stand with a mocap root."""
    folder = tmp_path_factory.mktemp("sound")
    cube, stand = box_mjcf(folder, "cube", 0.04, 0.04, 0.04), box_mjcf(folder, "stand", 0.1, 0.1, 0.02)
    objects = {"stand": {"asset": stand, "kind": "fixture", "on": "floor"}, "cube": {"asset": cube, "on": "floor"}}
    return compile_on_cpu({"floor": FLOOR, "objects": objects}, bank=4)


def _with(compiled: CompiledScene, name: str, change: Callable[[np.ndarray], np.ndarray]) -> CompiledScene:
    program = copied(Program, compiled.program)
    field = getattr(program, name)
    setattr(program, name, wp.array(change(field.numpy()), dtype=field.dtype, device=compiled.device))
    return replace(compiled, program=program)


BROKEN = {
    "a height out of bounds": ("obj_gap", lambda x: np.full_like(x, 1e6)),
    "a turn of nan": ("obj_yaw", lambda x: np.full_like(x, np.nan)),
    "poses of no length": ("variant_quat", np.zeros_like),
    "a joint beyond what is drawn": ("bound_qpos", lambda x: 0.0 * x),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_what_is_not_sound_is_replaced_by_a_valid_layout(compiled: CompiledScene, kind: str):
    """The bank was made before it broke, so worlds fall back on it, and say so; the counts name the cause."""
    generator = LayoutGenerator(_with(compiled, *BROKEN[kind]), 32)
    generator.generate()
    rows = read(generator.layouts)
    assert (rows.status == Status.FALLBACK).all()
    assert np.isfinite(rows.qpos).all()
    assert (np.abs(rows.qpos[:, :3]) < 1.0).all()
    np.testing.assert_allclose(np.linalg.norm(rows.qpos[:, 3:], axis=1), 1.0, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(rows.mocap_quat, axis=2), 1.0, atol=1e-5)
    assert generator.rejection_counts()["cube"]["unsound"] == 32


def test_a_scene_without_a_sound_layout_is_refused(compiled: CompiledScene):
    """By the cause."""
    with pytest.raises(InfeasibleSceneError, match=r"mostly because of unsound.*look for such numbers"):
        _with_bank(_with(compiled, *BROKEN["a turn of nan"]))


def test_sound_layouts_are_served_as_they_are(compiled: CompiledScene):
    """And nothing is counted."""
    generator = LayoutGenerator(compiled, 32)
    generator.generate()
    assert (read(generator.layouts).status == Status.VALID).all()
    assert "unsound" not in generator.rejection_counts()["cube"]
