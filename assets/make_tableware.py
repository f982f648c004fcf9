"""Plate, glass, pan and spatula. Plate, glass and pan collide as a ring of wall pieces on a bottom."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .make_kitchenware import rounded
from .parts import Look, Part, chamfered, disc, sheared, wall, write_thing
from .shapes import Mesh, box, hull, lathe, surface

# Corners of the profiles: (r, z, radius of the rounding) [mm], from the top of the axis outward and down to it.
PLATE = [(0, 4.5, 0), (74, 4.5, 8), (108.6, 20, 0.9), (110.6, 18.6, 0.9), (72, 0, 2), (0, 0, 0)]
GLASS = [(0, 8, 0), (29.5, 8, 4), (34, 110, 0.5), (36.4, 110, 0.5), (32, 0, 1.5), (0, 0, 0)]
PAN = [(0, 5, 0), (72, 5, 6), (91, 48, 0.8), (96, 48, 0.8), (76, 0, 4), (0, 0, 0)]


def turned(corners: Sequence[tuple[float, float, float]], segments: int, steps: int, spacing: float) -> Mesh:
    """Turn a profile about the z axis, with ``steps`` steps per corner and steps of ``spacing`` [m] on straights."""
    profile, t = rounded(corners, steps, spacing)
    return lathe(profile, segments, t)


def make_plate() -> None:
    """Write ``plate.xml``."""
    mesh = turned(PLATE, 60, 2, 0.05)
    pieces = {
        "bottom": disc([(70.5, 0), (73.4, 1.5), (73.0, 4.5)], 12),
        "rim": wall([(65.0, 70.3, 0.1), (104.6, 109.0, 18.0)], 12, steps=5),
    }
    look = Look(mesh, (0.74, 0.76, 0.78), shine=0.6)
    write_thing("plate", Part({"visual": look}, pieces, 0.45, {"grasp": (0, -0.106, 0.018)}))


def make_glass() -> None:
    """Write ``glass.xml``."""
    mesh = turned(GLASS, 48, 2, 0.045)
    levels = [(29.7, 32.3, 8.0), (34.0, 36.3, 109.4), (34.55, 35.8, 110.0)]
    pieces = {"bottom": disc([(30.6, 0), (32.3, 8)], 16), "wall": wall(levels, 12)}
    look = Look(mesh, (0.55, 0.72, 0.74), shine=0.9)
    write_thing("glass", Part({"visual": look}, pieces, 0.30, {"grasp": (0, 0, 0.06)}), friction=0.6)


def make_pan() -> None:
    """Write ``pan.xml``, with a slightly rising handle to +x."""
    vessel = turned(PAN, 48, 3, 0.05)
    low, high, radius, slope = (0.0895, -0.0095, 0.031), (0.245, 0.0095, 0.041), 0.0045, (0.0, 0.0, 0.12)
    handle = sheared(surface(box(low, high, radius, 5)), slope, 0, low[0])
    levels = [(70.3, 73.0, 0.4), (90.7, 95.2, 47.0), (91.6, 94.8, 48.0)]
    pieces = {
        "bottom": disc([(72, 0), (76, 2.5), (77.5, 5)], 12),
        "wall": wall(levels, 12),
        "grip": sheared(chamfered(low, high, radius), slope, 0, low[0]),
    }
    looks = {"vessel": Look(vessel, (0.16, 0.17, 0.18), shine=0.7), "handle": Look(handle, (0.36, 0.21, 0.12))}
    write_thing("pan", Part(looks, pieces, 0.85, {"grasp": (0.20, 0, 0.049)}))


def make_spatula() -> None:
    """Write ``spatula.xml``: a wooden turner that lies flat along x, with its blade to +x."""
    low, high, radius = (0.055, -0.030, 0.0), (0.150, 0.030, 0.005), 0.0022
    grip = (-0.150, -0.008, 0.0), (0.075, 0.008, 0.011), 0.0045

    def narrowed(p: Sequence[float] | np.ndarray) -> tuple[float, float, float]:
        """Return the point to which ``p`` moves, to make the blade narrower towards the handle."""
        return p[0], p[1] * (0.62 + 0.38 * min(1.0, max(0.0, (p[0] - low[0]) / 0.08))), p[2]

    blade = surface(hull(np.array([narrowed(p) for p in chamfered(low, high, radius).vertices])))
    pieces = {"blade": blade, "handle": chamfered(*grip)}
    look = Look(surface(box(low, high, radius, 4).warp(narrowed) + box(*grip, 5)), (0.74, 0.55, 0.33), shine=0.15)
    write_thing("spatula", Part({"visual": look}, pieces, 0.06, {"grasp": (-0.06, 0, 0.0055)}))


def main() -> None:
    """Write plate, glass, pan and spatula."""
    make_plate()
    make_glass()
    make_pan()
    make_spatula()


if __name__ == "__main__":
    main()
