"""Warm figures: shares counted again from the layouts, and where the time goes."""

from __future__ import annotations

import pytest
import warp as wp

from benchmarks.paper.scenes import HARD, PHYSICS, compiled_scene, without_restarts
from benchmarks.paper.warm import _key, _kinds_of_kernels, shares, warm
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.wave import collision, draw, standing

DEVICES = ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)]


def test_figures_are_those_of_the_layouts():
    """Of the batches after the first; without restarts some fail."""
    compiled = compiled_scene(without_restarts(PHYSICS), "cpu")
    found = warm(compiled, 200, 3)
    generator = LayoutGenerator(compiled, 200)
    generator.generate()
    valid = attempts = 0
    for _ in range(3):
        generator.generate()
        valid += int((generator.layouts.status.cpu().numpy() == LayoutStatus.VALID).sum())
        attempts += int(generator.layouts.attempts.cpu().numpy().sum())
    assert found.valid == valid / 600 < 1.0
    assert found.candidates == attempts / 600
    assert found.seconds > 0.0


@pytest.mark.parametrize("device", DEVICES)
def test_every_kernel_is_of_some_kind(device: str):
    """Shares sum up to one, the largest first; regions and containment are for scenes that need them."""
    plain = shares(compiled_scene(PHYSICS, device), 64)
    related = shares(compiled_scene(HARD, device), 64)
    assert set(plain) == {"draw", "prefilter", "collision", "accept", "rows and rounds"}
    assert set(related) == {*plain, "containment", "regions"}
    for found in (plain, related):
        assert sum(found.values()) == pytest.approx(1.0)
        assert list(found.values()) == sorted(found.values(), reverse=True)


def test_kernels_are_known_by_the_names_that_a_gpu_tells():
    """Warp's own names of compiled kernels, also of those with a module of their own."""
    shares(compiled_scene(PHYSICS, "cpu"), 4)
    for kernel in (draw._draw, collision._test_alone):
        name = kernel.get_mangled_name()
        assert name != kernel.key
        assert _key(f"forward kernel {name}") == kernel.key == _key(kernel.key)
        assert kernel.key in _kinds_of_kernels()
    assert _kinds_of_kernels()[standing._test_standing.key] == "standing"


def test_launches_are_left_as_they_were():
    """The functions that count launches are gone afterwards."""
    before = wp.launch, wp.launch_tiled
    shares(compiled_scene(PHYSICS, "cpu"), 4)
    assert (wp.launch, wp.launch_tiled) == before
