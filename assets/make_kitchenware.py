"""Mug, bowl and can. The hollow ones collide as a ring of wall pieces on a bottom; one mesh, turned, makes the ring."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from .mjcf import Document, add, inertial
from .shapes import Mesh, hull, lathe, solid, surface, thin_hull, write_obj
from .textures import write_png
from .tubes import tube

# Corners of the profiles: (r, z, radius of the rounding) [mm], from the top of the axis outward and down to it.
MUG = [(0, 6, 0), (37, 6, 3), (37.4, 95, 1.7), (41, 95, 1.7), (41, 0, 6), (31, 0, 0), (29.5, 1.2, 0), (0, 1.2, 0)]
BOWL = [
    (0, 8, 0), (43, 8, 5), (57.4, 35, 60), (69.4, 62, 1.8), (73.4, 62, 1.8), (61.5, 35, 60), (47.5, 5, 7),
    (34, 4, 1.5), (33, 0, 1), (30, 0, 0), (29, 1.2, 0), (0, 1.2, 0),
]  # fmt: skip
CAN = [
    (0, 118, 0), (23.5, 118, 1), (24.6, 115.6, 0.4), (25.4, 115.8, 0.4), (26, 122, 0.5), (27.4, 122, 0.6),
    (27.2, 119.5, 0.8), (33, 109, 7), (33, 8, 5), (27, 2, 2), (24.5, 0, 0.6), (22.8, 0, 0.5), (19, 6, 4), (0, 9, 0),
]  # fmt: skip
WALLS = 12
# The mug's handle: half thickness and half breadth of its section, and its path (x, z), all [mm].
HANDLE_HALF, HANDLE_BREADTH = 4.0, 6.6
HANDLE = [
    (39.2, 80),
    (50, 80),
    (59, 77),
    (65.5, 70),
    (68, 59),
    (67.5, 48),
    (63.5, 37),
    (56, 28.5),
    (47, 24),
    (39.2, 22),
]


def rounded(corners: Sequence[tuple[float, float, float]], steps: int, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """A profile (n, 2) [m] through corners, each made an arc of ``steps`` steps, straights cut to ``spacing`` [m].

    Also returns the share of the length passed at each station, shape (n,).
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
        # Directions between start and end, normalised: the arc is below 180 degrees.
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
    """Points (count, 3) [m] on a circle, radius and height in mm; the last point is left out of a full circle."""
    full = stop - start > 6.28
    angle = np.linspace(start, stop, count, endpoint=not full)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, z)], axis=1) / 1000.0


def disc(rings: Sequence[tuple[float, float]], count: int) -> Mesh:
    """The hull of circles (r, z) [mm]: its flats lie as far inside a circle as its corners lie outside."""
    fair = 2.0 / (1.0 + np.cos(np.pi / count))
    return surface(hull(np.concatenate([ring(r * fair, z, count) for r, z in rings])))


def wall(levels: Sequence[tuple[float | None, float, float]]) -> Mesh:
    """One of ``WALLS`` wall pieces, about the x axis. Levels are (inner r or None, outer r, z) [mm].

    Its outside has a corner in the middle; its inside is flat, and lies fairly about the true circle.
    """
    half = np.pi / WALLS
    outside, inside = 2.0 / (1.0 + np.cos(half / 2)), 2.0 / (1.0 + np.cos(half))
    points = []
    for inner, outer, z in levels:
        points.append(ring(outer * outside, z, 3, -half, half))
        if inner is not None:
            points.append(ring(inner * inside, z, 2, -half, half))
    return surface(hull(np.concatenate(points)))


def handle(stations: int, segments: int) -> Mesh:
    """The mug's handle, a flattened tube that ends within the wall."""
    points = np.array(HANDLE, dtype=float) / 1000.0
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    x, z = CubicSpline(along, points)(np.linspace(0.0, along[-1], stations)).T
    path = np.stack([x, np.zeros_like(x), z], axis=1)
    return tube(path, HANDLE_HALF / 1000.0, segments, flatten=HANDLE_BREADTH / HANDLE_HALF)


