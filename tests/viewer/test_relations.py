"""The layer of relations: an arrow from every anchor, an area that holds the object, and words."""

from __future__ import annotations

import numpy as np

from sceniris_gym.config.relations import Relation
from sceniris_gym.viewer.relations import describe, sketch_relations
from tests.viewer.worlds_on_show import world_of


def test_arrows_lead_from_anchors_to_objects():
    """One for `front_of` and `right_of`, three for `between` three; they end at the object that is placed."""
    world = world_of("hard_plus", 2)
    sketch = sketch_relations(world)
    assert len(sketch.arrows) == 1 + 1 + 3
    ends = np.array([arrow[:, :2] for arrow, _ in sketch.arrows])
    at = {name: world.standing(name)[0][:2] for name in ("cabinet", "mug", "apple", "orange")}
    assert np.allclose(ends[0], [at["cabinet"], at["apple"]])
    assert np.allclose(ends[1], [at["cabinet"], at["mug"]])
    assert np.allclose(ends[2:, 1], at["orange"])
    assert len(sketch.surfaces) == 3


def test_one_object_alone_can_be_looked_at():
    """The others' relations are left out."""
    assert len(sketch_relations(world_of("hard_plus", 2), "mug").arrows) == 1
    assert sketch_relations(world_of("mid")).arrows == []


def test_relations_are_said_in_a_line():
    """The word, its anchors, and its distance."""
    words = {"right_of": "plate", "distance": {"min": 0.1, "max": 0.5}}
    assert describe(Relation.model_validate(words)) == "right_of plate, at least 0.1 m, at most 0.5 m"
    beside = Relation.model_validate({"beside": "table", "side": "front", "gap": 0.03})
    assert describe(beside) == "beside table, front, gap 0.03 m"
    near = {"near": "pan", "measure": "bounds", "distance": {"max": 0.3}}
    assert describe(Relation.model_validate(near)) == "near pan, at most 0.3 m between bounds"
