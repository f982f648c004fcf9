"""Links of arms: rounded solids with convex collision pieces.

A round tube connects the joints of a link. It ends in a drum about the next joint's axis, or in half of a drum: the
other half belongs to the next link. Shapes are given in the links' frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from xml.etree.ElementTree import Element

import numpy as np
from manifold3d import Manifold

from .fields import Field, Point, carve, flow
from .hulls import few_corners, press_in
from .mjcf import Document, add, inertial
from .shapes import lathe, solid, surface, write_obj

Plane = tuple[Point, float]


@dataclass
class Link:
    """A link's housing: its parts, the space for the neighbour's drum, and the division into convex pieces.

    A plane (normal, offset) represents the half-space on the plane's positive side.
    """

    parts: list[Field]
    low: Point
    high: Point
    fillet: float = 0.02
    trims: list[Plane] = field(default_factory=list)
    # The neighbour's drum rotates in the region outside both sides, so this region is cut away.
    seat: tuple[Plane, Plane] | None = None
    # Groups of parts that form convex pieces: on the first side of the seat, and on the second side only.
    pieces: list[list[int]] = field(default_factory=list)
    second: list[list[int]] = field(default_factory=list)
    # Dark caps on drums: (centre, axis, radius).
    caps: list[tuple[Point, Point, float]] = field(default_factory=list)


def housing(link: Link) -> Manifold:
    """The solid of a link's housing."""
    return seated(carved(link, link.parts), link).as_original().simplify(0.0003)


def carved(link: Link, parts: list[Field]) -> Manifold:
    """Return the union of parts of a link as a solid, trimmed by the link's planes."""
    body = carve(flow(parts, link.fillet), link.low, link.high, edge=0.008, tolerance=0.0005)
    for normal, offset in link.trims:
        body = body.trim_by_plane(normal, offset)
    return body


def seated(body: Manifold, link: Link) -> Manifold:
    """Cut a solid where the neighbour's drum rotates: outside both half-spaces of the link's seat."""
    if link.seat is None:
        return body
    return body.trim_by_plane(*link.seat[0]) + body.trim_by_plane(*link.seat[1])


def convex_pieces(link: Link) -> list[np.ndarray]:
    """Return sets of points (n, 3) [m] whose hulls fill the housing except for its fillets."""
    groups = [[carved(link, [link.parts[part]]) for part in parts] for parts in link.pieces + link.second]
    if link.seat is not None:
        first, second = link.seat
        for i, bodies in enumerate(groups):
            if i < len(link.pieces):
                groups[i] = [body.trim_by_plane(*first) for body in bodies]
            else:
                groups[i] = [body.trim_by_plane(*second).split_by_plane(*first)[1] for body in bodies]
    pieces = []
    for bodies in groups:
        points = np.concatenate([surface(body).vertices for body in bodies])
        # The housing's surface is simplified by up to 0.3 mm.
        foot = np.append(points.mean(axis=0)[:2], points[:, 2].min())
        pieces.append(foot + 0.995 * (points - foot))
    return pieces


def cap() -> Manifold:
    """A shallow dish of radius 1 and thickness 0.08 around z, which closes a drum."""
    profile = [(0, 0.075), (0.78, 0.075), (0.80, 0.06), (0.80, 0.0), (0.80, -0.06), (0, -0.06)]
    return solid(lathe(np.array(profile), 40))


def add_caps(document: Document, arm: Sequence[Link]) -> None:
    """Add the meshes of an arm's drum caps: one shape, scaled to each size."""
    write_obj(f"{document.name}_cap", surface(cap()))
    for size in dict.fromkeys(cap_size(radius) for link in arm for _, _, radius in link.caps):
        add(document.asset, "mesh", name=f"cap_{size}", file=f"{document.name}_cap.obj", scale=(size / 1000,) * 3)


def cap_size(radius: float) -> int:
    """Convert a drum's radius [m] to mm, for the name of its cap."""
    return round(radius * 1000)


def facing(direction: Point) -> np.ndarray:
    """The quaternion (wxyz) that rotates z to ``direction`` (a unit vector)."""
    quat = np.array([1.0 + direction[2], -direction[1], direction[0], 0.0])
    return quat / np.linalg.norm(quat) if np.linalg.norm(quat) > 0 else np.array([0.0, 1.0, 0.0, 0.0])


def dress(
    document: Document, body: Element, name: str, link: Link, mass: float, material: str, caps: str = "dark"
) -> None:
    """Add mass, housing, caps and convex pieces to a link's body."""
    mesh = surface(housing(link))
    write_obj(f"{document.name}_{name}", mesh)
    document.mesh(name, f"{document.name}_{name}")
    inertial(body, mesh, mass)
    document.visual(body, name, name, material)
    for i, (centre, axis, radius) in enumerate(link.caps):
        size = f"cap_{cap_size(radius)}"
        document.visual(body, f"{name}_cap_{i}", size, caps, pos=centre, quat=facing(axis))
    for i, points in enumerate(convex_pieces(link)):
        write_obj(f"{document.name}_{name}_hull_{i}", press_in(few_corners(points, 32), [mesh]))
        document.mesh(f"{name}_hull_{i}", f"{document.name}_{name}_hull_{i}")
        document.collision(body, f"{name}_hull_{i}", f"{name}_hull_{i}")
