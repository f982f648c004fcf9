"""Regions that params narrow: points are uniform in what a box leaves of them."""

from __future__ import annotations

import numpy as np
from scipy.stats import kstest

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import CompiledScene

NWORLD = 40


def _places(generator: LayoutGenerator, name: str, episodes: int) -> np.ndarray:
    """Return where an object is in valid layouts, shape (n, 3)."""
    found = []
    for _ in range(episodes):
        generator.generate()
        valid = generator.layouts.status.numpy() == LayoutStatus.VALID
        found.append(generator.layouts.pose(name).numpy()[valid, :3])
    return np.concatenate(found)


def test_a_narrowed_region_is_filled_uniformly(param_scene: CompiledScene):
    """By area in the part of a triangle that a box leaves, and by volume in space; p > 0.001."""
    generator = LayoutGenerator(param_scene, NWORLD, params="*.region", seed=3)
    generator.set_params({"objects.spot.region": [[0.1, -0.4], [0.4, 0.2]]})
    at = _places(generator, "spot", 20)
    assert (at[:, 0] >= 0.1).all()
    assert (at[:, 0] <= 0.4).all()
    assert (at[:, 1] >= -0.4).all()
    assert (at[:, 1] <= np.minimum(0.2, at[:, 0]) + 1e-6).all()
    free = at[(np.abs(at[:, :2]) > 0.0).all(axis=1)]
    height = np.minimum(free[:, 0], 0.2) + 0.4  # of the part over each x, whose integral is the law of x
    assert kstest((free[:, 1] + 0.4) / height, "uniform").pvalue > 1e-3
    generator.set_params({"objects.high.region": [[0.0, -0.2, 0.7], [0.5, 0.2, 0.8]]})
    high = _places(generator, "high", 10) - [0.0, -0.2, 0.7]
    for axis, size in enumerate((0.5, 0.4, 0.1)):
        assert kstest(high[:, axis] / size, "uniform").pvalue > 1e-3
