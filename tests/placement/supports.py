"""Supports for these tests, and the points that are drawn on them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
from shapely.geometry import box

from sceniris_gym.layout.layouts import LayoutStatus
from tests.layout.scenes import compile_on_cpu, make, write_mjcf

# An L of two tiles and a frame of four around a hole, 6 cm high.
TILES = [
    ((-0.4, -0.4), (0.0, 0.0)),
    ((-0.4, 0.0), (0.0, 0.4)),
    ((0.0, -0.4), (0.4, -0.3)),
    ((0.0, -0.1), (0.4, 0.0)),
    ((0.0, -0.3), (0.1, -0.1)),
    ((0.3, -0.3), (0.4, -0.1)),
]
PLATE = [((-0.3, -0.2), (0.3, 0.2))]
SHAPE = shapely.union_all([box(*low, *high) for low, high in TILES])


def tiles_mjcf(folder: Path, tiles: list[tuple[tuple[float, float], tuple[float, float]]] = TILES) -> str:
    """Write the asset of a support of tiles, by default the L."""
    geoms = [
        f'<geom type="box" size="{(x1 - x0) / 2} {(y1 - y0) / 2} .03" pos="{(x0 + x1) / 2} {(y0 + y1) / 2} .03"/>'
        for (x0, y0), (x1, y1) in tiles
    ]
    return write_mjcf(folder, "slab", "".join(geoms))


def goal_points(scene: dict, nworld: int = 4000, seed: int = 11) -> np.ndarray:
    """Draw a goal without a body in each world: its positions, shape (nworld, 3)."""
    compiled = compile_on_cpu(scene)
    rows = make(compiled, nworld, seed=seed)
    assert (rows.status == LayoutStatus.VALID).all()
    return rows.mocap_pos[:, int(compiled.mjm.body("goal").mocapid[0])]
