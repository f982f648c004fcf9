"""The relations of a plan, and the triangles of the regions that relations cut, as fields of `device.Program`."""

from __future__ import annotations

import math
from collections.abc import Container
from typing import NamedTuple

import numpy as np

from sceniris_gym.config.relations import Beside, Between, Joined, Relation, Sector
from sceniris_gym.errors import SceneKeyError, check_names
from sceniris_gym.geometry import supports
from sceniris_gym.geometry.ragged import addressed, columns, ranges
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.geometry.supports import SupportSurface
from sceniris_gym.program.device import FRAME_SUPPORT, FRAME_WORLD, FREE, OWN_WIDTH
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.program.plan import Plan

_NO_LIMIT = 1.0e30
# Slices of a ring have at most 30 degrees, and less in a thin ring. The gap between the chord and the tangent of a
# slice exceeds its width by about radius * angle^2 / 4, and this excess should be less than the width.
_SLICE = math.pi / 6.0
MOST_SLICES = 256
"""Greatest number of slices of a ring."""
# An x axis of a site does not define a heading if its horizontal part is shorter than this.
_UPRIGHT = 1e-2
_DRAWN = np.array([1.0, 0.0, 0.0, 0.0])  # empty bounds, in place of which `beside` takes the drawn bounds


def pack_relations(plan: Plan, joints: dict[str, JoinedSites]) -> dict[str, np.ndarray]:
    """Return the fields `rel_*`, and each object's range in these fields. `joints` is the result of `joints_of`."""
    owned = [(o, r) for o in plan.objects for r in o.config.relations]
    variants = plan.scene.config.variants
    named = [
        (*r.anchors, *(variants.get(r.anchors[0], ()) if isinstance(r, Beside | Joined) else ())) for _, r in owned
    ]
    roots = np.tile(_DRAWN, (len(owned), 1 + max(map(len, named), default=1), 1))
    sites = np.zeros((*roots.shape[:2], 3))
    for bounds, site, (o, r), names in zip(roots, sites, owned, named, strict=True):
        for name, found in plan.joined_bounds(o.name, r).items():
            bounds[(o.name, *names).index(name)] = found
        if isinstance(r, Joined):
            joined = joints[o.name]
            site[0, :2] = joined.own
            site[len(names) - len(joined.at) + 1 : len(names) + 1] = np.c_[joined.at, joined.yaw - joined.yaw[0]]
    relations, of_objects = addressed("obj_rel", (o.config.relations for o in plan.objects))
    sides = [sum(map(_sides, o.config.relations[:i])) for o in plan.objects for i in range(len(o.config.relations))]
    numbers = {name: column for column, name in enumerate(plan.columns)}
    anchors, of_relations = addressed("rel_anchor", ([numbers[name] for name in names] for names in named))
    frames = {"support": FRAME_SUPPORT, "world": FRAME_WORLD, **numbers}
    return {
        **of_objects,
        **of_relations,
        "obj_retry_if_empty": np.array([_insists(o) for o in plan.objects]),
        "rel_anchor": np.array(anchors, int),
        "rel_frame": np.array([frames[r.reference_frame] for r in relations], int),
        "rel_heading": np.array([r.heading(plan.scene.config.all_robots) for r in relations], float),
        **columns("rel", relations, type=1, half_angle=1, low=1),
        "rel_high": np.array([min(r.high, _NO_LIMIT) for r in relations], float),
        "rel_bounds": np.array([r.by_bounds for r in relations], int),
        "rel_width": np.array([(isinstance(r, Between) and r.width) or OWN_WIDTH for r in relations], float),
        "rel_beside": np.reshape([_beside(r, plan.scene.config.all_robots) for r in relations], (-1, 2)),
        "rel_root": roots,
        "rel_sites": sites,
        "rel_sideadr": np.array(sides, int),
        "rel_piecenum": np.array([region_pieces(r) for r in relations], int),
    }


def _beside(relation: Relation, robots: Container[str]) -> tuple[float, float]:
    """Return the gap [m] of a `beside`, and which ends are in line, or FREE. Return no gap for other relations."""
    if not isinstance(relation, Beside):
        return 0.0, FREE
    end = relation.aligned(robots)
    return relation.gap, FREE if end is None else end


