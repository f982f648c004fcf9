"""Surfaces that carry: by hand for hand-made bodies, and for the shipped furniture."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import shapely
from shapely.geometry import MultiPoint, MultiPolygon, Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from sceniris_gym.config.objects import RegionConfig
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.geometry.supports import (
    SupportSurface,
    areas,
    crop,
    edges,
    level_surfaces,
    rectangle,
    triangulate,
    weights,
)
from sceniris_gym.scene.build import build_model

TABLE = """<geom type="box" size=".4 .3 .01" pos="0 0 .39"/>
  <geom type="box" size=".02 .02 .19" pos=".35 .25 .19"/><geom type="box" size=".02 .02 .19" pos="-.35 .25 .19"/>
  <geom type="box" size=".02 .02 .19" pos=".35 -.25 .19"/><geom type="box" size=".02 .02 .19" pos="-.35 -.25 .19"/>"""


def _surfaces(geoms: str, open_above: bool = True, geometry: str = "physics") -> list[SupportSurface]:
    mjm = mujoco.MjModel.from_xml_string(f'<mujoco><worldbody><body name="b">{geoms}</body></worldbody></mujoco>')
    return level_surfaces(1, extract_pieces(mjm, geometry), open_above=open_above)


def _box(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float, rest: str = "") -> str:
    size = f"{(x1 - x0) / 2} {(y1 - y0) / 2} {(z1 - z0) / 2}"
    return f'<geom type="box" size="{size}" pos="{(x0 + x1) / 2} {(y0 + y1) / 2} {(z0 + z1) / 2}" {rest}/>'


def _same(shape: BaseGeometry, expected: BaseGeometry, tolerance: float = 1e-5) -> bool:
    """Return whether two areas differ by slivers only."""
    return bool(shape.symmetric_difference(expected).area < tolerance)


@pytest.mark.parametrize("open_above", [True, False])
@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_a_table_carries_on_its_top_alone(open_above: bool, geometry: str):
    """Its legs end under the top: they carry nothing, whichever sky is asked for."""
    (top,) = _surfaces(TABLE, open_above, geometry)
    assert np.isclose(top.height, 0.4)
    assert _same(top.outline, box(-0.4, -0.3, 0.4, 0.3))
    assert top.region.equals(top.outline)
    assert top.body == 1


def test_what_stands_on_a_surface_and_what_hangs_over_it_is_taken_away():
    """A post on a board, and a roof over a part of it: the roof counts only where open sky is asked for."""
    geoms = _box(0, 1, 0, 1, 0, 0.1) + _box(0.4, 0.6, 0.4, 0.6, 0.1, 0.3) + _box(0.8, 1, 0, 1, 0.5, 0.6)
    for open_above in (True, False):
        board, post, roof = _surfaces(geoms, open_above)
        expected = box(0, 0, 1, 1) - box(0.4, 0.4, 0.6, 0.6)
        assert _same(board.outline, expected - box(0.8, 0, 1, 1) if open_above else expected)
        assert _same(post.outline, box(0.4, 0.4, 0.6, 0.6))
        assert _same(roof.outline, box(0.8, 0, 1, 1))
        assert np.allclose([board.height, post.height, roof.height], [0.1, 0.3, 0.6])


def test_rims_and_handles_of_less_than_two_centimetres_carry_nothing():
    """The walls of a box are 1.9 cm thick and carry nothing; at 2.1 cm they do."""
    for thick, carries in ((0.019, False), (0.021, True)):
        geoms = _box(0, 0.4, 0, 0.4, 0, 0.01) + _box(0, 0.4, 0, thick, 0, 0.2) + _box(0, 0.4, 0.4 - thick, 0.4, 0, 0.2)
        geoms += _box(0, thick, 0, 0.4, 0, 0.2) + _box(0.4 - thick, 0.4, 0, 0.4, 0, 0.2)
        found = _surfaces(geoms)
        assert len(found) == 1 + carries
        assert _same(found[0].outline, box(thick, thick, 0.4 - thick, 0.4 - thick))
        if carries:
            assert np.isclose(found[1].height, 0.2)
            assert _same(found[1].outline, box(0, 0, 0.4, 0.4) - box(thick, thick, 0.4 - thick, 0.4 - thick))


def test_a_narrow_strip_beside_a_wide_surface_carries_nothing():
    """A board with a tongue of 1.5 cm at its own height, and one of 3 cm on the other side."""
    geoms = _box(0, 0.3, 0, 0.2, 0, 0.02) + _box(0.3, 0.5, 0.1, 0.115, 0, 0.02) + _box(-0.2, 0, 0.1, 0.13, 0, 0.02)
    (board,) = _surfaces(geoms)
    assert _same(board.outline, box(0, 0, 0.3, 0.2) | box(-0.2, 0.1, 0, 0.13))


def test_neighbouring_tops_of_one_height_are_one_surface():
    """Two boxes side by side, and one a tenth of a millimetre higher; a step of a millimetre parts them."""
    for step, count in ((0.0, 1), (1e-4, 1), (1e-3, 2)):
        found = _surfaces(_box(0, 0.1, 0, 0.1, 0, 0.1) + _box(0.1, 0.2, 0, 0.1, 0, 0.1 + step))
        assert len(found) == count
        assert np.isclose(found[-1].height, 0.1 + step)
        if count == 1:
            assert len(found[0].outline.geoms) == 1
            assert _same(found[0].outline, box(0, 0, 0.2, 0.1))


@pytest.mark.parametrize(("angle", "carries"), [(0.0, True), (0.5, True), (2.0, False), (90.0, True), (180.0, True)])
def test_a_face_carries_if_it_is_level(angle: float, carries: bool):
    """A plate at an angle about x: within a degree, on end and upside down."""
    found = _surfaces(f'<geom type="box" size=".1 .1 .1" euler="{angle} 0 0"/>')
    assert bool(found) == carries


def test_round_geoms_carry_on_their_flat_ends_only():
    """A cylinder has a top, a sphere and a lying cylinder have none."""
    (top,) = _surfaces('<geom type="cylinder" size=".1 .05"/>')
    assert np.isclose(top.height, 0.05)
    assert _same(top.outline, Point(0, 0).buffer(0.1), 1e-4)
    assert not _surfaces('<geom type="sphere" size=".1"/>')
    assert not _surfaces('<geom type="cylinder" size=".1 .05" euler="90 0 0"/>')
    assert not _surfaces('<geom type="capsule" size=".1 .05"/>')


def test_a_body_without_solid_geoms_has_no_surface():
    """Nothing, and a plane alone."""
    assert level_surfaces(1, [], open_above=True) == []


@pytest.mark.parametrize("open_above", [True, False])
@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize("drawer", ["upper_drawer", "lower_drawer"])
def test_the_floor_of_a_drawer_is_what_its_walls_leave(drawer: str, geometry: str, open_above: bool):
    """By hand: 36.4 x 27.7 cm between walls, front and back, 1.3 cm above the drawer's origin; no rim, no handle."""
    config = SceneConfig.load({"geometry": geometry, "objects": {"cabinet": {"asset": "cabinet", "kind": "static"}}})
    mjm = build_model(config).mjm
    body = mjm.body(f"cabinet/{drawer}").id
    (floor,) = level_surfaces(body, extract_pieces(mjm, geometry, {body}), open_above=open_above)
    assert np.isclose(floor.height, 0.013, atol=1e-4)
    expected = box(-0.182, 0.018, 0.182, 0.295)
    fillet = 0.0 if geometry == "physics" else 0.004  # the visible walls meet the floor in a round
    assert expected.buffer(1e-6).covers(floor.outline)
    assert floor.outline.buffer(1e-6).covers(expected.buffer(-fillet))


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_the_shipped_table_carries_on_its_top(geometry: str):
    """80 x 100 cm, 40 cm high, whatever hangs below; its edges may be bevelled by up to 5 mm."""
    config = SceneConfig.load({"geometry": geometry, "objects": {"table": {"asset": "table", "kind": "static"}}})
    mjm = build_model(config).mjm
    (top,) = level_surfaces(1, extract_pieces(mjm, geometry), open_above=True)
    assert np.isclose(top.height, 0.4, atol=1e-4)
    expected = box(-0.4, -0.5, 0.4, 0.5)
    assert expected.buffer(1e-6).covers(top.outline)
    assert top.outline.buffer(1e-6).covers(expected.buffer(-0.005))


