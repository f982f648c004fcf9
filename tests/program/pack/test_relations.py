"""Relations in numbers, joined sites, slices of rings; and regions as triangles with their chances and outlines."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString
from shapely.ops import polygonize

from sceniris_gym.config.relations import Beside, Between, Direction, Joined, Near, Relation, RelationType, Sector
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, ScenirisError, UnknownNameError
from sceniris_gym.program.device import FRAME_SUPPORT, FRAME_WORLD, FREE
from sceniris_gym.program.pack.relations import (
    MOST_SLICES,
    _winding,
    cut_pieces,
    joined_sites,
    pack_relations,
    region_pieces,
)
from tests.layout.scenes import box_mjcf, write_mjcf
from tests.program.scenes import Packed, pack, scene_of

SIDES = ("front", "back", "left", "right")
# Seen from above, x to the right and y to the back.
DIRECTIONS = {"front": (0, -1), "back": (0, 1), "left": (-1, 0), "right": (1, 0)}
BLOCK = """
<mujoco><worldbody><body name="block"><geom type="box" size=".2 .1 .1" pos=".3 0 .1"/>
  <site name="front" pos=".3 -.1 .1" euler="0 0 -90"/><site name="up" euler="0 -90 0"/>
  <body name="lid" pos="0 0 .3"><joint name="hinge" axis="0 1 0" range="0 90"/><geom size=".02"/>
    <site name="knob"/></body>
