"""Mug, bowl and can. Mug and bowl collide as a ring of wall pieces on a bottom. Copies of one mesh form the ring.

Visual meshes have 32 or 96 segments, collision pieces 16 or 32. Corners of collision pieces lie on edges of the
visual meshes.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from .grasps import add_grasps
from .hulls import press_in
from .mjcf import Document, add, inertial
from .shapes import Mesh, hull, lathe, solid, surface, write_obj
from .textures import write_png
from .tubes import tube

# Corners of the profiles: (r, z, radius of the rounding) [mm], from the top of the axis outward and down to it.
MUG = [(0, 6, 0), (37, 6, 3), (37.4, 95, 1.7), (41, 95, 1.7), (41, 0, 6), (0, 0, 0)]
BOWL = [
    (0, 8, 0), (45, 8, 5), (69.4, 62, 1.8), (73.4, 62, 1.8), (61.5, 35, 60), (47.5, 5, 7), (34, 4, 1.5), (33, 0, 1),
    (0, 0, 0),
]  # fmt: skip
CAN = [
    (0, 120.2, 0), (25.4, 120.2, 0.4), (26, 122, 0.5), (27.4, 122, 0.6), (27.2, 119.5, 0.8), (33, 109, 7), (33, 8, 5),
    (27, 2, 2), (24.5, 0, 0.6), (0, 0, 0),
]  # fmt: skip
COARSE, FINE, WALLS = 32, 96, 16
# The mug's handle: half thickness and half width of its section, and its path (x, z) [mm].
HANDLE_HALF, HANDLE_BREADTH = 4.0, 6.6
# Stations and segments of the handle's coarse surface.
HANDLE_COARSE = (15, 12)
HANDLE = [
    (39.2, 80), (50, 80), (59, 77), (65.5, 70), (68, 59), (67.5, 48), (63.5, 37), (56, 28.5), (47, 24), (39.2, 22),
]  # fmt: skip


def rounded(corners: Sequence[tuple[float, float, float]], steps: int, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Sample a profile: corners become arcs of ``steps`` steps, straights get steps of ``spacing`` [m].

    Returns the stations (n, 2) [m], and the fraction of the profile's length at each station, shape (n,).
    """
    points = np.array(corners, dtype=float) / 1000.0
    line = [points[0, :2]]
    for (before, here, after), radius in zip(
        zip(points[:-2], points[1:-1], points[2:], strict=True), points[1:-1, 2], strict=True
    ):
        back, ahead = before[:2] - here[:2], after[:2] - here[:2]
        back, ahead = back / np.linalg.norm(back), ahead / np.linalg.norm(ahead)
        half = 0.5 * np.arccos(np.clip(back @ ahead, -1.0, 1.0))
        if radius == 0.0:
            line.append(here[:2])
            continue
        centre = here[:2] + (back + ahead) / np.linalg.norm(back + ahead) * radius / np.sin(half)
        start, end = here[:2] + back * radius / np.tan(half) - centre, here[:2] + ahead * radius / np.tan(half) - centre
        # Spherical interpolation from start to end, which works because the arc is below 180 degrees.
        for share in np.linspace(0.0, 1.0, steps + 1):
            turn = share * (np.pi - 2 * half)
            line.append(centre + (np.sin(np.pi - 2 * half - turn) * start + np.sin(turn) * end) / np.sin(2 * half))
    line.append(points[-1, :2])
    stations = [line[0]]
    for a, b in pairwise(line):
        pieces = max(1, int(np.ceil(np.linalg.norm(b - a) / spacing)))
        stations += [a + (b - a) * k / pieces for k in range(1, pieces + 1)]
    profile = np.array(stations)
    passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    return profile, passed / passed[-1]


def ring(radius: float, z: float, count: int, start: float = 0.0, stop: float = 2 * np.pi) -> np.ndarray:
    """Points (count, 3) [m] on a circle or arc. Radius and height are in mm. A full circle has no repeated point."""
    full = stop - start > 6.28
    angle = np.linspace(start, stop, count, endpoint=not full)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, z)], axis=1) / 1000.0


def disc(rings: Sequence[tuple[float, float]]) -> Mesh:
    """The hull of circles (r, z) [mm] with 16 corners each."""
    return surface(hull(np.concatenate([ring(r, z, WALLS) for r, z in rings])))


def wall(levels: Sequence[tuple[float | None, float, float]]) -> Mesh:
    """Return one of ``WALLS`` wall pieces, centred on the x axis. ``levels`` has (inner r or None, outer r, z) [mm].

    The outside has a corner in the middle. The inside is flat and touches the inner circle in the middle. The ends
    of the inside are deeper in the wall, by 2% of the radius.
    """
    half = np.pi / WALLS
    points = []
    for inner, outer, z in levels:
        points.append(ring(outer, z, 3, -half, half))
        if inner is not None:
            points.append(ring(inner / np.cos(half), z, 2, -half, half))
    return surface(hull(np.concatenate(points)))


def handle(stations: int, segments: int) -> Mesh:
    """The mug's handle, a flattened tube that ends inside the wall."""
    points = np.array(HANDLE, dtype=float) / 1000.0
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    x, z = CubicSpline(along, points)(np.linspace(0.0, along[-1], stations)).T
    path = np.stack([x, np.zeros_like(x), z], axis=1)
    return tube(path, HANDLE_HALF / 1000.0, segments, flatten=HANDLE_BREADTH / HANDLE_HALF)


def mug_mesh(segments: int, steps: int, spacing: float, handle_grid: tuple[int, int]) -> Mesh:
    """The mug: the union of a turned wall and its handle."""
    profile, t = rounded(MUG, steps, spacing)
    return surface(solid(lathe(profile, segments, t)) + solid(handle(*handle_grid)))


