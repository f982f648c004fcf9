"""Regions as flat arrays: triangles that are the region, the chance of each, and the outlines around them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString
from shapely.ops import polygonize

from sceniris_gym.program.pack.regions import _convex_turn, cut_pieces
from sceniris_gym.program.pack.relations import region_pieces
from tests.layout.scenes import box_mjcf, write_mjcf
from tests.program.scenes import Packed, pack, scene_of

# A board with a hole, and a shelf of it that is higher.
RACK = "".join(
    f'<geom type="box" size="{x} {y} .01" pos="{px} {py} {z}"/>'
    for x, y, px, py, z in (
        (0.5, 0.1, 0, 0.4, 0.1),
        (0.5, 0.1, 0, -0.4, 0.1),
        (0.1, 0.3, 0.4, 0, 0.1),
        (0.1, 0.3, -0.4, 0, 0.1),
        (0.2, 0.2, 1.0, 0, 0.3),
    )
)


@pytest.fixture
def rack(tmp_path: Path) -> dict[str, Any]:
    """A rack that stays where it is."""
    return {"asset": write_mjcf(tmp_path, "rack", RACK), "kind": "static"}


@pytest.fixture
def brick(tmp_path: Path) -> dict[str, Any]:
    """A brick on the rack, with three different sides."""
    return {"asset": box_mjcf(tmp_path, "brick", 0.16, 0.1, 0.03), "on": "rack"}


def _triangles(packed: Packed, variant: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners (n, 3, 2), cumulated shares and surfaces of the triangles of a variant."""
    adr, num = packed["variant_triadr"][variant], packed["variant_trinum"][variant]
    corners = np.stack([packed[f"tri_{corner}"][adr : adr + num] for corner in "abc"], axis=1)
    return corners, packed["tri_cdf"][adr : adr + num], packed["tri_surface"][adr : adr + num]


def _variants(packed: Packed) -> list[tuple[int, list]]:
    """All variants that have a region: number and surfaces."""
    surfaces = [s for o in packed.plan.objects for s in o.surfaces]
    return [(i, mine) for i, mine in enumerate(surfaces) if mine]


@pytest.mark.parametrize("words", [{}, {"ratio_on_support": 0.9, "orientation": "stable"}], ids=["whole", "eroded"])
def test_triangles_are_the_region_and_come_up_by_their_areas(rack: dict, brick: dict, words: dict):
    """Of every pose: they fill the region at each height and no more, and shares grow by their parts of its area."""
    packed = pack(scene_of({"rack": rack, "brick": {**brick, **words}}))
    variants = _variants(packed)
    assert len(variants) == (6 if words else 1)
    for i, surfaces in variants:
        corners, shares, owners = _triangles(packed, i)
        shapes = np.asarray(shapely.polygons(corners))
        total = sum(s.region.area for s in surfaces)
        np.testing.assert_allclose(np.diff([0.0, *shares]), shapely.area(shapes) / total, atol=1e-12)
        assert shares[-1] == pytest.approx(1.0)
        heights = packed["surface_height"][owners]
        for surface in surfaces:
            own = shapely.union_all(shapes[heights == surface.height])
            assert own.symmetric_difference(surface.region).area < 1e-9
        assert {s.height for s in surfaces} == set(heights)


def test_poses_with_the_same_region_share_its_triangles(rack: dict, brick: dict):
    """Six poses of a brick have two breadths; without an erosion all have one region."""
    for words, regions in (({"ratio_on_support": 0.9}, 2), ({}, 1)):
        packed = pack(scene_of({"rack": rack, "brick": {**brick, "orientation": "stable", **words}}))
        ranges = {*zip(packed["variant_triadr"].tolist(), packed["variant_trinum"].tolist(), strict=True)}
        variants = packed.object("brick").variants
        assert (len(variants), len({round(v.short_edge, 6) for v in variants})) == (6, 2)
        assert len(ranges) == regions
        assert sum(num for _, num in ranges) == len(packed["tri_a"])


def test_edges_are_the_outlines_of_their_surfaces(rack: dict, brick: dict):
    """Holes too; an erosion leaves them alone, since footprints are judged by them."""
    packed = pack(scene_of({"rack": rack, "brick": {**brick, "ratio_on_support": 0.9}}))
    ((_, surfaces),) = _variants(packed)
    for k, surface in enumerate(surfaces):
        adr, num = packed["surface_edgeadr"][k], packed["surface_edgenum"][k]
        sides = np.stack([packed["edge_a"][adr : adr + num], packed["edge_b"][adr : adr + num]], axis=1)
        polygons = polygonize([LineString(side) for side in sides])
        around = shapely.union_all([p for p in polygons if surface.outline.covers(p.representative_point())])
        assert around.symmetric_difference(surface.outline).area < 1e-9
    assert {len(p.interiors) for s in surfaces for p in s.outline.geoms} == {0, 1}


