"""Areas drawn by the layer of supports: every layout's pivots are in them, and little else is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import shapely
from shapely.geometry import Point

from sceniris_gym.config.relations import KINDS, Relation
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.device import Cover
from sceniris_gym.viewer.deck import LayoutDeck, Where
from sceniris_gym.viewer.regions import (
    area_of,
    cover_over,
    is_covered_rightly,
    regions_left,
    relation_area,
    sketch_regions,
)
from sceniris_gym.viewer.shown import ShownWorld
from tests.layout.related import ONE_ANCHOR, Shapes, near_middle, related
from tests.layout.scenes import write_mjcf
from tests.viewer.worlds_on_show import world_of

_UP = np.array([0.0, 0.0, 1.0])
SCENES = ["mid", "hard_plus", "kitchen", "table_top", "clutter_push"]


@pytest.mark.parametrize("scene", SCENES)
def test_pivots_are_in_the_regions_that_are_drawn(scene: str):
    """In ten layouts, for every object that stands on something; a millimetre for rounding."""
    for seed in range(10):
        world = world_of(scene, seed)
        for name in world.placed_names:
            if world.compiled.config.objects[name].support is None:
                continue
            x, y, z, _ = world.standing(name)[0]
            near = [area for _, area, height in regions_left(world, name) if abs(height - z) < 0.005]
            assert shapely.union_all(near).buffer(1e-3).contains(Point(x, y)), f"{name}, seed {seed}"


def test_a_drawer_takes_its_region_along():
    """The banana's region is as far out as the drawer is, in every joint state."""
    for seed in range(5):
        world = world_of("mid", seed)
        drawer = world.data.body("cabinet/upper_drawer")
        ((_, area, height),) = [found for found in regions_left(world, "banana") if found[1].area > 0.01]
        middle = np.array([area.centroid.x, area.centroid.y])
        assert np.linalg.norm(middle - drawer.xpos[:2]) < 0.3
        assert height > drawer.xpos[2]


def test_what_no_roof_covers_is_no_inside():
    """The top of the cupboard is none of the places of what stands inside of it."""
    for seed in range(3):
        world = world_of("kitchen", seed)
        parts = world.compiled.config.objects
        owners = {name: part.inside.split("/")[0] for name, part in parts.items() if part.inside is not None}
        shown = [name for name in owners if world.is_shown(name)]
        assert shown
        for name in shown:
            top = world.box(owners[name])[1][2]
            heights = [height for _, area, height in regions_left(world, name) if not area.is_empty]
            assert heights
            assert max(heights) < top - 0.01


def test_pivots_are_in_the_area_of_every_relation(tmp_path: Path):
    """In that which is drawn. The things touch nothing, so that all of them are in one scene."""
    shapes = Shapes(tmp_path, airy=True)
    objects = {"a": near_middle(shapes.odd), "b": near_middle(shapes.bar, 0.8, 0.8)}
    words = [*(relation for relation, _ in ONE_ANCHOR.values()), {"between": ["a", "b"]}]
    things = {f"q{i}": {**related(shapes.odd, relation), "stands": False} for i, relation in enumerate(words)}
    compiled = compile_scene(SceneConfig.load({"floor": {"size": [2.0, 2.0]}, "objects": {**objects, **things}}), "cpu")
    deck = LayoutDeck(compiled, 1)
    for seed in range(5):
        world = ShownWorld(compiled, deck.make(Where(seed=seed)), stands=deck.stands("train"))
        for name in things:
            (relation,) = compiled.config.objects[name].relations
            area = relation_area(world, name, relation)
            assert area is not None
            assert area.buffer(1e-3).contains(Point(*world.standing(name)[0][:2])), relation