def test_the_ground_lies_between_its_corners():
    """At the height of the world's origin."""
    ground = rectangle((-1.0, -0.25), (1.0, 0.25))
    assert ground.body == 0
    assert ground.height == 0.0
    assert ground.outline.bounds == (-1.0, -0.25, 1.0, 0.25)


L_SHAPE = Polygon([(0, 0), (0.4, 0), (0.4, 0.1), (0.1, 0.1), (0.1, 0.3), (0, 0.3)])


def _several(*shapes: BaseGeometry) -> MultiPolygon:
    return MultiPolygon([s for s in shapes if isinstance(s, Polygon)])


def _surface(*shapes: Polygon) -> SupportSurface:
    return SupportSurface(1, 0.1, MultiPolygon(shapes), MultiPolygon(shapes))


@pytest.mark.parametrize(
    ("region", "erosion", "expected"),
    [
        (None, 0.0, L_SHAPE),
        (None, 0.02, L_SHAPE.buffer(-0.02)),
        (RegionConfig(box=((0.05, 0.05), (0.9, 0.2))), 0.0, L_SHAPE & box(0.05, 0.05, 0.9, 0.2)),
        (RegionConfig(fraction=((0.5, 0.0), (1.0, 0.2))), 0.0, L_SHAPE & box(0.2, 0.0, 0.4, 0.06)),
        (RegionConfig(polygon=((0, 0), (0.4, 0), (0, 0.3))), 0.0, L_SHAPE & Polygon([(0, 0), (0.4, 0), (0, 0.3)])),
        (RegionConfig(box=((0.0, 0.0), (0.2, 0.3))), 0.03, L_SHAPE.buffer(-0.03, quad_segs=64) & box(0, 0, 0.2, 0.3)),
    ],
)
def test_a_region_is_cut_from_the_eroded_outline(region: RegionConfig | None, erosion: float, expected: BaseGeometry):
    """The outline stays whole: footprints are judged by it."""
    ((left,),) = crop([_surface(L_SHAPE)], region, [erosion], "here")
    assert _same(left.region, expected, 1e-6)
    assert left.outline.equals(MultiPolygon([L_SHAPE]))
    assert left.height == 0.1