</body></worldbody></mujoco>"""
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
def packed(folder: Path) -> Packed:
    """An object with a relation of each kind, one whose only relation names it, and one without any."""
    box = {"asset": str(folder / "box.xml"), "on": "floor"}
    relations = [
        {"left_of": "robot", "angle": 30, "frame": "world", "distance": {"min": 0.1}},
        {"near": "post", "distance": {"equal": 0.5, "tolerance": 0.02}, "measure": "bounds"},
        {"between": ["tail", "post", "robot"], "width": 0.3},
        {"beside": "post", "side": "front", "gap": 0.07, "frame": "tail"},
    ]
    objects = {
        "box": {**box, "relations": relations},
        "last": {**box, "relations": [{"direction": [1, 1], "of": "box", "frame": "support"}]},
        "post": {**box, "kind": "fixture"},
        "tail": {"asset": box["asset"], "kind": "static"},
    }
    return pack(scene_of(objects, robot={"asset": "panda"}))


def _rows(packed: Packed, name: str) -> list[dict[str, Any]]:
    """The packed relations of an object, one after the other, anchors as names."""
    keys = ("type", "frame", "heading", "half_angle", "low", "high", "bounds", "width", "beside")
    lists = {key: packed.listed(name, "rel", f"rel_{key}") for key in (*keys, "anchoradr", "anchornum")}
    rows = [{key: lists[key][i] for key in lists} for i in range(len(lists["type"]))]
    for row in rows:
        adr = row.pop("anchoradr")
        slots = packed["rel_anchor"][adr : adr + row.pop("anchornum")]
        row["anchors"] = [packed.plan.slots[slot] for slot in slots]
    return rows


def test_relations_stand_with_their_object_in_the_order_of_the_file(packed: Packed):
    """Whatever the order of placement; an object without any has none."""
    assert [r["type"] for r in _rows(packed, "box")] == [
        RelationType.SECTOR, RelationType.SECTOR, RelationType.BETWEEN, RelationType.BESIDE,
    ]  # fmt: skip
    assert [r["type"] for r in _rows(packed, "last")] == [RelationType.SECTOR]
    assert _rows(packed, "post") == []
    assert sum(packed["obj_relnum"]) == len(packed["rel_type"]) == 5


def test_what_the_file_says_is_there_in_metres_and_radians(packed: Packed):
    """Anchors and frames by name, what has no limit far away, and every direction by the heading that it means."""
    left, near, between, beside = _rows(packed, "box")
    (last,) = _rows(packed, "last")
    assert [r["anchors"] for r in (left, near, between, beside, last)] == [
        ["robot"], ["post"], ["tail", "post", "robot"], ["post"], ["box"],
    ]  # fmt: skip
    assert (left["heading"], left["half_angle"]) == pytest.approx((math.pi, math.radians(30)))
    assert left["low"] == 0.1
    assert left["high"] > 1e20
    assert left["frame"] == FRAME_WORLD
    assert (near["low"], near["high"], near["bounds"]) == pytest.approx((0.48, 0.52, 1))
    assert near["half_angle"] == pytest.approx(math.pi)
    assert between["width"] == 0.3
    assert beside["heading"] == pytest.approx(-0.5 * math.pi)
    assert list(beside["beside"]) == pytest.approx([0.07, FREE])
    assert packed.plan.slots[beside["frame"]] == "tail"
    assert packed.plan.slots[near["frame"]] == "post"
    assert last["frame"] == FRAME_SUPPORT
    assert (last["heading"], last["half_angle"]) == pytest.approx((0.25 * math.pi, 0.5 * math.pi))


@pytest.mark.parametrize("side", SIDES)
def test_a_side_is_its_direction(side: str, folder: Path):
    """The heading points where the word says, for `..._of` and for `beside`; frames that are not named are anchors."""
    box = {"asset": str(folder / "box.xml"), "on": "floor"}
    relations = [{f"{side}_of": "post"}, {"beside": "post", "side": side}]
    packed = pack(scene_of({"post": {**box, "kind": "fixture"}, "box": {**box, "relations": relations}}))
    for row in _rows(packed, "box"):
        assert (math.cos(row["heading"]), math.sin(row["heading"])) == pytest.approx(DIRECTIONS[side], abs=1e-9)
        assert packed.plan.slots[row["frame"]] == "post"


def _slices(relation: Sector) -> list[shapely.Polygon]:
    """The slices of a sector about the origin: between two rays, the inner arc's chord and the outer one's tangent."""
    n = region_pieces(relation)
    half = relation.half_angle / n
    inner, outer = relation.low, relation.high / math.cos(half)
    found = []
    for i in range(n):
        low, high = (-relation.half_angle + 2.0 * half * k for k in (i, i + 1))
        rays = [(math.cos(a), math.sin(a)) for a in (low, high)]
        corners = [rays[0], rays[1]], [rays[1], rays[0]]
        points = [(inner * x, inner * y) for x, y in corners[0]] + [(outer * x, outer * y) for x, y in corners[1]]
        found.append(shapely.Polygon(points).buffer(0.0))
    return found


@pytest.mark.parametrize(
    "distance",
    [
        {"max": 1.0},
        {"min": 0.4, "max": 0.5},
        {"min": 0.01, "max": 2.0},
        {"equal": 1.0, "tolerance": 0.01},
        {"equal": 0.2, "tolerance": 0.001},
    ],
    ids=str,
)
@pytest.mark.parametrize("angle", [None, 10, 90, 135], ids=str)
def test_slices_hold_their_ring_and_little_more(distance: dict, angle: float | None):
    """By areas: all of the ring is in them, and half of them is ring; they are convex, apart and 30 degrees at most."""
    words: dict[str, Any] = {"distance": distance}
    relation = Near(near="a", **words) if angle is None else Direction(front_of="a", angle=angle, **words)
    half, low, high = relation.half_angle, relation.low, relation.high
    turn = np.linspace(-half, half, 4001)
    arcs = [np.stack([r * np.cos(t), r * np.sin(t)], axis=1) for r, t in ((high, turn), (low, turn[::-1]))]
    ring = shapely.Polygon(np.concatenate(arcs)).buffer(0.0)
    slices = _slices(relation)
    assert 2.0 * half / len(slices) <= math.radians(30.0) + 1e-9
    assert shapely.union_all(slices).buffer(1e-6).covers(ring)
    assert sum(s.area for s in slices) == pytest.approx(shapely.union_all(slices).area, rel=1e-6)
    assert all(s.convex_hull.area == pytest.approx(s.area, rel=1e-6) for s in slices)
    assert half * (high**2 - low**2) > 0.5 * sum(s.area for s in slices)


def test_slices_are_never_more_than_there_is_room_for_nor_wider_than_half_a_turn():
    """The thinnest ring has the most; without a distance two half planes are all around, and one is a half."""
    thinnest = {"near": "a", "distance": {"equal": 100.0, "tolerance": 1e-4}}
    assert region_pieces(Near.model_validate(thinnest)) == MOST_SLICES
    counts = [region_pieces(Direction(front_of="a", angle=a)) for a in (1, 90, 91, 180)]
    assert counts == [1, 1, 2, 2]
    assert region_pieces(Between(between=("a", "b"))) == 1
    assert region_pieces(Beside(beside="a", side="left")) == 1


INSISTS = {
    "nothing": ({}, False),
    "a distance between origins": ({"relations": [{"near": "post", "distance": {"max": 1}}]}, False),
    "a distance between bounds": (
        {"relations": [{"near": "post", "distance": {"max": 1}, "measure": "bounds"}]},
        True,
    ),
    "beside": ({"relations": [{"beside": "post", "side": "left"}]}, True),
    "a strip of a given width": (
        {"relations": [{"between": ["post", "tail"], "width": 0.1}], "orientation": "any"},
        False,
    ),
    "a strip as wide as itself": ({"relations": [{"between": ["post", "tail"]}], "orientation": "any"}, True),
    "a strip as wide as what never turns over": ({"relations": [{"between": ["post", "tail"]}]}, False),
    "an edge that any turn keeps from": ({"ratio_on_support": 1.0, "orientation": "any"}, True),
    "an edge that one of several poses may fit": ({"ratio_on_support": 1.0, "orientation": "stable"}, True),
    "an edge for the only pose": ({"ratio_on_support": 1.0}, False),
}


@pytest.mark.parametrize("case", INSISTS)
def test_an_object_insists_where_its_own_draw_may_open_a_region(case: str, folder: Path):
    """An empty region that none of the object's draws could open is not asked again."""
    words, insists = INSISTS[case]
    box = {"asset": str(folder / "box.xml"), "on": "floor"}
    objects = {"post": {**box, "kind": "fixture"}, "tail": {**box, "kind": "fixture"}, "thing": {**box, **words}}
    packed = pack(scene_of(objects))
    assert bool(packed["obj_retry_if_empty"][packed.number("thing")]) is insists