def joints_of(plan: Plan) -> dict[str, JoinedSites]:
    """Return the sites of each object with a relation `beside` that names sites, by object name.

    Raises:
        UnknownNameError, SceneKeyError: As in `joined_sites`.
    """
    return {
        o.name: joined_sites(plan, o.name, relation, f"{plan.scene.config.where}: objects.{o.name}.relations.{i}")
        for o in plan.objects
        for i, relation in enumerate(o.config.relations)
        if isinstance(relation, Joined)
    }


def region_pieces(relation: Relation) -> int:
    """Return the number of convex pieces that together cover the places that a relation allows."""
    if not isinstance(relation, Sector):
        return 1
    angle = math.pi
    if relation.low > 0.0 or relation.high < math.inf:
        width = relation.high - relation.low
        thin = 2.0 * math.sqrt(width / relation.high) if relation.high < math.inf else _SLICE
        angle = max(min(thin, _SLICE), 2.0 * relation.half_angle / MOST_SLICES)
    return math.ceil(2.0 * relation.half_angle / angle - 1e-9)


def most_sides(plan: Plan) -> int:
    """For each object, add up the half-planes around all pieces of its relations. Return the greatest sum."""
    return max((sum(map(_sides, o.config.relations)) for o in plan.objects), default=0)


def _sides(relation: Relation) -> int:
    """Return the greatest number of half-planes of a relation, added up over all of its pieces."""
    return max(4, len(relation.anchors)) * region_pieces(relation)


def _insists(o: PlacedObject) -> bool:
    """Return whether a new draw of the orientation or joints may help if the region of a candidate is empty."""
    varies = len(o.stable_poses) > 1 or bool(o.joint_ranges) or o.orientation == "any"
    by_bounds = any(r.by_bounds or (varies and r.has_own_width) for r in o.config.relations)
    return by_bounds or o.erosion > 0.0 or len({id(surfaces) for surfaces in o.surfaces}) > 1


class JoinedSites(NamedTuple):
    """The sites that join one object to another, seen from above and with both headings 0.

    Attributes:
        to: Name of the other object.
        at: The point where the joined object's site has to be, relative to the pivot of the other object [m], for each
            of its variants, shape (n, 2). This is the other object's site, moved by the gap along the site's x axis.
        own: Position of the joined object's site relative to the joined object's pivot [m], shape (2,).
        yaw: The heading of the joined object minus the heading of the other object [rad], shape (n,).
    """

    to: str
    at: np.ndarray
    own: np.ndarray
    yaw: np.ndarray


def joined_sites(plan: Plan, name: str, relation: Joined, where: str) -> JoinedSites:
    """Return the sites that join an object to another.

    Args:
        plan: The plan.
        name: Name of the object.
        relation: The object's relation to the other object.
        where: The relation's key, as the beginning of errors.

    Raises:
        UnknownNameError: An object has no such site.
        SceneKeyError: A joint moves one of the sites, the site's x axis is vertical, or the site's object has the
            orientation `any` or `stable`.
    """
    words = relation.beside
    own, own_yaw = _site(plan, name, words.site, f"{where}.beside.site")
    at, yaw = [], []
    for one in plan.scene.config.variants.get(words.of, (words.of,)):
        its, its_yaw = _site(plan, one, words.of_site, f"{where}.beside.of_site")
        at.append(its + (relation.gap or 0.0) * np.array([math.cos(its_yaw), math.sin(its_yaw)]))
        yaw.append(math.remainder(its_yaw + math.radians(words.angle) - own_yaw, 2.0 * math.pi))
    return JoinedSites(words.of, np.array(at), own, np.array(yaw))


def _site(plan: Plan, name: str, word: str, where: str) -> tuple[np.ndarray, float]:
    """Return a site's position from the pivot [m] and the heading of its x axis [rad], for the object at heading 0."""
    scene, sites = plan.scene, plan.scene.sites(name)
    check_names(f"site of '{name}'", [word], where, sites)
    root, body = scene.bodies[name], int(scene.mjm.site_bodyid[sites[word]])
    while body != root:
        if scene.mjm.body_jntnum[body]:
            raise SceneKeyError(
                f"{where}: site '{word}' is on '{scene.mjm.body(body).name}', which joints move. Name a site fixed "
                f"to the root of '{name}'."
            )
        body = int(scene.mjm.body_parentid[body])
    placed = next((o for o in plan.objects if o.name == name and o.stable_poses), None)
    mat, pivot = _upright(placed, where) if placed is not None else _at_home(plan, name)
    back = plan.scene.home.xmat[root].reshape(3, 3).T
    pos = back @ (plan.scene.home.site_xpos[sites[word]] - plan.scene.home.xpos[root])
    x = mat @ back @ plan.scene.home.site_xmat[sites[word]].reshape(3, 3)[:, 0]
    if np.linalg.norm(x[:2]) < _UPRIGHT:
        raise SceneKeyError(
            f"{where}: the x axis of site '{word}' is vertical, so it gives no heading. Rotate the site by its "
            f"'euler' or 'quat' until its x axis points out of '{name}', towards the joined object."
        )
    return (mat @ (pos - pivot))[:2], math.atan2(x[1], x[0])


