"""Grasps of a parallel gripper on the small assets, as sites ``grasp_*`` of their bodies.

A grasp is a frame with the origin midway between the fingertips, z along the approach and y along the closing axis. A
grasp rotated by 180 degrees about z is the same grasp, without a separate site. All grasps suit the hands of the arms.
The Panda's hand opens 80 mm, its palm is 38 mm behind the TCP, and its fingers end 9 mm beyond the TCP, a few
millimetres above the object's support. Positions are in the assets' frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .mjcf import Document, Element, add

Vector = Sequence[float] | np.ndarray
UP, DOWN = (0, 0, 1), (0, 0, -1)


@dataclass(frozen=True)
class Grasp:
    """Position [m], approach and closing direction of a grasp, in the frame of the grasped body."""

    pos: Vector
    approach: Vector
    closing: Vector

    @property
    def quat(self) -> np.ndarray:
        """Orientation of the grasp (wxyz)."""
        z = np.asarray(self.approach, dtype=float) / np.linalg.norm(self.approach)
        y = np.asarray(self.closing, dtype=float) - (z @ np.asarray(self.closing, dtype=float)) * z
        y /= np.linalg.norm(y)
        return quaternion(np.stack([np.cross(y, z), y, z], axis=1))


def quaternion(matrix: np.ndarray) -> np.ndarray:
    """The quaternion (wxyz, w >= 0) of a rotation matrix: the eigenvector of Bar-Itzhack's symmetric matrix."""
    (a, b, c), (d, e, f), (g, h, i) = matrix
    symmetric = np.array(
        [
            [a + e + i, h - f, c - g, d - b],
            [h - f, a - e - i, b + d, c + g],
            [c - g, b + d, e - a - i, f + h],
            [d - b, c + g, f + h, i - a - e],
        ]
    )
    quat = np.linalg.eigh(symmetric)[1][:, -1]
    return quat * (np.sign(quat[np.abs(quat).argmax()]) if abs(quat[0]) < 1e-9 else np.sign(quat[0]))


def around(name: str, height: float, tilt: float, count: int = 8, out: float = 0.0) -> dict[str, Grasp]:
    """Return grasps across an upright body of revolution, from ``count`` sides, and ``tilt`` degrees from vertical.

    Fingers close horizontally. The approach crosses the body's axis at ``height`` [m], and the TCP is ``out`` [m]
    before this point.
    """
    lean, grasps = np.radians(tilt), {}
    for i, angle in enumerate(2 * np.pi * np.arange(count) / count):
        back = np.array([np.sin(lean) * np.cos(angle), np.sin(lean) * np.sin(angle), np.cos(lean)])
        grasps[f"{name}_{i}"] = Grasp(out * back + (0, 0, height), -back, (-np.sin(angle), np.cos(angle), 0))
    return grasps


def above(name: str, height: float, count: int = 4) -> dict[str, Grasp]:
    """Return grasps straight down on an upright body of revolution. Closing directions span a half circle."""
    angles = np.pi * np.arange(count) / count
    return {f"{name}_{i}": Grasp((0, 0, height), DOWN, (np.cos(a), np.sin(a), 0)) for i, a in enumerate(angles)}


def across(name: str, pos: Vector, along: Vector, tilts: Sequence[float] = (0,)) -> dict[str, Grasp]:
    """Return grasps from above across a bar with the direction ``along``, tilted along it by ``tilts`` [degrees]."""
    forward = np.asarray(along, dtype=float) / np.linalg.norm(along)
    closing = np.cross(UP, forward)
    backs = [np.sin(lean) * forward + np.cos(lean) * np.array(UP) for lean in np.radians(tilts)]
    if len(backs) == 1:
        return {name: Grasp(pos, -backs[0], closing)}
    return {f"{name}_{i}": Grasp(pos, -back, closing) for i, back in enumerate(backs)}


def rim(radius: float, height: float, tilt: float, angles: Sequence[float], axis: float = 0.0) -> dict[str, Grasp]:
    """Return grasps of a vessel's wall at ``angles`` [degrees], with one finger inside.

    ``radius`` and ``height`` [m] locate the TCP, and ``axis`` [m] is the x coordinate of the vessel's axis. The hand is
    tilted outward by ``tilt`` degrees.
    """
    lean, grasps = np.radians(tilt), {}
    for i, angle in enumerate(np.radians(angles)):
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        back = np.sin(lean) * out + np.cos(lean) * np.array(UP)
        grasps[f"rim_{i}"] = Grasp(radius * out + (axis, 0, height), -back, out)
    return grasps


def mug() -> dict[str, Grasp]:
    """Return grasps of the mug: at the rim except above the handle, and at the handle from three directions."""
    axis, tilted = -0.0155, np.radians(25)
    return rim(0.0392, 0.077, 0.0, (60, 100, 140, 180, 220, 260, 300), axis) | {
        "handle_side": Grasp((axis + 0.066, 0, 0.055), (-np.cos(tilted), 0, -np.sin(tilted)), (0, 1, 0)),
        "handle_lean": Grasp((axis + 0.063, 0, 0.072), (-1, 0, -1), (0, 1, 0)),
        "handle_top": Grasp((axis + 0.056, 0, 0.080), DOWN, (0, 1, 0)),
    }


