"""The regions of a plan as triangles, in the fields of `device.Program`."""

from __future__ import annotations

import math

import numpy as np

from sceniris_gym.geometry import supports
from sceniris_gym.geometry.ragged import addressed, ranges
from sceniris_gym.geometry.supports import SupportSurface
from sceniris_gym.program.pack.relations import region_pieces
from sceniris_gym.program.placed_object import PlacedObject


def pack_regions(objects: list[PlacedObject]) -> dict[str, np.ndarray]:
    """Return the triangles of the regions of all variants, those of a shared region once, and the outlines around."""
    regions = _regions(objects)
    number = {key: i for i, key in enumerate(regions)}
    used = np.array([number[id(mine)] for o in objects for mine in o.surfaces], int)
    surfaces = surfaces_of_regions(objects)
    triangles, adr, num = ranges([t for surface in mine for t in surface.triangles] for mine in regions.values())
    corners = np.reshape(triangles, (-1, 3, 2))
    sums = [np.cumsum(weights) for weights in np.split(supports.weights(corners), adr[1:])]
    side, fields = addressed("surface_edge", (supports.edges(s.outline) for s in surfaces))
    side = np.reshape(side, (-1, 2, 2))
    return {
        "obj_cutnum": np.array([_cuts(o) for o in objects], int),
        "variant_triadr": adr[used],
        "variant_trinum": num[used],
        "tri_surface": np.array([i for i, surface in enumerate(surfaces) for _ in surface.triangles], int),
        "tri_a": corners[:, 0],
        "tri_b": corners[:, 1],
        "tri_c": corners[:, 2],
        "tri_cdf": np.concatenate([*(s / s[-1] for s in sums if len(s)), np.zeros(0)]),
        "surface_height": np.array([s.height for s in surfaces]),
        **fields,
        "surface_winding": np.array([_convex_turn(supports.edges(s.outline)) for s in surfaces], int),
        "edge_a": side[:, 0],
        "edge_b": side[:, 1],
    }


def _regions(objects: list[PlacedObject]) -> dict[int, list[SupportSurface]]:
    """Return the lists of surfaces of all variants, a shared one once, by their identity."""
    return {id(mine): mine for o in objects for mine in o.surfaces}


def surfaces_of_regions(objects: list[PlacedObject]) -> list[SupportSurface]:
    """Return the surfaces of all variants in the order of the fields `surface_*`."""
    return [surface for mine in _regions(objects).values() for surface in mine]


def _convex_turn(edges: np.ndarray) -> int:
    """Return 1 or -1 for the edges in a row of a convex ring that runs counter-clockwise or clockwise; else 0."""
    sides = edges[:, 1] - edges[:, 0]
    after = np.roll(sides, -1, axis=0)
    turns = np.arctan2(sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0], (sides * after).sum(axis=1))
    sign = 1 if turns.sum() > 0.0 else -1
    is_ring = np.array_equal(edges[:, 1], np.roll(edges[:, 0], -1, axis=0))
    is_convex = is_ring and (sign * turns >= 0.0).all() and abs(turns.sum()) < 2.0 * np.pi + 1e-6
    return sign if is_convex else 0


def cut_pieces(o: PlacedObject) -> int:
    """Return the most pieces that relations cut the region of an object into; points are never cut."""
    triangles = max((sum(len(s.triangles) for s in surfaces) for surfaces in o.surfaces), default=0)
    has_points = o.config.region is not None and o.config.region.points is not None
    return triangles * (min(_cuts(o), 1) if has_points else _cuts(o))


def _cuts(o: PlacedObject) -> int:
    """Return the pieces that the relations of an object cut each triangle into; 0 if its region is always the same."""
    in_space = o.support is None and any(o.surfaces)
    if o.config.relations or o.tilts or o.erosion > 0.0 or in_space:
        return math.prod(region_pieces(r) for r in o.config.relations)
    return 0
