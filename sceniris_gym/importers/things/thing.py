"""What is read of a thing, whatever it was written in: a tree of links with surfaces to see and solids to touch."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from sceniris_gym.geometry.rotations import matrix, quaternion

if TYPE_CHECKING:
    from PIL.Image import Image

GREY = (0.7, 0.7, 0.7, 1.0)
LEAST_MOMENT = 1e-14
"""Moments of inertia that are no larger than this [kg m^2] are none to MuJoCo."""


@dataclass(frozen=True)
class Surface:
    """Triangles that look alike.

    Attributes:
        vertices: In the frame of its link, shape (n, 3).
        faces: Indices of vertices, counterclockwise as seen from outside, shape (m, 3).
        rgba: Its colour, from 0 to 1.
        texture: A picture that is wrapped around it.
        uv: Where each vertex is in that picture, origin at the bottom left, shape (n, 2).
    """

    vertices: np.ndarray
    faces: np.ndarray
    rgba: tuple[float, ...] = GREY
    texture: Image | None = None
    uv: np.ndarray | None = None


@dataclass(frozen=True)
class Joint:
    """How a link moves on its parent: about or along an axis through the link's origin.

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
    """Mass [kg], centre of mass, and moments about it in the link's axes: xx, yy, zz, xy, xz, yz."""

    mass: float
    center: np.ndarray
    moments: np.ndarray

    @property
    def full(self) -> np.ndarray:
        """The moments as a matrix, shape (3, 3)."""
        xx, yy, zz, xy, xz, yz = self.moments
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    @property
    def least(self) -> float:
        """The least of its principal moments [kg m^2]."""
        return float(np.linalg.eigvalsh(self.full)[0])


@dataclass(frozen=True)
class Link:
    """A rigid part of a thing.

    Attributes:
        name: Its name.
        parent: The link that it hangs on; None for the root.
        pos: Its origin in its parent's frame, shape (3,).
        quat: Its orientation there, wxyz.
        joint: What it moves by; None if it is fixed.
        surfaces: What is seen of it.
        solids: What is touched of it, if the file says so; else that is what is seen.
        inertia: Its inertia, if the file says so.
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


@dataclass(frozen=True)
class Thing:
    """A thing as its file has it.

    Attributes:
        name: Its name.
        links: Parents come before what hangs on them; the first is the root.
        meters: Metres for each unit of length; None if the file does not say.
        up: The axis that points up, "x", "y" or "z"; None if the file does not say.
        notes: What of the file was understood in another way, or left out.
        files: Names of all other files that were read.
    """

    name: str
    links: tuple[Link, ...]
    meters: float | None = None
    up: str | None = None
    notes: tuple[str, ...] = ()
    files: tuple[str, ...] = ()

    def points(self) -> np.ndarray:
        """All vertices with joints at zero, in the frame of the root, shape (n, 3)."""
        frames: dict[str | None, tuple[np.ndarray, np.ndarray]] = {None: (np.eye(3), np.zeros(3))}
        found = [np.zeros((0, 3))]
        for link in self.links:
            turn, at = frames[link.parent]
            frames[link.name] = turn, at = turn @ matrix(link.quat), at + turn @ link.pos
            found += [at + surface.vertices @ turn.T for surface in (*link.surfaces, *link.solids)]
        return np.concatenate(found)

    def extents(self) -> np.ndarray:
        """Lengths of its bounds along its axes, shape (3,)."""
        return np.ptp(points, axis=0) if len(points := self.points()) else np.zeros(3)

    def scaled(self, factor: float) -> Thing:
        """Return the thing in another unit of length; masses stay as they are."""
        return replace(self, links=tuple(_scaled(link, factor) for link in self.links))

    def moved(self, turn: np.ndarray, shift: np.ndarray) -> Thing:
        """Return the thing turned by `turn` (3, 3), then shifted by `shift` (3,), in the frame of its root.

        The root link's frame stays at the origin, so what belongs to the root is moved itself.
        """
        root, *rest = self.links
        moved = replace(
            root,
            surfaces=tuple(_moved(surface, turn, shift) for surface in root.surfaces),
            solids=tuple(_moved(surface, turn, shift) for surface in root.solids),
            inertia=None if root.inertia is None else _turned(root.inertia, turn, shift),
        )
        children = [
            link
            if link.parent != root.name
            else replace(link, pos=turn @ link.pos + shift, quat=quaternion(turn @ matrix(link.quat)))
            for link in rest
        ]
        return replace(self, links=(moved, *children))


def faces_of(surfaces: Iterable[Surface]) -> int:
    """How many triangles surfaces have."""
    return sum(len(surface.faces) for surface in surfaces)


def _scaled(link: Link, factor: float) -> Link:
    joint, inertia = link.joint, link.inertia
    if joint is not None and joint.type == "slide" and joint.range is not None:
        joint = replace(joint, range=(joint.range[0] * factor, joint.range[1] * factor))
    if inertia is not None:
        inertia = Inertia(inertia.mass, inertia.center * factor, inertia.moments * factor**2)
    surfaces, solids = (
        tuple(replace(surface, vertices=surface.vertices * factor) for surface in kind)
        for kind in (link.surfaces, link.solids)
    )
    return replace(link, pos=link.pos * factor, joint=joint, inertia=inertia, surfaces=surfaces, solids=solids)


def _moved(surface: Surface, turn: np.ndarray, shift: np.ndarray) -> Surface:
    return replace(surface, vertices=surface.vertices @ turn.T + shift)


def _turned(inertia: Inertia, turn: np.ndarray, shift: np.ndarray) -> Inertia:
    full = turn @ inertia.full @ turn.T
    moments = full[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return Inertia(inertia.mass, turn @ inertia.center + shift, moments)