def test_a_relation_of_no_known_shape_is_refused(packed: Packed):
    """By its kind, since a kernel would take it for `beside`."""

    class Orbit(Relation):
        one_of = ("orbits",)
        orbits: str

    box = packed.object("box")
    assert box.config is not None
    orbiting = replace(box, config=box.config.model_copy(update={"relations": (Orbit(orbits="post"),)}))
    with pytest.raises(AttributeError, match="'Orbit' object has no attribute 'type'"):
        pack_relations(replace(packed.plan, objects=[orbiting]), {})


def blocks(folder: Path, beside: dict[str, Any], gap: float = 0.0, **other: Any) -> Packed:
    """Two blocks, the second one joined to the first."""
    (folder / "block.xml").write_text(BLOCK)
    words = {"asset": str(folder / "block.xml"), "on": "floor"}
    relation = {"beside": {"of": "a", **beside}} | ({"gap": gap} if gap else {})
    return pack(scene_of({"a": {**words, **other}, "b": {**words, "relations": [relation]}}))


def test_sites_are_measured_from_pivots_at_heading_zero(tmp_path: Path):
    """The pivot is below the middle of the box, 30 cm beside the root, and the lid does not move it."""
    packed = blocks(tmp_path, {"site": "front", "of_site": "front"}, gap=0.05)
    relation = packed.scene.config.objects["b"].relations[0]
    assert isinstance(relation, Joined)
    found = joined_sites(packed.plan, "b", relation, "here")
    pivot = packed.object("a").stable_poses[0].pivot
    assert found.to == "a"
    assert found.own == pytest.approx([0.3 - pivot[0], -0.1 - pivot[1]])
    assert found.at[0] == pytest.approx(found.own + [0.0, -0.05])
    assert abs(found.yaw) == pytest.approx([np.pi])
    i = packed.number("b")
    assert packed["obj_yaw"][i] == pytest.approx([*found.yaw, *found.yaw])
    assert packed["obj_with"].tolist() == [-1, packed.plan.slots.index("a")]
    assert packed["rel_sites"][0] == pytest.approx(np.array([[*found.own, 0.0], [*found.at[0], 0.0]]))


