"""Sines, cosines, arc tangents, logarithms, exponentials: right to the last bits, and the same on every device."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from sceniris_gym.device.transforms import angle_of, exp_of, log_of, unit_circle

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NUM = 400_000
_vec5 = wp.types.vector(length=5, dtype=float)


@wp.kernel
def _evaluate(x: wp.array[float], y: wp.array[float], size: wp.array[float], out: wp.array[_vec5]):
    i = wp.tid()
    to = unit_circle(x[i])
    out[i] = _vec5(to[0], to[1], angle_of(x[i], y[i]), log_of(size[i]), exp_of(12.0 * x[i]))


def numbers() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numbers of all sizes, among them zeros and those that are equal, and positive ones, many of them near 1."""
    rng = np.random.default_rng(7)
    x = rng.uniform(-7.0, 7.0, NUM)
    y = rng.uniform(-7.0, 7.0, NUM) * 10.0 ** rng.integers(-12, 3, NUM)
    x[:100], y[50:150], y[150:200] = 0.0, 0.0, x[150:200]
    size = np.concatenate([1.0 - rng.random(NUM // 2), 10.0 ** rng.uniform(-37, 38, NUM // 2)])
    return x.astype(np.float32), y.astype(np.float32), size.astype(np.float32)


def evaluated(device: str) -> np.ndarray:
    """Cosine, sine, angle, logarithm and exponential on a device, (NUM, 5)."""
    inputs = [wp.array(a, dtype=float, device=device) for a in numbers()]
    out = wp.zeros(NUM, dtype=_vec5, device=device)
    wp.launch(_evaluate, NUM, inputs, [out], device=device)
    return out.numpy()


def test_they_are_right_to_the_last_bits():
    """Against double precision; half a place would be the nearest float."""
    x, y, size = numbers()
    power = np.exp((np.float32(12.0) * x).astype(float))
    x, y, size = (a.astype(float) for a in (x, y, size))
    exact = np.stack([np.cos(x), np.sin(x), np.arctan2(y, x), np.log(size), power], axis=1)
    place = np.spacing(np.abs(exact).astype(np.float32)).astype(float)
    worst = (np.abs(evaluated("cpu") - exact) / place).max(axis=0)
    assert np.all(worst[:2] < 0.58)
    assert worst[2] < 1.5
    assert np.all(worst[3:] < 0.51)


@pytest.mark.cuda
def test_a_gpu_has_the_same_bits():
    """To which layouts owe that they are the same on all devices."""
    assert evaluated("cuda:0").tobytes() == evaluated("cpu").tobytes()
