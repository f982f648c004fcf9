"""Bottle, tin, cereal box, pear and lemon: printed or mottled surfaces with a few convex pieces inside."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from .make_kitchenware import rounded
from .parts import Look, Part, Piece, chamfered, disc, write_thing
from .shapes import Mesh, box, hull, lathe, skin, smooth_profile, surface
from .textures import blend, mottle, write_png

# Corners of the profiles: (r, z, radius of the rounding) [mm], from the top of the axis outward and down to it.
BOTTLE = [
    (0, 252, 0), (14.5, 252, 1.5), (14.5, 226, 0.4), (12.5, 225.6, 0), (12.5, 196, 10), (34, 152, 16), (34, 0, 3),
    (0, 0, 0),
]  # fmt: skip
TIN = [(0, 46, 0), (42, 46, 0.6), (42, 0, 0.6), (0, 0, 0)]
CEREAL = (0.19, 0.065, 0.27)  # extent x, y, z [m]
# Control points (r [mm], z [mm], density of rings), from the top of the axis to its bottom.
PEAR = [
    (0.0, 108.0, 1), (1.8, 107.6, 4), (1.8, 98.0, 2), (2.2, 91.6, 3), (7.0, 91.4, 2), (13.0, 88.0, 1.5),
    (17.0, 81.0, 1), (19.0, 73.0, 1), (22.5, 61.0, 1), (28.5, 49.0, 1), (32.0, 36.0, 1), (31.0, 23.0, 1),
    (25.5, 9.0, 1), (16.0, 1.2, 1.2), (10.0, 0.0, 1.5), (0.0, 0.0, 1),
]  # fmt: skip
# Half of the lemon's profile: distance from its middle, and radius [mm].
LEMON = [(0, 26.5), (10, 25.4), (20, 21.8), (28, 16.0), (33, 10.2), (36, 7.2), (39, 6.2), (41.5, 4.2), (42.4, 0)]


def picture(rows: int, columns: int, colour: tuple[int, int, int]) -> np.ndarray:
    """A picture of one colour."""
    return np.full((rows, columns, 3), colour, dtype=float)


def make_bottle() -> None:
    """Write ``bottle.xml``: dark glass, a label, a red cap."""
    profile, t = rounded(BOTTLE, 3, 0.03)
    rows, columns = 256, 128
    print_ = picture(rows, columns, (38, 66, 34))
    v = np.linspace(0, 1, rows)
    height = 1000 * np.interp(v, t, profile[:, 1])
    side = 1000 * np.interp(v, t, profile[:, 0]) > 10
    print_[height > 225] = (150, 28, 26)
    label = side & (height > 40) & (height < 125)
    print_[label] = (232, 224, 200)
    print_[side & (((height > 44) & (height < 48)) | ((height > 117) & (height < 121)))] = (158, 128, 52)
    # An olive branch, drawn as leaves along a line, on two sides.
    u = np.arange(columns)[None, :] / columns
    for centre in (0.25, 0.75):
        x, z = (u - centre) * 214, height[:, None] - 82
        for k in range(-3, 4):
            lean = (-1) ** k * 7
            leaf = ((x - 6 * k) / 3.2) ** 2 + ((z - lean - 1.5 * k) / 8.5) ** 2 < 1
            print_[leaf & label[:, None]] = (86, 108, 44)
    write_png("bottle", print_)
    pieces = {
        "body": disc([(31, 0), (34, 3), (34, 143)], 13),
        "shoulder": disc([(34, 143.5), (32.4, 153), (13.4, 191)], 13),
        "neck": disc([(12.5, 188), (12.5, 226)], 13),
        "cap": disc([(14, 226), (14.5, 250.5), (13, 252)], 13),
    }
    mesh = lathe(profile, 39, t)
    look = Look(mesh, shine=0.8, texture="bottle.png")
    write_thing("bottle", Part({"visual": look}, pieces, 0.75, {"grasp": (0, 0, 0.12)}))


def make_tin() -> None:
    """Write ``tin.xml``: a short tin with a printed side."""
    profile, t = rounded(TIN, 2, 0.012)
    rows, columns = 192, 256
    print_ = picture(rows, columns, (186, 188, 190))
    v, u = np.linspace(0, 1, rows), np.arange(columns)[None, :] / columns
    height, radius = 1000 * np.interp(v, t, profile[:, 1]), 1000 * np.interp(v, t, profile[:, 0])
    print_[(np.mod(radius, 9.0) < 1.2) & (radius < 40)] = (150, 152, 155)
    side = (radius > 41.9) & (height > 3) & (height < 43)
    print_[side] = (214, 168, 40)
    print_[side & (height > 8) & (height < 38)] = (28, 66, 128)
    for centre in (0.25, 0.75):
        x, z = (u - centre) * 264, height[:, None] - 23
        print_[(side[:, None]) & ((x / 17) ** 2 + (z / 7) ** 2 < 1)] = (226, 230, 232)
        print_[(side[:, None]) & (np.abs(z) < (x - 14) * 0.8) & (x < 24)] = (226, 230, 232)
    write_png("tin", print_)
    look = Look(lathe(profile, 40, t), shine=0.6, texture="tin.png")
    pieces = {"body": disc([(41.4, 0), (41.4, 46)], 20)}
    write_thing("tin", Part({"visual": look}, pieces, 0.24, {"grasp": (0, 0, 0.023)}))


def around(mesh: Mesh, size: tuple[float, float, float]) -> Mesh:
    """Return the mesh with the texture coordinates of a box of ``size`` [m] about the z axis.

    u runs around the sides, starting with 0 at the left of the front. v is 0 at the top of the sides and 0.9 at their
    bottom. Faces that point up or down use the corner (u, v) = (0.99, 0.97).
    """
    x, y, z = size
    corners = mesh.vertices[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    share = np.abs(normal) / np.linalg.norm(normal, axis=1, keepdims=True)
    uv = np.empty((len(corners), 3, 2))
    girth = 2 * (x + y)
    for k, (triangle, weight) in enumerate(zip(corners, share, strict=True)):
        sign = normal[k] > 0
        if weight.argmax() == 2:
            uv[k] = (0.99, 0.97)
            continue
        if weight.argmax() == 1:
            along = triangle[:, 0] + x / 2 if not sign[1] else x + y + x / 2 - triangle[:, 0]
        else:
            along = x + triangle[:, 1] + y / 2 if sign[0] else 2 * x + y + y / 2 - triangle[:, 1]
        uv[k, :, 0] = along / girth
        uv[k, :, 1] = 0.9 * (1.0 - triangle[:, 2] / z)
    return Mesh(mesh.vertices, mesh.faces, uv.reshape(-1, 2), np.arange(3 * len(corners)).reshape(-1, 3))


def make_cereal_box() -> None:
    """Write ``cereal_box.xml``: standing, its front to -y."""
    x, y, z = CEREAL
    rows, columns = 300, 512
    print_ = picture(rows, columns, (206, 60, 34))
    girth = 2 * (x + y)
    u = (np.arange(columns)[None, :] + 0.5) / columns * girth
    v = (np.arange(rows)[:, None] + 0.5) / rows / 0.9 * z
    for left in (0.0, x + y):
        px, pz = u - left - x / 2, v + 0 * u
        face = (np.abs(px) < x / 2) & (v < z)
        sun = (px**2 + (pz - 0.075) ** 2 < 0.047**2) & face
        rays = (np.mod(np.arctan2(px, pz - 0.075) * 16 / (2 * np.pi), 1) < 0.5) & face & (pz < 0.15)
        print_[rays] = (224, 92, 40)
        print_[sun] = (248, 206, 72)
        print_[face & (np.abs(pz - 0.075) < 0.013) & (np.abs(px) < 0.075)] = (250, 244, 230)
        # Letters, as blocks.
        for k in range(7):
            letter = (np.abs(px - 0.02 * (k - 3)) < 0.0068) & (np.abs(pz - 0.075) < 0.0085)
            hole = (np.abs(px - 0.02 * (k - 3) - 0.001) < 0.003) & (np.abs(pz - 0.075 + 0.002 * (-1) ** k) < 0.0035)
            print_[face & letter & ~hole] = (126, 24, 22)
        bowl = (px**2 / 0.07**2 + (pz - 0.19) ** 2 / 0.055**2 < 1) & (pz > 0.19) & face
        print_[bowl] = (58, 96, 150)
        milk = (px**2 / 0.068**2 + (pz - 0.19) ** 2 / 0.016**2 < 1) & face
        print_[milk] = (246, 242, 232)
        flakes = (mottle(rows, columns, seed=11, cell=(5, 5)) > 0.5) & milk
        print_[flakes] = (214, 150, 58)
    sides = ((u > x) & (u < x + y)) | (u > 2 * x + y)
    lines = sides & (np.mod(v, 0.012) < 0.005) & (v > 0.06) & (v < 0.2)
    middle = np.minimum(np.abs(u - x - y / 2), np.abs(u - 2 * x - 1.5 * y))
    print_[lines & (middle < y * 0.36)] = (248, 222, 190)
    write_png("cereal_box", print_)
    low, high = (-x / 2, -y / 2, 0.0), (x / 2, y / 2, z)
    mesh = around(surface(box(low, high, 0.0012, 3)), CEREAL)
    look = Look(mesh, shine=0.2, texture="cereal_box.png")
    pieces = {"body": chamfered(low, high, 0.0012)}
    write_thing("cereal_box", Part({"visual": look}, pieces, 0.42, {"grasp": (0, 0, 0.2)}))


def make_pear() -> None:
    """Write ``pear.xml``: standing, with a stem."""
    profile, t = smooth_profile(PEAR, 22)
    profile[profile[:, 1] < 0.00025, 1] = 0.0
    shape = (128, 128)
    v = np.linspace(0, 1, shape[0])[:, None]
    stops = [
        (0.0, (70, 50, 28)), (0.12, (96, 72, 36)), (0.16, (150, 150, 60)), (0.3, (186, 186, 70)), (0.6, (190, 178, 64)),
        (0.85, (170, 170, 66)), (1.0, (90, 76, 40)),
    ]  # fmt: skip
    spots = np.clip(mottle(*shape, seed=6, cell=(2, 2)) - 1.4, 0, 1)
    write_png("pear", blend(v, stops) * (1 - 0.3 * spots + 0.04 * mottle(*shape, seed=7))[..., None])
    pieces = {
        "base": disc([(8.2, 0), (15.5, 1.4), (25, 9)], 13),
        "belly": disc([(25, 9), (30.9, 23)], 13),
        "body": disc([(30.9, 23), (31.8, 36), (28.2, 49)], 13),
        "neck": disc([(27.0, 49), (18.5, 70)], 13),
        "top": disc([(20.2, 66), (16.6, 81.5), (12.5, 88)], 13),
        "crown": disc([(12.5, 88), (6.5, 91.2)], 13),
        "stem": disc([(1.7, 90), (1.7, 106.5)], 13),
    }
    look = Look(lathe(profile, 39, t), shine=0.35, texture="pear.png")
    write_thing("pear", Part({"visual": look}, pieces, 0.18, {"grasp": (0, 0, 0.04)}), friction=0.7)


def make_lemon() -> None:
    """Write ``lemon.xml``: lying along x on a small flat."""
    x, radius = (np.array(LEMON, dtype=float) / 1000.0).T
    along = np.concatenate([-x[:0:-1], x])
    size = np.concatenate([radius[:0:-1], radius])
    segments = 20
    angle = 2 * np.pi * (np.arange(segments) + 0.5) / segments
    fine = np.unique(np.concatenate([along, (along[1:] + along[:-1]) / 2]))
    # Rings run counter-clockwise as seen from their start at -x.
    r = PchipInterpolator(along, size)(fine)[1:-1, None]
    rings = np.stack(np.broadcast_arrays(fine[1:-1, None], -r * np.cos(angle), r * np.sin(angle)), axis=-1)
    rings[..., 2] = np.maximum(rings[..., 2], -0.0248)
    ends = np.array([[fine[0], 0, 0], [fine[-1], 0, 0]])
    mesh = skin(rings, ends[0], ends[1], np.linspace(0, 1, len(fine)))
    shape = (128, 128)
    pores, v = mottle(*shape, seed=8, cell=(2, 2)), np.linspace(0, 1, shape[0])[:, None]
    stops = [
        (0, (150, 130, 50)),
        (0.1, (222, 190, 48)),
        (0.5, (240, 208, 52)),
        (0.92, (220, 200, 60)),
        (1, (130, 120, 50)),
    ]
    write_png("lemon", blend(v, stops) * (1 + 0.05 * pores)[..., None])

    def slab(start: float, stop: float, share: float = 1.0) -> Mesh:
        """Return the hull of two rings [mm]. For concave parts, ``share`` below 1 scales it towards the axis."""
        chosen = [rings[np.abs(1000 * fine[1:-1] - place).argmin()] for place in (start, stop)]
        return surface(hull(np.concatenate(chosen) * (1.0, share, share)))

    pieces: dict[str, Piece] = {"middle": slab(-10, 10)}
    for name, sign in (("left", -1), ("right", 1)):
        pieces[f"{name}_half"] = slab(10 * sign, 20 * sign)
        pieces[f"{name}_end"] = slab(20 * sign, 28 * sign, 0.995)
        pieces[f"{name}_collar"] = slab(28 * sign, 36 * sign, 0.94)
        pieces[f"{name}_nub"] = slab(36 * sign, 41.5 * sign)
    look = Look(mesh, shine=0.35, texture="lemon.png")
    write_thing("lemon", Part({"visual": look}, pieces, 0.11, {"grasp": (0, 0, 0)}), friction=0.7)


def main() -> None:
    """Write all five assets of this file."""
    make_bottle()
    make_tin()
    make_cereal_box()
    make_pear()
    make_lemon()


if __name__ == "__main__":
    main()