WRONG: dict[str, tuple[dict, dict, type[ScenirisError], str]] = {
    "an unknown site of its own": (
        {"site": "frnt", "of_site": "front"}, {}, UnknownNameError,
        r"b\.relations\.0\.beside\.site: unknown site of 'b' 'frnt'\. Did you mean 'front'\? Valid: front, knob, up",
    ),
    "an unknown site of the other": (
        {"site": "front", "of_site": "bottom"}, {}, UnknownNameError,
        r"beside\.of_site: unknown site of 'a' 'bottom'\..* Valid: front",
    ),
    "one on a lid": ({"site": "knob", "of_site": "front"}, {}, SceneKeyError, "on 'b/lid', which joints move"),
    "one that points up": ({"site": "up", "of_site": "front"}, {}, SceneKeyError, "x axis of site 'up' is vertical"),
    "of what may lie": (
        {"site": "front", "of_site": "front"}, {"orientation": "any"}, SceneKeyError, "'a' has the orientation 'any'",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("beside", "other", "error", "says"), WRONG.values(), ids=WRONG.keys())
def test_sites_that_join_nothing_are_refused(tmp_path: Path, beside: dict, other: dict, error: type, says: str):
    """With the key, and the sites that there are."""
    with pytest.raises(error, match=says):
        blocks(tmp_path, beside, **other)


def test_words_that_name_no_sites_keep_their_hash():
    """`beside: NAME` is written as it was before sites could be named."""
    objects: dict[str, Any] = {"a": {"asset": "mug", "on": "floor"}}
    objects["b"] = {**objects["a"], "relations": [{"beside": "a", "side": "left"}]}
    assert '"beside":"a"' in SceneConfig.load({"floor": {"size": [1, 1]}, "objects": objects}).canonical()


@pytest.fixture
def rack(tmp_path: Path) -> dict[str, Any]:
    """A rack that stays where it is."""
    return {"asset": write_mjcf(tmp_path, "rack", RACK), "kind": "static"}


@pytest.fixture
def brick(tmp_path: Path) -> dict[str, Any]:
    """A brick on the rack, with three different sides."""
    return {"asset": box_mjcf(tmp_path, "brick", 0.16, 0.1, 0.03), "on": "rack"}


def _triangles(packed: Packed, stable: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners (n, 3, 2), cumulated shares and surfaces of the triangles of a stable pose."""
    adr, num = packed["stable_triadr"][stable], packed["stable_trinum"][stable]
    corners = np.stack([packed[f"tri_{corner}"][adr : adr + num] for corner in "abc"], axis=1)
    return corners, packed["tri_cdf"][adr : adr + num], packed["tri_surface"][adr : adr + num]


def _stable_poses(packed: Packed) -> list[tuple[int, list]]:
    """All stable poses that have a region: number and surfaces."""
    surfaces = [s for o in packed.plan.objects for s in o.surfaces]
    return [(i, mine) for i, mine in enumerate(surfaces) if mine]


@pytest.mark.parametrize("words", [{}, {"ratio_on_support": 0.9, "orientation": "stable"}], ids=["whole", "eroded"])
def test_triangles_are_the_region_and_come_up_by_their_areas(rack: dict, brick: dict, words: dict):
    """Of every pose: they fill the region at each height and no more, and shares grow by their parts of its area."""
    packed = pack(scene_of({"rack": rack, "brick": {**brick, **words}}))
    poses = _stable_poses(packed)
    assert len(poses) == (6 if words else 1)
    for i, surfaces in poses:
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
        ranges = {*zip(packed["stable_triadr"].tolist(), packed["stable_trinum"].tolist(), strict=True)}
        poses = packed.object("brick").stable_poses
        assert (len(poses), len({round(v.short_edge, 6) for v in poses})) == (6, 2)
        assert len(ranges) == regions
        assert sum(num for _, num in ranges) == len(packed["tri_a"])


def test_edges_are_the_outlines_of_their_surfaces(rack: dict, brick: dict):
    """Holes too; an erosion leaves them alone, since footprints are judged by them."""
    packed = pack(scene_of({"rack": rack, "brick": {**brick, "ratio_on_support": 0.9}}))
    ((_, surfaces),) = _stable_poses(packed)
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
        assert _winding(_ring(ccw)) == 1
        assert _winding(_ring(ccw[::-1])) == -1
        about = points - points.mean(axis=0)
        star = points[np.argsort(np.arctan2(about[:, 1], about[:, 0]))]
        if len(hull) < len(points):
            assert _winding(_ring(star)) == 0
    square = np.array([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [0, 2]], float)
    assert _winding(_ring(square)) == 1
    assert _winding(_ring(square[::-1])) == -1


def test_outlines_with_holes_of_two_parts_or_that_wind_twice_are_not_convex():
    """Though each ring by itself may be."""
    square = np.array([[0, 0], [4, 0], [4, 4], [0, 4]], float)
    assert _winding(np.concatenate([_ring(square), _ring(square[::-1] / 4 + 1)])) == 0
    assert _winding(np.concatenate([_ring(square), _ring(square + 9)])) == 0
    angles = np.arange(5) * 2 * np.radians(72)
    assert _winding(_ring(np.stack([np.cos(angles), np.sin(angles)], axis=1))) == 0


def test_what_is_not_placed_on_anything_has_no_triangles():
    """A box in space is drawn without; for a relation there its shadow is one surface."""
    here = {"region": {"box": [[-0.2, -0.3, 0.2], [0.2, 0.3, 0.6]]}}
    relation = [{"near": "a", "distance": {"max": 1.0}}]
    packed = pack(scene_of({"a": {"asset": "apple", **here}, "b": {"asset": "can", **here, "relations": relation}}))
    assert packed["stable_trinum"].tolist() == [0, 2]
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
    corners, share, surface = _triangles(packed, packed["obj_stableadr"][packed.number("brick")])
    assert np.allclose(corners, np.array(points["points"])[:, None])
    assert share.tolist() == [0.25, 0.5, 0.75, 1.0]
    assert len(set(surface.tolist())) == 2
    ring = {"near": "rack", "distance": {"equal": 2.0, "tolerance": 1e-4}}
    cut = pack(scene_of({"rack": rack, "brick": {**brick, "region": points, "relations": [ring]}}))
    assert [cut_pieces(o) for o in (packed.object("brick"), cut.object("brick"))] == [0, 4]
