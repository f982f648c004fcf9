"""Apple, orange and banana: a coarse and a fine closed surface, and convex collision pieces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .grasps import add_grasps
from .hulls import press_in
from .mjcf import Document, add, inertial
from .shapes import Mesh, hull, lathe, skin, smooth_profile, surface, write_obj
from .textures import blend, mottle, write_png

# Control points (r [mm], z [mm], density of rings), from the top of the axis to its bottom.
APPLE = [
    (0.0, 76.0, 1), (1.9, 75.6, 2.5), (1.6, 73.5, 3), (1.7, 71.4, 3), (5.0, 71.5, 2), (11.0, 72.3, 1.5),
    (17.0, 73.0, 1.2), (23.8, 71.4, 1), (30.5, 66.0, 1), (36.0, 54.0, 1), (37.4, 42.0, 1), (35.4, 27.0, 1),
    (29.9, 13.0, 1), (23.4, 4.0, 1), (16.4, 0.0, 1.2), (0.0, 0.0, 1.0),
]  # fmt: skip
ORANGE = [
    (0.0, 69.2, 1), (2.2, 69.6, 3), (2.8, 69.0, 3), (4.5, 69.6, 2), (9.0, 70.4, 1.2), (18.0, 67.6, 1),
    (28.5, 59.0, 1), (35.5, 46.5, 1), (37.2, 36.0, 1), (35.8, 25.0, 1), (29.5, 11.8, 1), (20.0, 3.4, 1),
    (11.0, 0.0, 1.2), (0.0, 0.0, 1.0),
]  # fmt: skip
# Radius [m] and half-angle [rad] of the arc along the middle of the banana.
BANANA_RADIUS, BANANA_HALF_ANGLE = 0.135, 0.71
# The banana's profile from stem to blossom end: radius of the section and position along the arc [mm], ring density.
BANANA = [
    (0.0, 0.0, 1), (4.4, 1.0, 3), (4.9, 6.0, 1.5), (4.7, 20.0, 1), (6.8, 31.0, 1.5), (12.6, 47.0, 1.2),
    (16.2, 70.0, 1), (17.4, 98.0, 1), (17.0, 126.0, 1), (14.6, 150.0, 1), (9.8, 171.0, 1.2), (5.3, 184.0, 1.5),
    (4.1, 188.0, 2), (2.6, 192.8, 1.5), (0.0, 193.6, 2),
]  # fmt: skip
# Indices of rings of the coarse meshes: rings of the hulls, and rings of each convex piece of the banana.
APPLE_RINGS, ORANGE_RINGS = (7, 9, 11, 14, 17, 20, 22), (4, 7, 10, 13, 16, 19, 22)
BANANA_PIECES = [(0, 2, 5), (5, 9), (9, 11, 14), (14, 18), (18, 21, 24), (24, 26, 31)]
# Rings and segments. The fine mesh contains all vertices of the coarse mesh: its steps are a fifth and a third of the
# coarse steps, for the banana a quarter and a third.
COARSE, FINE = (24, 24), (124, 72)
BANANA_COARSE, BANANA_FINE = (32, 22), (131, 66)


def apple(rows: int, segments: int) -> Mesh:
    """An apple with five faint lobes, lopsided by a few tenths of a millimetre, and a leaning stem."""
    profile, t = smooth_profile(APPLE, rows)
    # The lowest ring is level, so that the apple stands on it.
    profile[np.argmin(profile[:, 1]), 1] = 0.0
    body = lathe(profile, segments, t)
    x, y, z = body.vertices.T.copy()
    angle = np.arctan2(y, x)
    low = np.clip((0.060 - z) / 0.060, 0.0, 1.0) * np.clip(np.hypot(x, y) / 0.03, 0.0, 1.0)
    swelling = 1.0 + 0.022 * low * np.cos(5.0 * angle) + 0.012 * np.clip(z / 0.07, 0, 1) * np.cos(angle - 1.0)
    lean = 0.0015 * np.clip((z - 0.0715) / 0.0045, 0.0, 1.0) ** 2 * (np.hypot(x, y) < 0.0035)
    return Mesh(np.stack([x * swelling + lean, y * swelling, z], axis=1), body.faces, body.uv, body.uv_faces)


def orange(rows: int, segments: int) -> Mesh:
    """An orange, slightly flattened, with the scar of its stem."""
    profile, t = smooth_profile(ORANGE, rows)
    profile[np.argmin(profile[:, 1]), 1] = 0.0
    return lathe(profile, segments, t)


def banana(rows: int, segments: int) -> Mesh:
    """A banana lying on its side, bent in the ground plane, tips along x, with five blunt edges."""
    stations, t = smooth_profile(BANANA, rows)
    radius, along = stations[:, 0], stations[:, 1]
    bend = BANANA_HALF_ANGLE * (2.0 * along / along[-1] - 1.0)
    angle = 2.0 * np.pi * (np.arange(segments) + 0.5) / segments - 0.5 * np.pi
    # Blunt edges: the section is a blend of a circle and a pentagon, and one flat side is the underside.
    turned = np.mod(angle + 0.5 * np.pi + np.pi / 5, 2 * np.pi / 5) - np.pi / 5
    pentagon = np.cos(np.pi / 5) / np.cos(turned) / np.cos(np.pi / 10)
    section = 0.55 + 0.45 * pentagon
    in_plane, upward = section * np.cos(angle), section * np.sin(angle)
    # The thick middle lies flat on the ground, and the tips are above it. The axis is slightly lower than the section's
    # radius, and the section is cut at the ground. A minimum height keeps the thin tips up.
    height = np.maximum(radius, 0.7 * radius.max()) * 0.946 * (0.55 + 0.45 * np.cos(np.pi / 5) / np.cos(np.pi / 10))
    reach = BANANA_RADIUS + radius[:, None] * in_plane[None, :]
    x, y = reach * np.sin(bend)[:, None], -reach * np.cos(bend)[:, None]
    z = np.maximum(height[:, None] + radius[:, None] * upward[None, :], 0.0)
    rings = np.stack([x, y, z], axis=-1)
    ends = [
        np.array([BANANA_RADIUS * np.sin(b), -BANANA_RADIUS * np.cos(b), h]) for b, h in zip(bend, height, strict=True)
    ]
    return centred(skin(rings[1:-1], ends[0], ends[-1], t))


def centred(mesh: Mesh) -> Mesh:
    """Move a mesh so that the bottom centre of its bounds is the origin."""
    low, high = mesh.bounds
    return mesh.moved((-(low[0] + high[0]) / 2, -(low[1] + high[1]) / 2, -low[2]))


def staggered(mesh: Mesh, rows: Sequence[int]) -> Mesh:
    """Return the hull of a convex body's rings: odd or even corners in turn, every third corner in the end rings."""
    corners = mesh.vertices[1:-1].reshape(*COARSE, 3)
    ends = [corners[rows[0], ::3], corners[rows[-1], ::3]]
    return surface(hull(np.concatenate([*ends, *(corners[row, i % 2 :: 2] for i, row in enumerate(rows[1:-1], 1))])))


