"""Things as they are read from a file of any format: a tree of links, with surfaces to see and solids to touch."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from PIL.Image import Image

from sceniris_gym.geometry.rotations import matrix, quaternion

GREY = (0.7, 0.7, 0.7, 1.0)
LEAST_MOMENT = 1e-14
"""Moments of inertia that are no larger than this [kg m^2] are none to MuJoCo."""


@dataclass(frozen=True)
class Surface:
    """Triangles that look alike.

    Attributes:
        vertices: In the frame of its link, shape (n, 3).
        faces: Indices of vertices, counterclockwise as seen from outside, shape (m, 3).
        rgba: Its colour, each component from 0 to 1.
        texture: The image that is mapped onto it.
        uv: Texture coordinates of the vertices, origin at the bottom left, shape (n, 2).
    """

    vertices: np.ndarray
    faces: np.ndarray
    rgba: tuple[float, ...] = GREY
    texture: Image | None = None
    uv: np.ndarray | None = None

    def moved(self, turn: np.ndarray, shift: np.ndarray | float = 0.0) -> Surface:
        """Return the surface with its vertices times a matrix, shape (3, 3), which may mirror, then shifted."""
        faces = self.faces[:, ::-1] if np.linalg.det(turn) < 0.0 else self.faces
        return replace(self, vertices=self.vertices @ turn.T + shift, faces=faces)


@dataclass(frozen=True)
class Joint:
    """A joint between a link and its parent, about or along an axis through the link's origin.

    Attributes:
        name: Its name.
        type: "hinge" or "slide".
        axis: In the link's frame, shape (3,).
        range: Its limits [rad, or the unit of length]; None without limits.
    """

    name: str
    type: str
    axis: np.ndarray
    range: tuple[float, float] | None


@dataclass(frozen=True)
class Inertia:
    """Mass [kg], centre of mass, and the inertia matrix about it in the link's axes, shape (3, 3)."""

    mass: float
    center: np.ndarray
    matrix: np.ndarray

    @property
    def least(self) -> float:
        """The least of its principal moments [kg m^2]."""
        return float(np.linalg.eigvalsh(self.matrix)[0])


@dataclass(frozen=True)
class Link:
    """A rigid part of a thing.

    Attributes:
        name: Its name.
        parent: The link that it hangs on; None for the root.
        pos: Its origin in its parent's frame, shape (3,).
        quat: Its orientation there, wxyz.
        joint: The joint to its parent; None if it is fixed.
        surfaces: Its visual surfaces.
        solids: Its collision surfaces, if the file has any; else the visual ones serve as such.
        inertia: Its inertia, if the file gives it.
    """

    name: str
    parent: str | None = None
    pos: np.ndarray = field(default_factory=lambda: np.zeros(3))
    quat: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    joint: Joint | None = None
    surfaces: tuple[Surface, ...] = ()
    solids: tuple[Surface, ...] = ()
    inertia: Inertia | None = None

    @property
    def touched(self) -> tuple[Surface, ...]:
        """The surfaces that collision geometry is made for."""
        return self.solids or self.surfaces

    def moved(self, turn: np.ndarray, shift: np.ndarray | float = 0.0) -> Link:
        """Return the link with each of its surfaces moved, in its own frame."""
        surfaces, solids = (tuple(s.moved(turn, shift) for s in kind) for kind in (self.surfaces, self.solids))
        return replace(self, surfaces=surfaces, solids=solids)


@dataclass(frozen=True)
class Thing:
    """A thing as its file describes it.

    Attributes:
        name: Its name.
        links: Its links, parents before their children; the first is the root.
        meters: Metres for each unit of length; None if the file does not say.
        up: The axis that points up, "x", "y" or "z"; None if the file does not say.
        notes: Remarks on parts of the file that were interpreted differently, or left out.
    """

    name: str
    links: tuple[Link, ...]
    meters: float | None = None
    up: str | None = None
    notes: tuple[str, ...] = ()

    def points(self) -> np.ndarray:
        """Return all vertices with joints at zero, in the frame of the root, shape (n, 3)."""
        frames: dict[str | None, tuple[np.ndarray, np.ndarray]] = {None: (np.eye(3), np.zeros(3))}
        found = [np.zeros((0, 3))]
        for link in self.links:
            turn, at = frames[link.parent]
            frames[link.name] = turn, at = turn @ matrix(link.quat), at + turn @ link.pos
            found += [at + surface.vertices @ turn.T for surface in (*link.surfaces, *link.solids)]
        return np.concatenate(found)

    def extents(self) -> np.ndarray:
        """Return the lengths of its bounds along its axes, shape (3,)."""
        return np.ptp(points, axis=0) if len(points := self.points()) else np.zeros(3)

    def scaled(self, factor: float) -> Thing:
        """Return the thing in another unit of length; masses stay as they are."""
        return replace(self, links=tuple(_scaled(link, factor) for link in self.links))

    def moved(self, turn: np.ndarray, shift: np.ndarray) -> Thing:
        """Return the thing turned by `turn` (3, 3), then shifted by `shift` (3,), in the frame of its root.

        The root link's frame stays at the origin, so what belongs to the root is moved itself.
        """
        root, *rest = self.links
        inertia = root.inertia
        if inertia is not None:
            inertia = Inertia(inertia.mass, turn @ inertia.center + shift, turn @ inertia.matrix @ turn.T)
        moved = replace(root.moved(turn, shift), inertia=inertia)
        children = [
            link
            if link.parent != root.name
            else replace(link, pos=turn @ link.pos + shift, quat=quaternion(turn @ matrix(link.quat)))
            for link in rest
        ]
        return replace(self, links=(moved, *children))


def _scaled(link: Link, factor: float) -> Link:
    joint, inertia = link.joint, link.inertia
    if joint is not None and joint.type == "slide" and joint.range is not None:
        joint = replace(joint, range=(joint.range[0] * factor, joint.range[1] * factor))
    if inertia is not None:
        inertia = Inertia(inertia.mass, inertia.center * factor, inertia.matrix * factor**2)
    return replace(link.moved(factor * np.eye(3)), pos=link.pos * factor, joint=joint, inertia=inertia)
