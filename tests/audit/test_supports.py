"""Level surfaces and footprints: shapely has the areas in closed form, trimesh the volumes."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
import trimesh
from scipy.spatial.transform import Rotation

from sceniris_gym.audit.geometry import Form, Solid
from sceniris_gym.audit.supports import inside, level_surfaces, surface_of
from tests.audit.shapes import box

RNG = np.random.default_rng(5)


def surfaces(*parts: np.ndarray, open_above: bool = False) -> dict[float, shapely.Geometry]:
    """Return height -> area of the level surfaces of parts, heights in whole 0.1 mm."""
    return {round(s.height, 4): s.area for s in level_surfaces(dict(enumerate(parts)), open_above=open_above)}


def same(area: shapely.Geometry, expected: shapely.Geometry) -> bool:
    """Return whether two areas differ by less than 1 mm2."""
    return shapely.symmetric_difference(area, expected).area < 1e-6


TABLE = [box((-0.5, -0.3, 0.38), (0.5, 0.3, 0.4))] + [
    box((x, y, 0.0), (x + 0.04, y + 0.04, 0.38)) for x in (-0.48, 0.44) for y in (-0.28, 0.24)
]
TOP = shapely.box(-0.5, -0.3, 0.5, 0.3)


def test_the_top_of_a_table_carries_and_what_is_under_it_does_not():
    """Its legs end where the top begins; hollow or open above makes no difference to it."""
    for open_above in (False, True):
        found = surfaces(*TABLE, open_above=open_above)
        assert same(found.pop(0.4), TOP)
        assert not found


def test_what_stands_on_a_surface_is_no_part_of_it():
    """A block on the table is cut out of the top, and is a surface of its own."""
    found = surfaces(*TABLE, box((0.1, -0.1, 0.4), (0.3, 0.1, 0.5)))
    assert same(found[0.4], TOP - shapely.box(0.1, -0.1, 0.3, 0.1))
    assert same(found[0.5], shapely.box(0.1, -0.1, 0.3, 0.1))


def test_what_hangs_over_a_surface_counts_only_where_it_must_be_open_above():
    """A roof over half of the table, whose own top carries too."""
    roof = box((0.0, -0.3, 0.8), (0.5, 0.3, 0.82))
    assert same(surfaces(*TABLE, roof)[0.4], TOP)
    found = surfaces(*TABLE, roof, open_above=True)
    assert same(found[0.4], shapely.box(-0.5, -0.3, 0.0, 0.3))
    assert same(found[0.82], shapely.box(0.0, -0.3, 0.5, 0.3))


def test_parts_of_one_height_are_one_surface():
    """Two boards side by side, and a third one that is apart from them."""
    boards = [box((x, 0, 0), (x + 0.2, 0.2, 0.05)) for x in (0.0, 0.2, 0.5)]
    found = surfaces(*boards)
    assert list(found) == [0.05]
    assert same(found[0.05], shapely.box(0, 0, 0.4, 0.2) | shapely.box(0.5, 0, 0.7, 0.2))


@pytest.mark.parametrize(("width", "carries"), [(0.019, False), (0.021, True)])
def test_a_strip_must_be_two_centimetres_wide(width: float, carries: bool):
    """A narrower one carries nothing, however long."""
    assert bool(surfaces(box((0, 0, 0), (0.5, width, 0.1)))) == carries


@pytest.mark.parametrize(("degrees", "carries"), [(0.9, True), (1.1, False)])
def test_a_surface_is_level_up_to_one_degree(degrees: float, carries: bool):
    """A board that leans by less and by more."""
    lean = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    board = box((-0.1, -0.1, -0.01), (0.1, 0.1, 0.01)) @ lean.T
    assert bool(level_surfaces({0: board}, open_above=True)) == carries


@pytest.mark.parametrize(
    ("form", "size", "volume"),
    [
        (Form.CYLINDER, (0.3, 0.2), 2 * np.pi * 0.3**2 * 0.2),
        (Form.ELLIPSOID, (0.3, 0.2, 0.1), 4 / 3 * np.pi * 0.3 * 0.2 * 0.1),
        (Form.ROUNDED, (0.1, 0.25), np.pi * 0.1**2 * (4 / 3 * 0.1 + 0.5)),
    ],
)
def test_curved_surfaces_are_closed_and_hardly_too_small(form: Form, size: tuple, volume: float):
    """As hulls of points on them they have all but a thousandth of the volume in closed form."""
    ends = np.array([[0.0, 0, -0.25], [0, 0, 0.25]]) if form is Form.ROUNDED else np.zeros((0, 3))
    radius = size[0] if form is Form.ROUNDED else 0.0
    solid = Solid(0, form, ends, np.zeros((0, 3), int), radius, np.resize(size, 3))
    mesh = trimesh.Trimesh(*surface_of(solid))
    assert mesh.is_watertight
    assert 0.998 * volume < mesh.volume < volume


def test_inside_is_where_shapely_says_and_away_from_the_edge():
    """A room with a pillar: random points, by themselves and with a distance that each must keep."""
    area = shapely.box(0, 0, 1, 1) - shapely.box(0.4, 0.4, 0.6, 0.6)
    points = RNG.uniform(-0.2, 1.2, (500, 2))
    erosion = RNG.uniform(0.0, 0.2, 500)
    there = np.array([area.contains(shapely.Point(p)) for p in points])
    away = np.array([area.boundary.distance(shapely.Point(p)) for p in points])
    np.testing.assert_array_equal(inside(area, points), there)
    np.testing.assert_array_equal(inside(area, points, erosion), there & (away > erosion))