def mug_mesh(segments: int, steps: int, spacing: float, handle_grid: tuple[int, int]) -> Mesh:
    """The mug: a turned wall united with its handle."""
    profile, t = rounded(MUG, steps, spacing)
    return surface(solid(lathe(profile, segments, t)) + solid(handle(*handle_grid)))


def handle_pieces(count: int = 6) -> list[Mesh]:
    """Convex pieces along the handle."""
    segments = 10
    rings = handle(2 * count + 1, segments).vertices[1:-1].reshape(2 * count + 1, segments, 3)
    return [thin_hull(rings[2 * i : 2 * i + 3].reshape(-1, 3), 24, swell=False) for i in range(count)]


def write_vessel(
    name: str, meshes: dict[str, Mesh], pieces: dict[str, Mesh], look: dict, mass: float, grasp: tuple
) -> None:
    """Write one MJCF file per entry of ``meshes`` (name of the asset -> mesh for the eye).

    ``pieces`` are convex; the one named ``wall`` is used ``WALLS`` times around the axis. All is moved so that the
    bottom centre of the bounds is the origin.
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
        document.save()


def can_label() -> None:
    """The can's print: bare ends, a coloured body with a wave and a row of dots. v runs from the lid over the side."""
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
    # Dots are round on the can: its girth is 207 mm, its side about 100 mm.
    around = (np.mod(u * 8, 1.0) - 0.5) * 207 / 8
    for place, size in ((0.10, 4.5), (0.92, 3.0)):
        picture[inside & (np.hypot(around, (height - place) * 100) < size)] = (240, 168, 48)
    write_png("can", picture)


def main() -> None:
    """Write the mug, the bowl and the can, each coarse and fine."""
    bottom = disc([(33.5, 0), (39.2, 1.8), (41, 6)], 20)
    body = wall([(37.2, 41, 6), (37.4, 41, 94), (38.2, 40.2, 95)])
    pieces = {"bottom": bottom, "wall": body} | {f"handle_{i}": piece for i, piece in enumerate(handle_pieces())}
    mugs = {"mug": mug_mesh(36, 2, 0.045, (15, 12)), "mug_16k": mug_mesh(96, 6, 0.0045, (48, 32))}
    write_vessel("mug", mugs, pieces, {"rgb": (0.20, 0.36, 0.56), "shine": 0.7}, 0.34, (0, 0, 0.06))

    pieces = {"foot": disc([(32.8, 0), (33.8, 4)], 16), "bottom": disc([(34, 4), (45, 5.2), (48, 8)], 16),
              "wall": wall([(43.4, 48.6, 8), (None, 60.8, 35), (68.3, 72.1, 60.6), (69.6, 71.4, 62)])}  # fmt: skip
    bowls = {}
    for name, segments, steps, spacing in (("bowl", 36, 2, 0.03), ("bowl_16k", 96, 5, 0.0045)):
        profile, t = rounded(BOWL, steps, spacing)
        bowls[name] = lathe(profile, segments, t)
    write_vessel("bowl", bowls, pieces, {"rgb": (0.86, 0.84, 0.76), "shine": 0.6}, 0.38, (-0.0695, 0, 0.058))

    can_label()
    cans = {}
    for name, segments, steps, spacing in (("can", 28, 1, 0.05), ("can_16k", 96, 4, 0.0045)):
        profile, t = rounded(CAN, steps, spacing)
        cans[name] = lathe(profile, segments, t)
    pieces = {"hull": disc([(25, 0), (33, 8.5), (33, 108.5), (27.4, 122)], 16)}
    write_vessel("can", cans, pieces, {"rgb": (1, 1, 1), "shine": 0.7, "texture": "can.png"}, 0.36, (0, 0, 0.062))


if __name__ == "__main__":
    main()