@pytest.mark.parametrize("num", [1, 2])
@pytest.mark.parametrize("align", ["left", "middle", None])
def test_open_furniture_is_in_the_area_beside_the_roots(tmp_path: Path, align: str | None, num: int):
    """One case in front of one of `num` others, with handles of 6 cm on open drawers: the area ends at the cases."""
    drawer = '<body><joint name="slide" type="slide" axis="0 -1 0" range="0 0.2"/><geom type="box" {}/></body>'
    shape = '<geom type="box" size=".15 .1 .05" pos="0 0 .05"/>' + drawer.format('size=".02 .03 .02" pos="0 -.13 .05"')
    assets = [write_mjcf(tmp_path, f"case_{i}", shape.replace(".15", f"{0.15 + 0.1 * i}")) for i in range(num)]
    case: dict[str, Any] = {"asset": assets[0], "kind": "fixture", "on": "floor"}
    case["joints"] = {"slide": {"fraction": [0.5, 1.0]}}
    row = {"beside": "a", "side": "front", "gap": 0.3, "align": align}
    words = {
        "a": {**case, "asset": assets if num > 1 else assets[0]},
        "b": {**case, "relations": [row], "orientation": {"with": "a"}},
    }
    compiled = compile_scene(SceneConfig.load({"floor": {"size": [3.0, 3.0]}, "objects": words}), "cpu")
    deck, (relation,) = LayoutDeck(compiled, 1), compiled.config.objects["b"].relations
    for seed in range(5):
        world = ShownWorld(compiled, deck.make(Where(seed=seed)), stands=deck.stands("train"))
        area, own, other = relation_area(world, "b", relation), world.standing("b"), world.standing("a")
        assert area is not None
        assert area.buffer(1e-3).contains(Point(*own[0][:2]))
        whole = area_of(relation, own, [other], own[0][3] - np.pi / 2, ())
        assert not whole.buffer(0.05).contains(Point(*own[0][:2]))  # further away, by a handle


def test_every_kind_of_relation_has_an_area():
    """Of its own, or that of its base."""
    assert all(area_of.dispatch(kind) is not area_of.dispatch(Relation) for kind in KINDS)


def test_relations_cut_the_region():
    """`front_of` leaves the half of the floor before the cabinet, beyond the least distance."""
    world = world_of("hard_plus", 1)
    (_, area, _), *_ = regions_left(world, "apple")
    (x, y, _, heading), _ = world.standing("cabinet")
    points = np.array([p for part in area.geoms for p in part.exterior.coords])[:, :2] - [x, y]
    front = np.array([np.sin(heading), -np.cos(heading)])  # the front of an asset is its -y
    assert np.all(points @ front > -1e-6)
    assert np.all(np.linalg.norm(points, axis=1) > 0.5 - 1e-3)


def test_objects_of_one_region_share_its_words():
    """Five things on one table: one surface, whose words name them all."""
    sketch = sketch_regions(world_of("tabletop_lift"))
    assert len(sketch.surfaces) == 1
    assert [text for text, _ in sketch.labels] == ["tin, orange, can, lemon, block here"]
    assert sketch.lines


def test_many_regions_that_are_nearly_the_same_share_their_words():
    """Twenty things on one table, each a little farther from its edge than another."""
    sketch = sketch_regions(world_of("clutter"))
    assert len(sketch.surfaces) > 10
    assert len(sketch.labels) <= 3
    assert " more here" in sketch.labels[0][0]


def test_where_nothing_is_left_it_says_so():
    """A relation that no point of the support fulfils leaves no surface, but words."""
    objects = {
        "bowl": {"asset": "bowl", "on": "floor", "region": {"box": [[-0.1, -0.1], [0.1, 0.1]]}},
        "apple": {"asset": "apple", "on": "floor"},
    }
    world = world_of({"floor": {"size": [1.0, 1.0]}, "objects": objects})
    config = world.compiled.config.objects["apple"]
    far = config.model_validate(
        {**config.model_dump(exclude_unset=True), "relations": [{"near": "bowl", "distance": {"min": 3.0, "max": 3.1}}]}
    )
    world.placed("apple").__dict__["config"] = far
    sketch = sketch_regions(world, "apple")
    assert sketch.surfaces == []
    assert [text for text, _ in sketch.labels] == ["no region for apple"]