def banana() -> dict[str, Grasp]:
    """Return grasps of the banana: from above at three places along it, and at the middle also tilted to both ends."""
    grasps = across("middle", (0.0, -0.009, 0.016), (1, 0, 0), (0, 30, -30))
    for name, bend in (("stem", -0.33), ("tip", 0.33)):
        place = (0.135 * np.sin(bend), 0.126 - 0.135 * np.cos(bend), 0.016)
        grasps |= across(name, place, (np.cos(bend), np.sin(bend), 0))
    return grasps


def block(half: float) -> dict[str, Grasp]:
    """Return grasps of a block: from above across both pairs of sides, and tilted from all four sides."""
    x, y = (1, 0, 0), (0, 1, 0)
    low, high = (0, 0, half + 0.002), (0, 0, half + 0.0035)
    level = across("top_x", low, y) | across("top_y", low, x)
    return level | across("lean_x", high, y, (35, -35)) | across("lean_y", high, x, (35, -35))


def book() -> dict[str, Grasp]:
    """Return grasps of a book at its edges, for a book that stands or overhangs its support."""
    sides = {"spine": (-0.05, 0), "fore_edge": (0.05, 0), "front": (0, -0.08), "back": (0, 0.08)}
    return {name: Grasp((x, y, 0.015), (-np.sign(x), -np.sign(y), 0), (0, 0, 1)) for name, (x, y) in sides.items()}


def cereal_box() -> dict[str, Grasp]:
    """Return grasps across the box's narrow side: from above, from left and right, and at the upper corners."""
    grasps = {f"top_{i}": Grasp((x, 0, 0.24), DOWN, (0, 1, 0)) for i, x in enumerate((-0.055, 0, 0.055))}
    for side, sign in (("left", -1), ("right", 1)):
        for i, z in enumerate((0.10, 0.18)):
            grasps[f"{side}_{i}"] = Grasp((sign * 0.067, 0, z), (-sign, 0, 0), (0, 1, 0))
        grasps[f"{side}_corner"] = Grasp((sign * 0.075, 0, 0.25), (-sign, 0, -1), (0, 1, 0))
    return grasps


def handle(start: float, stop: float, height: float, slope: float = 0.0) -> dict[str, Grasp]:
    """Return grasps from above across a handle along x, at three places from ``start`` to ``stop`` [m]."""
    grasps = {}
    for i, x in enumerate(np.linspace(start, stop, 3)):
        grasps |= across(f"handle_{i}", (x, 0, height + slope * x), (1, 0, 0))
    return grasps


# For each asset, the grasps by their site names without ``grasp_``.
GRASPS: dict[str, dict[str, Grasp]] = {
    "apple": above("top", 0.044) | around("lean", 0.040, 40, out=0.004),
    "orange": above("top", 0.039) | around("lean", 0.036, 40, out=0.004),
    "banana": banana(),
    "mug": mug(),
    "bowl": rim(0.0648, 0.0474, 24.3, np.arange(0, 360, 45).tolist()),
    "can": above("top", 0.090) | around("lean", 0.100, 60, out=0.005) | around("side", 0.070, 90, out=0.004),
    "bottle": above("cap", 0.222) | around("neck", 0.222, 45) | around("side", 0.100, 90, out=0.004),
    "glass": above("top", 0.082) | around("lean", 0.092, 60, out=0.005) | around("side", 0.060, 90, out=0.004),
    "pear": above("top", 0.075) | around("lean", 0.042, 55, out=0.004),
    "lemon": across("top", (0, 0, 0.027), (1, 0, 0), (0, 35, -35)),
    "book": book(),
    "brick": across("top_x", (0, 0, 0.013), (0, 1, 0)) | across("top_y", (0, 0, 0.015), (1, 0, 0), (0, 30, -30)),
    "block": block(0.0225),
    "peg": across("top_x", (0, 0, 0.035), (0, 1, 0)) | across("top_y", (0, 0, 0.035), (1, 0, 0)),
    "cereal_box": cereal_box(),
    "pan": handle(0.07, 0.12, 0.0342, 0.12),
    "spatula": handle(-0.10, 0.0, 0.0105),
}


def add_grasps(document: Document, body: Element, asset: str | None = None) -> None:
    """Add the grasps of an asset to ``body``. By default, the asset is the document's asset."""
    for name, grasp in GRASPS.get(asset or document.name, {}).items():
        add_grasp(body, name, grasp)


def add_grasp(body: Element, name: str, grasp: Grasp) -> None:
    """Add the site ``grasp_<name>`` to ``body``."""
    add(body, "site", name=f"grasp_{name}", pos=grasp.pos, quat=grasp.quat, size=0.005, group=4)
