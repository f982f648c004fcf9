"""Overhead over supports as the words `on` and `inside` mean them: what of a support's own object is above it."""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.program.device import Cover
from sceniris_gym.program.plan import PlacedObject
from sceniris_gym.viewer.shown import ShownWorld

_OVER = 1e-4  # m above a surface that a cover begins, as when layouts are made
_THIN = 1e-9  # m2; what is smaller is seen edge-on


def is_covered_rightly(world: ShownWorld, placed: PlacedObject, region: BaseGeometry, height: float) -> BaseGeometry:
    """Return what of a region of the world, seen from above, at a height [m] has the cover that an object asks for."""
    if placed.cover == Cover.EITHER or region.is_empty:
        return region
    cover = cover_over(world, placed, height)
    return region.intersection(cover) if placed.cover == Cover.COVERED else region.difference(cover)


def cover_over(world: ShownWorld, placed: PlacedObject, height: float) -> BaseGeometry:
    """Return the outline, seen from above, of what a support's own object has above a height [m] of the world."""
    compiled = world.compiled
    assert placed.support is not None
    parent = compiled.scene.around(placed.support)
    found = []
    for piece in compiled.plan.pieces:
        if piece.body in parent and piece.type != PieceType.PLANE and piece.mesh is not None:
            turn, at = world.data.xmat[piece.body].reshape(3, 3), world.data.xpos[piece.body]
            triangles = np.asarray(piece.mesh.triangles) @ turn.T + at
            whole = compiled.config.geometry == "physics"  # then pieces are convex
            found += [_above(some, height + _OVER) for some in ([triangles] if whole else triangles[:, None])]
    return shapely.union_all(found)


def _above(triangles: np.ndarray, height: float) -> BaseGeometry:
    """The hull, seen from above, of what of triangles (n, 3, 3) is above a height."""
    ends = np.stack([triangles, np.roll(triangles, 1, axis=1)], axis=2).reshape(-1, 2, 3)
    above = ends[:, :, 2] > height
    one, other = ends[above[:, 0] != above[:, 1]].transpose(1, 0, 2)
    share = (height - one[:, 2:]) / (other[:, 2:] - one[:, 2:])
    points = np.concatenate([ends[above[:, 0], 0], one + share * (other - one)])[:, :2]
    if len(points) < 3:
        return shapely.Polygon()
    outline = shapely.MultiPoint(points).convex_hull
    return outline if outline.area > _THIN else shapely.Polygon()
