"""Small textures, drawn with NumPy and identical on every machine."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image

from sceniris_gym.files import replacing

from .paths import mesh_file


def blend(v: np.ndarray, stops: Sequence[tuple[float, tuple[int, int, int]]]) -> np.ndarray:
    """Interpolate colours (rows, 1, 3) in 0..255 between ``stops`` of (v, colour) at ``v`` (rows, 1)."""
    places = [place for place, _ in stops]
    return np.stack([np.interp(v, places, [colour[i] for _, colour in stops]) for i in range(3)], axis=-1)


def mottle(rows: int, columns: int, seed: int, cell: tuple[float, float] = (4, 4)) -> np.ndarray:
    """Seamless smooth noise (rows, columns) of unit variance, with grains of about ``cell`` pixels (rows, columns)."""
    noise = np.random.default_rng(seed).standard_normal((rows, columns))
    wave = [np.fft.fftfreq(n) * grain * np.pi for n, grain in zip((rows, columns), cell, strict=True)]
    filtered = np.fft.fft2(noise) * np.exp(-0.5 * (wave[0][:, None] ** 2 + wave[1][None, :] ** 2))
    smooth = np.fft.ifft2(filtered).real
    return smooth / smooth.std()


def write_png(name: str, colours: np.ndarray) -> None:
    """Write ``meshes/<name>.png`` from colours (rows, columns, 3) in 0..255. Row 0 is at v = 0."""
    with replacing(mesh_file(f"{name}.png")) as file:
        Image.fromarray(np.clip(colours, 0, 255).astype(np.uint8)[::-1]).save(file, format="PNG")