def apple_pieces(coarse: Mesh, fine: Mesh) -> list[Mesh]:
    """Convex pieces of the apple: the body up to the bottom of its dimple, and the stem."""
    stem = press_in(coarse.vertices[1:-1].reshape(*COARSE, 3)[:3, ::4].reshape(-1, 3), [coarse, fine])
    return [staggered(coarse, APPLE_RINGS), stem]


def banana_pieces(coarse: Mesh, fine: Mesh) -> list[Mesh]:
    """Convex pieces along the banana, from about half of the corners of each ring, including the underside's edges."""
    rings = coarse.vertices[1:-1].reshape(*BANANA_COARSE, 3)
    rings = rings[:, [1, 2, 4, 6, 8, 10, 11, 13, 15, 17, 19, 20]]
    return [press_in(rings[list(rows)].reshape(-1, 3), [coarse, fine], ground=0.0) for rows in BANANA_PIECES]


def write_fruit(name: str, coarse: Mesh, fine: Mesh, pieces: list[Mesh], mass: float, grasp: tuple) -> None:
    """Write ``<name>.xml`` and ``<name>_16k.xml``, which differ only in the visual mesh."""
    write_obj(name, coarse)
    write_obj(f"{name}_16k", fine)
    for i, piece in enumerate(pieces):
        write_obj(f"{name}_hull_{i}", piece)
    for variant in (name, f"{name}_16k"):
        document = Document(variant, friction=(0.7, 0.005, 0.0001))
        document.colour("skin", (1, 1, 1), shine=0.35, texture=f"{name}.png")
        document.mesh("visual", variant)
        inertial(document.root, coarse, mass)
        document.visual(document.root, "visual", "visual", "skin")
        for i in range(len(pieces)):
            document.mesh(f"hull_{i}", f"{name}_hull_{i}")
            document.collision(document.root, f"hull_{i}", f"hull_{i}")
        add(document.root, "site", name="grasp", pos=grasp, size=0.005, group=4)
        add_grasps(document, document.root, name)
        document.save()