def _ring(corners: Any) -> np.ndarray:
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def test_outlines_that_are_convex_are_known_with_their_direction():
    """Random ones against shapely, both ways round, and with corners in the middle of edges."""
    rng = np.random.default_rng(5)
    for _ in range(300):
        points = rng.normal(size=(int(rng.integers(3, 9)), 2))
        hull = shapely.get_coordinates(shapely.MultiPoint(points).convex_hull)[:-1]
        ccw = hull if shapely.LinearRing(hull).is_ccw else hull[::-1]
        assert _convex_turn(_ring(ccw)) == 1
        assert _convex_turn(_ring(ccw[::-1])) == -1
        about = points - points.mean(axis=0)
        star = points[np.argsort(np.arctan2(about[:, 1], about[:, 0]))]
        if len(hull) < len(points):
            assert _convex_turn(_ring(star)) == 0
    square = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [0, 2]], float)
    assert _convex_turn(_ring(square)) == 1
    assert _convex_turn(_ring(square[::-1])) == -1


def test_outlines_with_holes_of_two_parts_or_that_wind_twice_are_not_convex():
    """Though each ring by itself may be."""
    square = np.array([[0, 0], [4, 0], [4, 4], [0, 4]], float)
    assert _convex_turn(np.concatenate([_ring(square), _ring(square[::-1] / 4 + 1)])) == 0
    assert _convex_turn(np.concatenate([_ring(square), _ring(square + 9)])) == 0
    angles = np.arange(5) * 2 * np.radians(72)
    assert _convex_turn(_ring(np.stack([np.cos(angles), np.sin(angles)], axis=1))) == 0


def test_what_is_not_placed_on_anything_has_no_triangles():
    """A box in space is drawn without; for a relation there its shadow is one surface."""
    here = {"region": {"box": [[-0.2, -0.3, 0.2], [0.2, 0.3, 0.6]]}}
    relation = [{"near": "a", "distance": {"max": 1.0}}]
    packed = pack(scene_of({"a": {"asset": "apple", **here}, "b": {"asset": "can", **here, "relations": relation}}))
    assert packed["variant_trinum"].tolist() == [0, 2]
    corners, _, _ = _triangles(packed, 1)
    assert shapely.union_all(shapely.polygons(corners)).equals(shapely.box(-0.2, -0.3, 0.2, 0.3))


def test_a_triangle_is_cut_by_all_relations_together(rack: dict, brick: dict):
    """Into the product of their pieces; without a relation a region that changes has one piece, others have none."""
    relations = [{"near": "rack", "distance": {"min": 0.1, "max": 3.0}}, {"front_of": "rack", "angle": 120}]
    for words, cuts in (
        ({}, 0),
        ({"ratio_on_support": 0.9}, 0),
        ({"ratio_on_support": 0.9, "orientation": "any"}, 1),
        ({"relations": relations}, None),
    ):
        packed = pack(scene_of({"rack": rack, "brick": {**brick, **words}}))
        config = packed.object("brick").config
        assert config is not None
        expected = math.prod(region_pieces(r) for r in config.relations) if cuts is None else cuts
        assert packed["obj_cutnum"][packed.number("brick")] == expected
        assert cuts is not None or expected > 10


def test_points_are_drawn_alike_on_each_surface_that_holds_them(rack: dict, brick: dict):
    """Each is a triangle without area, however finely relations cut."""
    points = {"points": [[0.0, 0.4], [0.0, -0.4], [1.0, 0.1], [1.0, 0.0]]}
    packed = pack(scene_of({"rack": rack, "brick": {**brick, "region": points}}))
    corners, share, surface = _triangles(packed, packed["obj_variantadr"][packed.number("brick")])
    assert np.allclose(corners, np.array(points["points"])[:, None])
    assert share.tolist() == [0.25, 0.5, 0.75, 1.0]
    assert len(set(surface.tolist())) == 2
    ring = {"near": "rack", "distance": {"equal": 2.0, "tolerance": 1e-4}}
    cut = pack(scene_of({"rack": rack, "brick": {**brick, "region": points, "relations": [ring]}}))
    assert [cut_pieces(o) for o in (packed.object("brick"), cut.object("brick"))] == [0, 4]
