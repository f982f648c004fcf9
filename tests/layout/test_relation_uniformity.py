"""Objects are spread evenly over the exact region that their relations leave, in every world another one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely

from sceniris_gym.scene.world import World
from sceniris_gym.tools.audit.auditor import Auditor
from sceniris_gym.tools.audit.geometry import poses_of
from sceniris_gym.tools.audit.relations import support_headings
from sceniris_gym.tools.dataset import make_table
from tests.layout.related import Shapes, scene
from tests.oracle.regions import region
from tests.oracle.uniformity import spread_p_value, turned_back

N = 1600
FLOOR_AREA = shapely.box(-1, -1, 1, 1)


@pytest.fixture(scope="module")
def shapes(tmp_path_factory) -> Shapes:
    """Assets that touch nothing, so that nothing but the region decides where an object is."""
    return Shapes(tmp_path_factory.mktemp("shapes"), airy=True)


def p_values(world: World, name: str, support: shapely.Geometry, seed: int) -> tuple[float, float]:
    """Make layouts and judge how an object is spread over the area that it could have been in.

    Returns:
        The probabilities of such a spread, seen in the world and in the frame of the first anchor.
    """
    table = make_table(world, N, seed)
    assert table.valid.all()
    outlines = Auditor(world.mjm, world.config, world.scene.bodies).outlines
    poses = poses_of(world.mjm, table.rows)
    seen = {other: outlines.outline(other, poses) for other in world.scene.bodies}
    under = support_headings(world.config, poses, world.mjm)[name]
    relations = world.config.objects[name].relations
    areas = np.full(N, support)
    for relation in relations:
        areas = shapely.intersection(areas, [region(relation, seen[name], seen, i, under[i]) for i in range(N)])
    points = seen[name].pivot[:, :2]
    heading = seen[relations[0].anchors[0]].heading
    return spread_p_value(points, areas), spread_p_value(*turned_back(points, areas, heading))


def fixture(asset: str, x: float, y: float, size: float = 0.05, **words: Any) -> dict[str, Any]:
    """A fixture within `size` of (x, y)."""
    box = [[x - size, y - size], [x + size, y + size]]
    return {"asset": asset, "kind": "fixture", "on": "floor", "region": {"box": box}, **words}


WORDS: dict[str, tuple[dict, ...]] = {
    "half plane": ({"front_of": "a"},),
    "wedge": ({"right_of": "a", "angle": 35},),
    "narrow wedge": ({"back_of": "a", "angle": 4},),
    "wedge across 180 degrees": ({"left_of": "a", "frame": "world", "angle": 50},),
    "wedge across 180 degrees that is wide": ({"direction": [-1, 0.02], "of": "a", "frame": "world", "angle": 130},),
    "half angle above 90 degrees": ({"back_of": "a", "angle": 150},),
    "half angle of 180 degrees": ({"back_of": "a", "angle": 180},),
    "disk": ({"near": "a", "distance": {"max": 0.4}},),
    "ring": ({"near": "a", "distance": {"min": 0.3, "max": 0.6}},),
    "far": ({"left_of": "a", "angle": 180, "distance": {"min": 0.7}},),
    "soft band": ({"near": "a", "distance": {"equal": 0.4}},),
    "slice of a ring": (
        {"direction": [1, -1], "of": "a", "frame": "b", "angle": 55, "distance": {"min": 0.2, "max": 0.7}},
    ),
    "slice of a ring across 180 degrees": ({"left_of": "a", "frame": "world", "angle": 70, "distance": {"min": 0.2}},),
    "near by bounds": ({"near": "a", "measure": "bounds", "distance": {"max": 0.1}},),
    "ring by bounds": ({"near": "a", "measure": "bounds", "distance": {"min": 0.1, "max": 0.3}},),
    "band by bounds": ({"near": "a", "measure": "bounds", "distance": {"equal": 0.2, "tolerance": 0.03}},),
    "side by bounds": ({"front_of": "a", "measure": "bounds", "angle": 60, "distance": {"min": 0.02, "max": 0.15}},),
    "between two": ({"between": ["a", "b"], "width": 0.3},),
    "between three": ({"between": ["a", "b", "c"]},),
    "two relations": ({"right_of": "a", "angle": 100}, {"near": "b", "distance": {"max": 0.5}}),
    "four relations": (
        {"right_of": "a", "angle": 170},
        {"near": "b", "distance": {"min": 0.1, "max": 0.8}},
        {"front_of": "c", "distance": {"min": 0.1}},
        {"between": ["a", "b"], "width": 1.5},
    ),
}


@pytest.mark.parametrize("name", WORDS)
def test_points_are_uniform_in_the_region(name: str, shapes: Shapes):
    """Anchors are drawn and turned anew in every world; the object is an L that is turned too."""
    anchors = {
        "a": fixture(shapes.odd, -0.1, 0.0),
        "b": fixture(shapes.bar, 0.4, 0.1),
        "c": fixture(shapes.cube, 0.1, 0.6),
    }
    thing = {"asset": shapes.odd, "on": "floor", "relations": list(WORDS[name])}
    assert min(p_values(scene({**anchors, "thing": thing}), "thing", FLOOR_AREA, seed=1)) > 0.001


def test_what_a_drawn_joint_carries_off_is_seen_where_it_is(shapes: Shapes):
    """A cart whose bounds are far from the pivot that its home state gives it: the ring around its bounds is whole."""
    anchors = {"a": fixture(shapes.cart, 0.0, 0.0, joints={"slide": {"value": 0.3}})}
    ring = {"near": "a", "measure": "bounds", "distance": {"min": 0.25, "max": 0.35}}
    thing = {"asset": shapes.cube, "on": "floor", "relations": [ring]}
    assert min(p_values(scene({**anchors, "thing": thing}), "thing", FLOOR_AREA, seed=2)) > 0.001