# Colours (red, green, blue in 0..255) at positions 0 to 1 along the profiles above.
APPLE_SKIN = [
    (0.0, (74, 48, 26)), (0.13, (86, 60, 30)), (0.16, (150, 140, 60)), (0.22, (190, 150, 60)), (0.34, (176, 40, 34)),
    (0.70, (158, 20, 28)), (0.86, (186, 60, 40)), (0.95, (170, 130, 60)), (1.0, (60, 44, 30)),
]  # fmt: skip
ORANGE_SKIN = [
    (0.0, (92, 110, 50)), (0.05, (110, 120, 50)), (0.09, (226, 130, 28)), (0.5, (240, 134, 22)), (0.95, (236, 130, 24)),
    (1.0, (150, 100, 40)),
]  # fmt: skip
BANANA_SKIN = [
    (0.0, (70, 54, 30)), (0.05, (120, 110, 44)), (0.16, (190, 180, 60)), (0.30, (240, 206, 66)), (0.80, (240, 202, 60)),
    (0.90, (200, 180, 62)), (0.955, (90, 70, 40)), (1.0, (44, 34, 26)),
]  # fmt: skip


def textures() -> None:
    """Draw the textures of the three fruits: u goes around, v along the profile."""
    shape = (256, 128)
    v, grain = np.linspace(0, 1, shape[0])[:, None], mottle(*shape, seed=1)
    streaks = mottle(*shape, seed=2, cell=(60, 2)) * np.clip(1.3 - v, 0.2, 1.0)
    pores = mottle(*shape, seed=3, cell=(2, 2))
    spots = np.clip(mottle(*shape, seed=4, cell=(5, 3)) - 1.5, 0, 1)
    write_png("apple", blend(v, APPLE_SKIN) * (1 + 0.04 * grain + 0.13 * streaks)[..., None])
    write_png("orange", blend(v, ORANGE_SKIN) * (1 + 0.07 * pores)[..., None])
    write_png("banana", blend(v, BANANA_SKIN) * (1 - 0.35 * spots + 0.03 * grain)[..., None])


def main() -> None:
    """Write the three fruits."""
    textures()
    body, fine = apple(*COARSE), apple(*FINE)
    write_fruit("apple", body, fine, apple_pieces(body, fine), mass=0.17, grasp=(0, 0, 0.038))
    body, fine = orange(*COARSE), orange(*FINE)
    write_fruit("orange", body, fine, [staggered(body, ORANGE_RINGS)], mass=0.18, grasp=(0, 0, 0.036))
    body, fine = banana(*BANANA_COARSE), banana(*BANANA_FINE)
    write_fruit("banana", body, fine, banana_pieces(body, fine), mass=0.14, grasp=(0.004, -0.009, 0.018))


if __name__ == "__main__":
    main()