def _upright(placed: PlacedObject, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the orientation (3, 3) of a placed object at heading 0, and its pivot in the root body's frame [m]."""
    if placed.orientation in ("any", "stable"):
        raise SceneKeyError(
            f"{where}: '{placed.name}' has the orientation '{placed.orientation}', which tilts its site. Give the "
            "object a yaw, or the orientation 'fixed'."
        )
    return matrix(placed.stable_poses[0].quat), placed.stable_poses[0].pivot


def _at_home(plan: Plan, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the orientation and pivot, as `_upright` does, for an object that keeps its pose from the model."""
    root, pivot_pose = plan.scene.bodies[name], plan.pivot_pose[plan.slots.index(name)]
    mat = plan.scene.home.xmat[root].reshape(3, 3)
    level = matrix(np.array([math.cos(0.5 * pivot_pose[3]), 0.0, 0.0, -math.sin(0.5 * pivot_pose[3])])) @ mat
    return level, mat.T @ (pivot_pose[:3] - plan.scene.home.xpos[root])


def pack_regions(objects: list[PlacedObject]) -> dict[str, np.ndarray]:
    """Return the triangles and surface outlines of all regions. A region that several stable poses share comes once."""
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
        "stable_triadr": adr[used],
        "stable_trinum": num[used],
        "tri_surface": np.array([i for i, surface in enumerate(surfaces) for _ in surface.triangles], int),
        "tri_a": corners[:, 0],
        "tri_b": corners[:, 1],
        "tri_c": corners[:, 2],
        "tri_cdf": np.concatenate([*(s / s[-1] for s in sums if len(s)), np.zeros(0)]),
        "surface_height": np.array([s.height for s in surfaces]),
        **fields,
        "surface_winding": np.array([_winding(supports.edges(s.outline)) for s in surfaces], int),
        "edge_a": side[:, 0],
        "edge_b": side[:, 1],
    }


def _regions(objects: list[PlacedObject]) -> dict[int, list[SupportSurface]]:
    """Return the surface lists of all stable poses, by the `id` of each list. A shared list occurs only once."""
    return {id(mine): mine for o in objects for mine in o.surfaces}


def surfaces_of_regions(objects: list[PlacedObject]) -> list[SupportSurface]:
    """Return the surfaces of all regions, in the order of the fields `surface_*`."""
    return [surface for mine in _regions(objects).values() for surface in mine]


def _winding(edges: np.ndarray) -> int:
    """Return 1 if the edges form a convex counter-clockwise ring, -1 for a convex clockwise ring, and otherwise 0."""
    sides = edges[:, 1] - edges[:, 0]
    after = np.roll(sides, -1, axis=0)
    angles = np.arctan2(sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0], (sides * after).sum(axis=1))
    sign = 1 if angles.sum() > 0.0 else -1
    is_ring = np.array_equal(edges[:, 1], np.roll(edges[:, 0], -1, axis=0))
    is_convex = is_ring and (sign * angles >= 0.0).all() and abs(angles.sum()) < 2.0 * np.pi + 1e-6
    return sign if is_convex else 0


def cut_pieces(o: PlacedObject) -> int:
    """Return the greatest number of pieces into which relations cut an object's region. Points are never cut."""
    triangles = max((sum(len(s.triangles) for s in surfaces) for surfaces in o.surfaces), default=0)
    has_points = o.config.region is not None and o.config.region.points is not None
    return triangles * (min(_cuts(o), 1) if has_points else _cuts(o))


def _cuts(o: PlacedObject) -> int:
    """Return into how many pieces an object's relations cut a triangle. 0 if the region is the same in all worlds."""
    in_space = o.support is None and any(o.surfaces)
    if o.config.relations or o.tilts or o.erosion > 0.0 or in_space:
        return math.prod(region_pieces(r) for r in o.config.relations)
    return 0