def handle_pieces(coarse: Mesh, fine: Mesh, count: int = 7) -> dict[str, Mesh]:
    """Return convex pieces along the handle, inside both the coarse and the fine mug."""
    rings = handle(*HANDLE_COARSE).vertices[1:-1].reshape(*HANDLE_COARSE, 3)
    cuts = np.linspace(0, HANDLE_COARSE[0] - 1, count + 1).round().astype(int)
    parts = [rings[[first, last]].reshape(-1, 3) for first, last in pairwise(cuts)]
    return {f"handle_{i}": press_in(points, [coarse, fine]) for i, points in enumerate(parts)}


def write_vessel(
    name: str, meshes: dict[str, Mesh], pieces: dict[str, Mesh], look: dict, mass: float, grasp: tuple
) -> None:
    """Write one MJCF file per entry of ``meshes`` (name of the asset -> visual mesh).

    ``pieces`` are convex. The piece ``wall`` is repeated ``WALLS`` times around the axis. The bottom centre of the
    bounds becomes the origin.
    """
    low, high = meshes[name].bounds
    shift = -np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    for variant, mesh in meshes.items():
        write_obj(variant, mesh.moved(shift))
    for part, piece in pieces.items():
        write_obj(f"{name}_{part}", piece if part == "wall" else piece.moved(shift))
    for variant in meshes:
        document = Document(variant)
        document.colour("surface", **look)
        document.mesh("visual", variant)
        inertial(document.root, meshes[name].moved(shift), mass)
        document.visual(document.root, "visual", "visual", "surface")
        for part in pieces:
            document.mesh(part, f"{name}_{part}")
            if part != "wall":
                document.collision(document.root, part, part)
                continue
            for i in range(WALLS):
                turn = np.pi * (i + 0.5) / WALLS
                document.collision(document.root, f"wall_{i}", part, pos=shift, quat=(np.cos(turn), 0, 0, np.sin(turn)))
        add(document.root, "site", name="grasp", pos=np.array(grasp) + shift, size=0.005, group=4)
        add_grasps(document, document.root, name)
        document.save()


def can_label() -> None:
    """Draw the can's print: bare ends, a coloured body with a wave and dots. v runs from the lid down the side."""
    rows, columns = 256, 256
    profile, t = rounded(CAN, 4, 0.012)
    side = t[profile[:, 0] > 0.0325]
    top, bottom = side.min(), side.max()
    v, u = (np.arange(rows)[:, None] + 0.5) / rows, (np.arange(columns)[None, :] + 0.5) / columns
    height = (v - top) / (bottom - top)
    picture = np.empty((rows, columns, 3))
    picture[:] = (178, 182, 186)
    inside = (height > -0.03) & (height < 1.03) & (u >= 0)
    picture[inside] = (20, 104, 120)
    wave = 0.52 + 0.10 * np.sin(4 * np.pi * u)
    for centre, breadth, colour in (
        (wave, 0.13, (238, 236, 226)),
        (wave + 0.19, 0.022, (240, 168, 48)),
        (wave - 0.19, 0.022, (240, 168, 48)),
    ):
        picture[inside & (np.abs(height - centre) < breadth)] = colour
    # Dots are round on the can, which has a circumference of 207 mm and a side of about 100 mm.
    around = (np.mod(u * 8, 1.0) - 0.5) * 207 / 8
    for place, size in ((0.10, 4.5), (0.92, 3.0)):
        picture[inside & (np.hypot(around, (height - place) * 100) < size)] = (240, 168, 48)
    write_png("can", picture)


def main() -> None:
    """Write the mug, the bowl and the can, each coarse and fine."""
    mugs = {"mug": mug_mesh(COARSE, 2, 0.045, HANDLE_COARSE), "mug_16k": mug_mesh(FINE, 6, 0.0045, (43, 36))}
    pieces = {
        "bottom": disc([(35, 0), (39.24, 1.757), (41, 6)]),
        "wall": wall([(37, 41, 6), (37.4, 41, 93.3), (38.4, 40, 94.7)]),
    } | handle_pieces(mugs["mug"], mugs["mug_16k"])
    write_vessel("mug", mugs, pieces, {"rgb": (0.20, 0.36, 0.56), "shine": 0.7}, 0.34, (0, 0, 0.06))

    pieces = {
        "foot": disc([(32.2, 0), (33.9, 4)]),
        "bottom": disc([(33.9, 4), (43.4, 4.71), (48.6, 8)]),
        "wall": wall([(45, 48.6, 8), (None, 61.4, 35), (68.93, 72.1, 60.95), (69.5, 71.5, 61.5)]),
    }
    bowls = {}
    for name, segments, steps, spacing in (("bowl", COARSE, 2, 0.03), ("bowl_16k", FINE, 6, 0.0045)):
        profile, t = rounded(BOWL, steps, spacing)
        bowls[name] = lathe(profile, segments, t)
    write_vessel("bowl", bowls, pieces, {"rgb": (0.86, 0.84, 0.76), "shine": 0.6}, 0.38, (-0.0695, 0, 0.058))

    can_label()
    cans = {}
    for name, segments, steps, spacing in (("can", COARSE, 1, 0.05), ("can_16k", FINE, 6, 0.0045)):
        profile, t = rounded(CAN, steps, spacing)
        cans[name] = lathe(profile, segments, t)
    pieces = {"hull": disc([(24.25, 0), (31.5, 6.54), (33, 10.08), (33, 107.19), (26.8, 120.2)])}
    write_vessel("can", cans, pieces, {"rgb": (1, 1, 1), "shine": 0.7, "texture": "can.png"}, 0.36, (0, 0, 0.062))


if __name__ == "__main__":
    main()
