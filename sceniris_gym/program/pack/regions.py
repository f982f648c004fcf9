"""The regions of a plan, triangulated, as fields of `device.Program`."""

from __future__ import annotations

import math

import numpy as np

from sceniris_gym.config.limits import MAX_PIECES
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry import supports
from sceniris_gym.geometry.ragged import ranges
from sceniris_gym.program.pack.relations import MOST_SLICES, region_pieces, relations_of
from sceniris_gym.program.plan import PlacedObject, Plan


def pack_regions(plan: Plan, where: str) -> dict[str, np.ndarray]:
    """Triangles of the regions of all variants; those that share one have it once."""
    surfaces: list[supports.SupportSurface] = []
    triangles, owners, cdf = [np.zeros((0, 3, 2))], [], [np.zeros(0)]
    adr, num = [], []
    for o in plan.objects:
        places: dict[int, tuple[int, int]] = {}
        for mine in o.surfaces:
            if id(mine) not in places:
                parts = [supports.triangulate(s.region) for s in mine]
                corners = np.concatenate([*parts, np.zeros((0, 3, 2))])
                share = np.cumsum(supports.weights(corners))
                places[id(mine)] = (len(owners), len(corners))
                owners += [len(surfaces) + i for i, part in enumerate(parts) for _ in part]
                surfaces += mine
                triangles.append(corners)
                cdf.append(share / share[-1] if len(share) else share)
            adr.append(places[id(mine)][0])
            num.append(places[id(mine)][1])
        _check_cuts(o, max((n for _, n in places.values()), default=0), where)
    side, edgeadr, edgenum = ranges(supports.edges(s.outline) for s in surfaces)
    side = np.reshape(side, (-1, 2, 2))
    corners = np.concatenate(triangles)
    return {
        "obj_cutnum": np.array([_cuts(o) for o in plan.objects], int),
        "obj_erosion": np.array([o.erosion for o in plan.objects], float),
        "variant_triadr": np.array(adr, int),
        "variant_trinum": np.array(num, int),
        "tri_surface": np.array(owners, int),
        "tri_a": corners[:, 0],
        "tri_b": corners[:, 1],
        "tri_c": corners[:, 2],
        "tri_cdf": np.concatenate(cdf),
        "surface_height": np.array([s.height for s in surfaces]),
        "surface_edgeadr": edgeadr,
        "surface_edgenum": edgenum,
        "surface_winding": np.array([_convex_turn(supports.edges(s.outline)) for s in surfaces], int),
        "edge_a": side[:, 0],
        "edge_b": side[:, 1],
    }


def _convex_turn(edges: np.ndarray) -> int:
    """1 or -1 for the edges, one after the other, of a convex ring that runs counter-clockwise or clockwise; else 0."""
    sides = edges[:, 1] - edges[:, 0]
    after = np.roll(sides, -1, axis=0)
    turns = np.arctan2(sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0], (sides * after).sum(axis=1))
    sign = 1 if turns.sum() > 0.0 else -1
    is_ring = np.array_equal(edges[:, 1], np.roll(edges[:, 0], -1, axis=0))
    is_convex = is_ring and (sign * turns >= 0.0).all() and abs(turns.sum()) < 2.0 * np.pi + 1e-6
    return sign if is_convex else 0


def _cuts(o: PlacedObject) -> int:
    """How many pieces the relations of an object cut each triangle into; 0 where its region is never another one."""
    in_space = o.support is None and any(o.surfaces)
    if relations_of(o) or o.tilts or o.erosion > 0.0 or in_space:
        return math.prod(region_pieces(r) for r in relations_of(o))
    return 0


def _check_cuts(o: PlacedObject, triangles: int, where: str) -> None:
    points = None if o.config is None or o.config.region is None else o.config.region.points
    pieces = triangles * (_cuts(o) if points is None else min(_cuts(o), 1))
    if pieces > MAX_PIECES and points is not None:
        raise SceneKeyError(
            f"{where}: objects.{o.name}.region: has {len(points):,} points on several surfaces, {pieces:,} together, "
            f"and there is room for {MAX_PIECES:,}. Use fewer points, or a part of the support with fewer surfaces."
        )
    if pieces > MAX_PIECES:
        raise SceneKeyError(
            f"{where}: objects.{o.name}.relations: together cut the region into {pieces} pieces, and there is "
            f"room for {MAX_PIECES}. Use fewer rings, or wider ones: a thin one makes up to {MOST_SLICES} slices."
        )