def test_a_fraction_is_of_the_bounds_of_all_surfaces_together():
    """Two steps: the right half of both is the second one."""
    steps = [_surface(box(0, 0, 0.2, 0.2)), _surface(box(0.2, 0, 0.4, 0.2))]
    ((right,),) = crop(steps, RegionConfig(fraction=((0.5, 0.0), (1.0, 1.0))), [0.0], "here")
    assert _same(right.region, box(0.2, 0, 0.4, 0.2), 1e-9)


def test_surfaces_of_which_nothing_is_left_go_and_the_last_one_is_an_error():
    """The narrow step does not survive the erosion, the wide one does; at 15 cm neither does, which one pose may."""
    steps = [_surface(box(0, 0, 0.1, 1)), _surface(box(0.2, 0, 0.45, 1))]
    (wide,), none, same = crop(steps, None, [0.06, 0.15, 0.06], "here")
    assert none == []
    assert same == [wide]
    assert _same(wide.region, box(0.26, 0.06, 0.39, 0.94), 1e-6)
    with pytest.raises(
        SceneKeyError,
        match=r"here: no area of the support is left after erosion by 0.15 m. .* \[0, 0.45\] x \[0, 1\]",
    ):
        crop(steps, None, [0.16, 0.15], "here")


def test_points_are_on_the_surfaces_that_hold_them():
    """A point over two surfaces is on both; one nearer to an edge than the erosion is left out of that pose alone."""
    points = RegionConfig(points=((0.1, 0.1), (0.3, 0.1), (0.02, 0.1)))
    low, high = _surface(box(0, 0, 0.4, 0.2)), _surface(box(0, 0, 0.2, 0.2))
    whole, eroded = crop([low, high], points, [0.0, 0.05], "here")
    assert [shapely.get_coordinates(s.region).tolist() for s in whole] == [
        [[0.1, 0.1], [0.3, 0.1], [0.02, 0.1]],
        [[0.1, 0.1], [0.02, 0.1]],
    ]
    assert [shapely.get_coordinates(s.region).tolist() for s in eroded] == [[[0.1, 0.1], [0.3, 0.1]], [[0.1, 0.1]]]
    says = r"here: point 2 of the region, \[0.02, 0.1\], .* nearer to an edge of the surface than the 0.05 m that"
    with pytest.raises(SceneKeyError, match=says):
        crop([low, high], points, [0.06, 0.05], "here")


def test_points_are_triangles_whose_corners_coincide_and_no_area_has_any_of_those():
    """In single precision, too: a sliver that would collapse there is none of the triangles; all points weigh alike."""
    points = triangulate(MultiPoint([(0.1, 0.2), (0.3, 0.4)]))
    assert points.tolist() == [[[0.1, 0.2]] * 3, [[0.3, 0.4]] * 3]
    assert weights(points).tolist() == [1.0, 1.0]
    speck = Polygon([(8.0, 8.0), (8.0 + 1e-8, 8.0), (8.0, 8.0 + 1e-8)])
    assert len(triangulate(MultiPolygon([speck]))) == 0
    square = triangulate(MultiPolygon([box(0, 0, 1, 2)]))
    assert np.allclose(weights(square), areas(square))


def test_triangles_cover_a_region_with_holes_exactly():
    """Areas add up, no triangle leaves the region, and no two overlap."""
    region = _several(L_SHAPE.buffer(0.05) - Point(0.05, 0.05).buffer(0.03), box(1, 1, 1.1, 1.2))
    corners = triangulate(region)
    shapes = shapely.polygons(corners)
    np.testing.assert_allclose(areas(corners), shapely.area(shapes), rtol=1e-9)
    assert np.isclose(areas(corners).sum(), region.area)
    assert _same(shapely.union_all(shapes), region, 1e-9)


def test_edges_are_those_of_outlines_and_holes():
    """Their lengths add up to that of the boundary."""
    region = _several(box(0, 0, 1, 1) - box(0.2, 0.2, 0.4, 0.5), box(2, 0, 3, 1))
    sides = edges(region)
    assert sides.shape == (12, 2, 2)
    assert np.isclose(np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1).sum(), region.length)
    assert shapely.covers(region.boundary.buffer(1e-9), shapely.linestrings(sides)).all()


def test_an_endless_plane_stays_endless_when_it_is_cropped():
    """Its outline is no edge that anything may be drawn by."""
    (ground,) = _surfaces('<geom type="plane" size="0 0 .1"/>')
    assert ground.is_endless
    ((left,),) = crop([ground], RegionConfig(box=((-0.3, -0.3), (0.3, 0.3))), [0.0], "here")
    assert left.is_endless
    ((point,),) = crop([ground], RegionConfig(points=((0.1, 0.2),)), [0.0], "here")
    assert point.is_endless
