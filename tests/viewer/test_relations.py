"""The layer of relations: an arrow from every anchor, an area that holds the object, and words."""

from __future__ import annotations

import mujoco
import numpy as np

from sceniris_gym.viewer.relations import sketch_relations
from tests.viewer.worlds_on_show import world_of


def test_arrows_lead_from_anchors_to_objects():
    """One for `front_of` and `right_of`, three for `between` three; they end above the object that is placed."""
    world = world_of("hard_plus", 2)
    sketch = sketch_relations(world)
    assert len(sketch.arrows) == 1 + 1 + 3
    ends = np.array([arrow for arrow, _ in sketch.arrows])
    pairs = [("cabinet", "apple"), ("cabinet", "mug"), ("cabinet", "orange"), ("mug", "orange"), ("apple", "orange")]
    for (tail, tip), (anchor, name) in zip(ends, pairs, strict=True):
        at, to = (world.standing(n)[0][:2] for n in (anchor, name))
        assert np.allclose(tip[:2], to)
        assert world.box(name)[1][2] < tip[2] < world.box(name)[1][2] + 0.05
        along, whole = tail[:2] - at, to - at
        assert abs(along[0] * whole[1] - along[1] * whole[0]) < 1e-6, "on the way from pivot to pivot"
        assert 0.0 <= along @ whole < whole @ whole
    assert len(sketch.surfaces) == 3


def test_an_anchor_hides_nothing_of_its_arrows():
    """A ray back from the tip meets the cabinet itself no sooner than the arrow's tail, however high the cabinet is."""
    for seed in range(4):
        world = world_of("hard_plus", seed)
        cabinet, geom = world.compiled.scene.bodies["cabinet"], np.zeros(1, np.int32)
        for ends, _ in sketch_relations(world, "apple").arrows:
            back = ends[0] - ends[1]
            groups = np.ones(6, np.uint8)
            far = mujoco.mj_ray(world.compiled.mjm, world.data, ends[1], back, groups, 1, -1, geom)
            body = world.compiled.mjm.geom_bodyid[geom[0]]
            assert far < 0.0 or far >= 1.0 - 1e-6 or body != cabinet


def test_one_object_alone_can_be_looked_at():
    """The others' relations are left out."""
    assert len(sketch_relations(world_of("hard_plus", 2), "mug").arrows) == 1
    assert sketch_relations(world_of("mid")).arrows == []
