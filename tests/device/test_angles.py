"""Sines, cosines and arc tangents: right to the last bits, and the same on every device."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sceniris_gym.device.angles import angle_of, unit_circle
from sceniris_gym.layout.wave import accept, draw, points, prefilter, region_pieces, sides

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NUM = 400_000


@wp.kernel
def _evaluate(x: wp.array[float], y: wp.array[float], out: wp.array[wp.vec3]):
    i = wp.tid()
    to = unit_circle(x[i])
    out[i] = wp.vec3(to[0], to[1], angle_of(x[i], y[i]))


def numbers() -> tuple[np.ndarray, np.ndarray]:
    """Numbers of all sizes, among them zeros and those that are equal."""
    rng = np.random.default_rng(7)
    x = rng.uniform(-7.0, 7.0, NUM)
    y = rng.uniform(-7.0, 7.0, NUM) * 10.0 ** rng.integers(-12, 3, NUM)
    x[:100], y[50:150], y[150:200] = 0.0, 0.0, x[150:200]
    return x.astype(np.float32), y.astype(np.float32)


def evaluated(device: str) -> np.ndarray:
    """Cosine, sine and angle on a device, (NUM, 3)."""
    x, y = (wp.array(a, dtype=float, device=device) for a in numbers())
    out = wp.zeros(NUM, dtype=wp.vec3, device=device)
    wp.launch(_evaluate, NUM, [x, y], [out], device=device)
    return out.numpy()


def test_they_are_right_to_the_last_bits():
    """Against double precision; half a place would be the nearest float."""
    x, y = (a.astype(float) for a in numbers())
    exact = np.stack([np.cos(x), np.sin(x), np.arctan2(y, x)], axis=1)
    place = np.spacing(np.abs(exact).astype(np.float32)).astype(float)
    worst = (np.abs(evaluated("cpu") - exact) / place).max(axis=0)
    assert np.all(worst[:2] < 0.58)
    assert worst[2] < 1.5


@pytest.mark.cuda
def test_a_gpu_has_the_same_bits():
    """To which layouts owe that they are the same on all devices."""
    assert evaluated("cuda:0").tobytes() == evaluated("cpu").tobytes()


@pytest.mark.parametrize("module", [accept, draw, points, prefilter, region_pieces, sides])
def test_what_makes_layouts_fuses_nothing(module: object):
    """A fused multiply-add rounds once where a CPU rounds twice."""
    assert wp.get_module(module.__name__).options["fuse_fp"] is False  # type: ignore[attr-defined]
