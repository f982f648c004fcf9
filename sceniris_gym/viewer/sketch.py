"""Sketches: surfaces, lines, arrows, axes and labels that the viewer draws over a world."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import viser
from shapely.geometry import MultiPolygon

from sceniris_gym.geometry.supports import triangulate

Colour = tuple[int, int, int]

RED: Colour = (214, 39, 40)
"""Red is only for rejected candidates and for distances that are too small."""
ORANGE: Colour = (240, 140, 20)
BLUE: Colour = (38, 110, 190)
GREEN: Colour = (40, 150, 90)
VIOLET: Colour = (130, 80, 170)
GREY: Colour = (120, 126, 134)
PALETTE: tuple[Colour, ...] = (BLUE, GREEN, VIOLET, (180, 120, 30), (20, 150, 160), (170, 60, 120), (90, 120, 40))
"""Colours of objects, without red."""

_THICK = 0.006  # thickness of lines over a world's size: two or three pixels if the whole world is in view
_SLIM = 16.0  # length of a short arrow over the radius of its shaft
_FLAT = {"side": "double", "flat_shading": True, "cast_shadow": False, "receive_shadow": False}


@dataclass
class Sketch:
    """Lists of shapes to draw, in the world's frame [m].

    Attributes:
        surfaces: For each surface, the vertices (n, 3) and faces (m, 3) of its triangles, its colour and its opacity.
        lines: For each line, its two ends, shape (2, 3), and its colour.
        arrows: For each arrow, its tail and its tip, shape (2, 3), and its colour.
        axes: For each frame, its position (3,) and its orientation (wxyz).
        labels: For each label, its text and its position (3,).
    """

    surfaces: list[tuple[np.ndarray, np.ndarray, Colour, float]] = field(default_factory=list)
    lines: list[tuple[np.ndarray, Colour]] = field(default_factory=list)
    arrows: list[tuple[np.ndarray, Colour]] = field(default_factory=list)
    axes: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)
    labels: list[tuple[str, np.ndarray]] = field(default_factory=list)

    def outline(self, ring: np.ndarray, colour: Colour) -> None:
        """Add a line between each two neighbours in a closed ring of points [m], shape (n, 3)."""
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            self.lines.append((np.stack([a, b]), colour))

    def area(self, region: MultiPolygon, height: float, colour: Colour, opacity: float) -> None:
        """Add a horizontal surface with the outline of a region [m], at a height [m]."""
        triangles = triangulate(region)
        points = np.c_[triangles.reshape(-1, 2), np.full(3 * len(triangles), height)]
        self.surfaces.append((points, np.arange(len(points)).reshape(-1, 3), colour, opacity))

    def draw(self, server: viser.ViserServer, name: str, origin: np.ndarray, size: float = 1.0) -> None:
        """Show the sketch on the page as the scene node `/name` of viser. An earlier sketch of this name is removed.

        Args:
            server: The viser server of the page.
            name: Name of the sketch on the page.
            origin: The world's origin [m].
            size: The size of the world [m], which sets the thickness of lines and arrows.
        """
        scene, thick = server.scene, _THICK * size
        with server.atomic():
            scene.remove_by_name(f"/{name}")  # with all shapes below it
            scene.add_frame(f"/{name}", show_axes=False, position=origin)
            for i, (vertices, faces, colour, opacity) in enumerate(self.surfaces):
                looks: Any = {"color": colour, "opacity": None if opacity >= 1.0 else opacity, **_FLAT}
                mesh = vertices.astype(np.float32), faces.astype(np.uint32)
                scene.add_mesh_simple(f"/{name}/surface{i}", *mesh, **looks)
            if self.lines:
                points = np.stack([line for line, _ in self.lines]).astype(np.float32)
                colours = np.repeat(np.stack([_linear(c) for _, c in self.lines])[:, None], 2, axis=1)
                scene.add_line_segments(f"/{name}/lines", points, colours, thickness=thick)
            for i, (ends, colour) in enumerate(self.arrows):
                shaft = min(thick, float(np.linalg.norm(ends[1] - ends[0])) / _SLIM)
                sizes: Any = {"shaft_radius": shaft, "head_radius": 3.0 * shaft, "head_length": 7.0 * shaft}
                scene.add_arrows(f"/{name}/arrow{i}", ends[None], _linear(colour), **sizes)
            if self.axes:
                positions, rotations = (np.stack(values).astype(np.float32) for values in zip(*self.axes, strict=True))
                scene.add_batched_axes(f"/{name}/axes", rotations, positions, axes_length=0.05, axes_radius=0.002)
            for i, (text, at) in enumerate(self.labels):
                scene.add_label(f"/{name}/word{i}", text, position=at, anchor="bottom-center", font_screen_scale=0.9)


def _linear(colour: Colour) -> np.ndarray:
    """Convert a colour from sRGB to linear RGB, shape (3,). viser takes linear colours only for lines and arrows."""
    return np.round(255.0 * (np.array(colour) / 255.0) ** 2.2).astype(np.uint8)
