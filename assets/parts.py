"""Convex collision parts inside visual surfaces, and MJCF files of objects with several surfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .grasps import add_grasps
from .mjcf import Document, Element, add, inertial
from .shapes import Mesh, hull, surface, write_obj

Corners = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclass(frozen=True)
class Look:
    """A visual surface and its material."""

    mesh: Mesh
    rgb: tuple[float, float, float] = (1.0, 1.0, 1.0)
    shine: float = 0.3
    texture: str | None = None


@dataclass(frozen=True)
class Copies:
    """Copies of a convex piece: positions (n, 3) [m] and orientations (n, 4), wxyz."""

    mesh: Mesh
    pos: np.ndarray
    quat: np.ndarray


Piece = Mesh | Copies | Corners


@dataclass(frozen=True)
class Part:
    """One body: its visual surfaces and its collision pieces by name. Boxes are given by two corners [m]."""

    looks: Mapping[str, Look]
    pieces: Mapping[str, Piece]
    mass: float
    sites: Mapping[str, Sequence[float] | np.ndarray] = field(default_factory=dict)


def chamfered(low: Sequence[float], high: Sequence[float], radius: float) -> Mesh:
    """The convex hull of the six flats of a box between two corners [m] with edges rounded by ``radius``."""
    lowest, highest = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    points = []
    for axis in range(3):
        inset = np.full(3, radius)
        inset[axis] = 0.0
        for sign in np.ndindex(2, 2, 2):
            points.append(np.where(np.array(sign) == 0, lowest + inset, highest - inset))
    return surface(hull(np.array(points)))


def circle(radius: float, z: float, sides: int, start: float = 0.0, stop: float = 2.0 * np.pi) -> np.ndarray:
    """Return the corners [m] of a regular polygon on a circle, or ``sides`` + 1 points of an arc, shape (n, 3).

    ``radius`` and ``z`` are in mm.
    """
    angle = start + (stop - start) * np.arange(sides + (stop - start < 6.28)) / sides
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(len(angle), z)], axis=1) / 1000.0


def disc(levels: Sequence[tuple[float, float]], sides: int) -> Mesh:
    """The hull of polygons inscribed in circles (r, z) [mm].

    The hull is inside a turned solid if the solid's number of segments is a multiple of ``sides``.
    """
    return surface(hull(np.concatenate([circle(r, z, sides) for r, z in levels])))


def wall(levels: Sequence[tuple[float | None, float, float]], count: int, steps: int = 2) -> Copies:
    """Return a wall of ``count`` pieces. ``levels`` has (inner r or None, outer r, z) [mm].

    The outside of a piece has ``steps`` flats inscribed in the outer circle. The inside of a piece is one flat that
    touches the inner circle from outside. A piece is inside a turned wall if the wall's number of segments is a
    multiple of ``steps`` x ``count``.
    """
    half = np.pi / count
    points = []
    for inner, outer, z in levels:
        points.append(circle(outer, z, steps, -half, half))
        if inner is not None:
            points.append(circle(inner / np.cos(half), z, 1, -half, half))
    turn = half * (np.arange(count) + 0.5)
    quat = np.stack([np.cos(turn), 0 * turn, 0 * turn, np.sin(turn)], axis=1)
    return Copies(surface(hull(np.concatenate(points))), np.zeros((count, 3)), quat)


def sheared(mesh: Mesh, slope: Sequence[float], axis: int, start: float) -> Mesh:
    """Shear a mesh: vertices move by ``slope`` times the height of coordinate ``axis`` above ``start`` [m]."""
    shift = (mesh.vertices[:, axis, None] - start) * np.asarray(slope, dtype=float)
    return Mesh(mesh.vertices + shift, mesh.faces, mesh.uv, mesh.uv_faces)


def together(meshes: Sequence[Mesh]) -> Mesh:
    """Join meshes into one list of triangles."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def bottom_centre(meshes: Sequence[Mesh]) -> np.ndarray:
    """Bottom centre [m] of the bounds of several meshes."""
    low, high = together(meshes).bounds
    return np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])


def add_part(document: Document, body: Element, prefix: str, part: Part, shift: np.ndarray | None = None) -> None:
    """Write a part's meshes to ``<asset>_<prefix><name>``, and add its geoms to ``body``, moved by ``shift``."""
    offset = np.zeros(3) if shift is None else shift
    inertial(body, together([look.mesh for look in part.looks.values()]).moved(offset), part.mass)
    for name, look in part.looks.items():
        title = prefix + name
        document.colour(title, look.rgb, look.shine, look.texture)
        document.mesh(title, f"{document.name}_{title}")
        write_obj(f"{document.name}_{title}", look.mesh.moved(offset))
        document.visual(body, title, title, title)
    for name, piece in part.pieces.items():
        title = prefix + name
        if isinstance(piece, tuple):
            document.collision_box(body, title, *(np.asarray(corner) + offset for corner in piece))
            continue
        file = f"{title}_hull"
        document.mesh(file, f"{document.name}_{file}")
        if isinstance(piece, Mesh):
            write_obj(f"{document.name}_{file}", piece.moved(offset))
            document.collision(body, title, file)
            continue
        write_obj(f"{document.name}_{file}", piece.mesh)
        for i, (pos, quat) in enumerate(zip(piece.pos, piece.quat, strict=True)):
            document.collision(body, f"{title}_{i}", file, pos=pos + offset, quat=quat)
    for name, pos in part.sites.items():
        add(body, "site", name=prefix + name, pos=np.asarray(pos) + offset, size=0.005, group=4)


def write_thing(name: str, part: Part, friction: float = 0.8) -> None:
    """Write an asset with one body. The bottom centre of its bounds becomes the origin."""
    document = Document(name, friction=(friction, 0.005, 0.0001))
    add_part(document, document.root, "", part, -bottom_centre([look.mesh for look in part.looks.values()]))
    add_grasps(document, document.root)
    document.save()
