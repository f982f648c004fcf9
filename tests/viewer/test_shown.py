"""One world as layers see it: who is there, where, and who is parked."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.viewer.layers import sketch_relations
from sceniris_gym.viewer.shown import ShownWorld
from tests.viewer.worlds_on_show import world_of

GROUPED = {
    "floor": {"size": [1.0, 1.0]},
    "objects": {name: {"asset": name, "on": "floor"} for name in ("apple", "pear", "can")},
    "groups": {"fruit": {"of": ["apple", "pear", "can"], "count": 1}},
}


@pytest.mark.parametrize("scene", ["hard_plus", "tabletop_lift", "clutter_push"])
def test_a_state_alone_says_where_objects_stand(scene: str):
    """Pivots, headings and bounds are those that the generator has for the same layout."""
    world = world_of(scene, 4)
    alone = ShownWorld(world.compiled, world.table)
    for name in world.placed_names:
        (place, bounds), (known, known_bounds) = alone.standing(name), world.standing(name)
        assert place[:3] == pytest.approx(known[:3], abs=1e-4)
        assert np.cos(place[3] - known[3]) == pytest.approx(1.0, abs=1e-5)
        assert bounds == pytest.approx(known_bounds, abs=2e-3)


def test_absent_objects_are_hidden_and_can_be_shown_before_the_scene():
    """Two of three; their offsets bring them from where they are parked to beside the floor."""
    world = world_of(GROUPED)
    assert len(world.absent) == 2
    assert len(world.placed_names) == 1
    bodies = {world.compiled.scene.bodies[name] for name in world.absent}
    assert set(world.hidden_bodies()) == bodies
    assert world.hidden_bodies(with_absent=False) == []
    low = np.array([-0.5, -0.5, 0.0])
    offsets = world.parked_offsets(low)
    assert set(offsets) == bodies
    for body, offset in offsets.items():
        moved = world.data.xpos[body] + offset
        assert np.all(np.abs(moved[:2]) < 1.0)
        assert moved[1] < -0.5


def test_what_has_no_place_yet_is_not_shown():
    """It is hidden, and no layer is about it."""
    world = world_of("mid")
    early = ShownWorld(world.compiled, world.table, frozenset({"banana"}))
    assert not early.is_shown("banana")
    assert early.placed_names == ["cabinet", "apple"]
    assert early.hidden_bodies() == world.compiled.scene.subtree("banana")


def test_an_object_is_the_variant_that_is_there():
    """Its name stands for that variant, and the generator's own pivot is the one of the state."""
    things = {"asset": ["apple", "can", "pear"], "on": "floor", "region": {"box": [[-0.2, -0.2], [0.2, 0.2]]}}
    near = [{"near": "thing", "distance": {"max": 0.3}}]
    objects = {"thing": things, "mug": {"asset": "mug", "on": "floor", "relations": near}}
    world = world_of({"floor": {"size": [1.0, 1.0]}, "objects": objects}, 3)
    own = world.own("thing")
    assert world.placed_names == [own, "mug"]
    assert world.is_shown("thing")
    alone = ShownWorld(world.compiled, world.table)
    for name in (own, "thing"):
        assert alone.standing(name)[0][:3] == pytest.approx(world.standing(own)[0][:3], abs=1e-4)
    assert len(sketch_relations(world, "mug").surfaces) == 1
    assert world.box("thing")[0] == pytest.approx(world.box(own)[0])