@pytest.mark.parametrize("near", [{}, {"relations": [{"near": "post", "distance": {"max": 0.5}}]}], ids=["all", "near"])
def test_points_are_drawn_as_discs(near: dict):
    """Around each point that is left, on a floor as in space."""
    post = {"kind": "marker", "region": {"points": [[0.0, 0.0, 0.0]]}}
    flat, high = [[0.1, 0.2], [-0.3, 0.0], [0.4, 0.4]], [[0.1, 0.2, 0.5], [-0.3, 0.0, 0.5], [0.4, 0.4, 0.5]]
    ground = {"kind": "marker", "on": "floor", "region": {"points": flat}, **near}
    space = {"kind": "marker", "region": {"points": high}, **near}
    world = world_of({"floor": {"size": [1.0, 1.0]}, "objects": {"post": post, "goal": ground, "star": space}})
    for name in ("goal", "star"):
        ((_, area, _),) = regions_left(world, name)
        left = flat[:2] if near else flat
        assert len(area.geoms) == len(left)
        assert all(area.contains(Point(x, y)) for x, y in left)
        assert area.area < len(left) * 1e-4
    assert len(sketch_regions(world).surfaces) == 3


def is_covered(world: ShownWorld, bodies: list[int], at: np.ndarray) -> bool:
    """Return whether a ray up from a point meets something of some bodies that collides."""
    mjm, data = world.compiled.mjm, world.data
    solid = np.flatnonzero(np.isin(mjm.geom_bodyid, bodies) & ((mjm.geom_contype | mjm.geom_conaffinity) > 0))
    distances = [
        mujoco.mj_rayMesh(mjm, data, g, at, _UP, np.zeros(3))
        if mjm.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH
        else mujoco.mju_rayGeom(
            data.geom_xpos[g], data.geom_xmat[g], mjm.geom_size[g], at, _UP, mjm.geom_type[g], np.zeros(3)
        )
        for g in solid
    ]
    return max(distances, default=-1.0) >= 0.0


@pytest.mark.parametrize("scene", ["mid", "kitchen"])
def test_a_roof_is_where_a_ray_up_meets_something(scene: str):
    """At random points over the supports of all objects that ask for cover, or for none, away from its rims."""
    rng, judged = np.random.default_rng(0), [0, 0]
    world = world_of(scene, 1)
    for name in world.placed_names:
        placed = world.placed(name)
        if placed.cover == Cover.EITHER:
            continue
        assert placed.support is not None
        assert placed.support.owner is not None
        parent = world.compiled.scene.subtree(placed.support.owner)
        for surface in placed.surfaces[0]:
            mat, pos = world.data.xmat[surface.body].reshape(3, 3), world.data.xpos[surface.body]
            x0, y0, x1, y1 = surface.outline.bounds
            for x, y in rng.uniform((x0, y0), (x1, y1), (60, 2)):
                at = mat @ [x, y, surface.height] + pos
                cover = cover_over(world, placed, float(at[2]))
                if shapely.distance(cover.boundary, Point(at[:2])) > 1e-3:
                    covered = cover.contains(Point(at[:2]))
                    assert covered == is_covered(world, parent, at + [0.0, 0.0, 2e-4]), f"{name} at {at}"
                    judged[covered] += 1
    assert min(judged) >= 10


def test_a_region_is_cut_as_the_word_asks():
    """The inside of the cabinet's drawer is covered; an object that stands in the open part has the rest."""
    world = world_of("mid", 1)
    banana = world.placed("banana")
    assert banana.cover != Cover.EITHER
    ((_, left, height),) = [found for found in regions_left(world, "banana") if not found[1].is_empty]
    around = left.envelope.buffer(0.1)
    cover = cover_over(world, banana, height)
    kept = is_covered_rightly(world, banana, around, height)
    other = around.difference(cover) if banana.cover == Cover.OPEN else around.intersection(cover)
    assert shapely.symmetric_difference(kept, other).area < 1e-9
    assert 0.0 < kept.area < around.area
