"""The stances of a plan as the fields of `device_statics.Statics`."""

from __future__ import annotations

import mujoco
import numpy as np
import shapely

from sceniris_gym.config.limits import MAX_FOOT
from sceniris_gym.geometry.feet import around
from sceniris_gym.geometry.ragged import addressed
from sceniris_gym.geometry.resting_poses import weights
from sceniris_gym.geometry.supports import SupportSurface, triangulate
from sceniris_gym.program.device import fill_struct
from sceniris_gym.program.device_statics import DIRECTIONS, Statics
from sceniris_gym.program.pack.relations import surfaces_of_regions
from sceniris_gym.program.plan import Plan
from sceniris_gym.program.standing import CURVED, Foot, Roll, carriers_of

# MuJoCo takes the end of a cylinder for a polygon of 16 corners when it looks for contacts on a face.
_ROUND = np.cos(np.pi / 16)
_ENDLESS = np.zeros((0, 4))
"""The edges of a surface that no foot can leave."""
_NO_FOOT = Foot([np.zeros((1, 2))], CURVED, margin=0.0, most=0.0)
"""The foot of what need not stand."""


def pack_statics(plan: Plan, device: str) -> Statics | None:
    """Return how the objects of a plan stand, on a device; None if none of them can fall."""
    found, objects, mjm = plan.stances, plan.objects, plan.scene.mjm
    chains = [[] if stance.is_certain else stance.levels for stance in found]
    if not any(chains):
        return None
    carriers = carriers_of(objects)
    level, of_objects = addressed("obj_level", chains)
    load, of_levels = addressed("level_load", (part for i, c in enumerate(chains) for part in _loads(c, carriers, i)))
    feet = [f for o, s in zip(objects, found, strict=True) for f in s.feet or [_NO_FOOT] * len(o.variants)]
    foot, of_variants = addressed("variant_foot", (f.parts for f in feet))
    corner, of_feet = addressed("foot_corner", foot)
    whole = {id(x) for o, s in zip(objects, found, strict=True) if s.is_whole for mine in o.surfaces for x in mine}
    surfaces = surfaces_of_regions(objects)
    outlines = ([_ENDLESS] if id(x) in whole else _convex_parts(x) for x in surfaces)
    parts, of_surfaces = addressed("surface_part", outlines)
    side, of_parts = addressed("part_side", parts)
    leans = any(s.tilt for s in found)
    radius = [
        np.linalg.norm(np.concatenate(f.parts), axis=1).max() if f.margin > 0.0 and not leans else 1e30 for f in feet
    ]
    drawn = any(draw.word.field == "body_mass" for draw in plan.scene.draws)
    sink = np.array([s.sink for s in found])
    give = sink / np.maximum([s.load for s in found], mujoco.mjMINVAL)
    statics = Statics()
    arrays = {
        **{**of_objects, **of_levels, **of_variants, **of_feet, **of_surfaces, **of_parts},
        "direction": around(DIRECTIONS),
        "level_sink": np.array([found[i].sinks.get(n, 0.0) for n, c in enumerate(chains) for i in c]) * (not drawn),
        "obj_give": give * drawn,
        "obj_tilt": np.array([s.tilt for s in found]),
        "obj_touch": np.array([s.touch for s in found]),
        "variant_law": np.reshape([f.law for f in feet], (-1, len(CURVED))),
        **{f"variant_{name}": np.array([getattr(f.roll, name) for f in feet]) for name in Roll._fields},
        "variant_radius": np.array(radius, float),
        "corner": np.reshape(corner, (-1, 2)),
        "level_obj": np.array(level, int),
        "load": np.array(load, int),
        "side": np.reshape(side, (-1, 4)),
        "body_weight": weights(mjm)[None],
        "body_center": mjm.body_ipos[None],
    }
    fill_struct(Statics, statics, arrays, device)
    return statics


def _loads(chain: list[int], carriers: list[int | None], number: int) -> list[list[int]]:
    """Return the objects placed before number `number` that each of its levels carries beside the levels above it."""
    loads: dict[int, list[int]] = {i: [] for i in chain}
    for other in range(number):
        at: int | None = other
        while at is not None and at not in loads:
            at = carriers[at]
        if at is not None and at != other:
            loads[at].append(other)
    return list(loads.values())


def _convex_parts(surface: SupportSurface) -> list[np.ndarray]:
    """Return convex polygons that make up a surface: ends of their edges [m], counter-clockwise, shape (n, 4) each."""
    hull = surface.outline.convex_hull
    if hull.area - surface.outline.area > 1e-9:
        corners = list(triangulate(surface.outline))
    else:
        ring = shapely.get_coordinates(hull)[:-1]
        if len(ring) > MAX_FOOT:
            ring = ring[np.unique((ring @ around(MAX_FOOT).T).argmax(axis=0))]
            middle = shapely.get_coordinates(hull.centroid)
            ring = middle + _ROUND * (ring - middle)
        corners = [ring]
    rings = [np.asarray(shapely.geometry.polygon.orient(shapely.Polygon(c)).exterior.coords)[:, :2] for c in corners]
    return [np.hstack([ring[:-1], ring[1:]]) for ring in rings]
