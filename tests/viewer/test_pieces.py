"""The layer of pieces: what collides, where it is, in one surface a body."""

from __future__ import annotations

import numpy as np

from sceniris_gym.viewer.pieces import sketch_pieces
from tests.viewer.worlds_on_show import world_of


def test_surfaces_are_where_bodies_collide():
    """One for each body that collides, and one for the floor; that of the apple is around the apple."""
    world = world_of("mid")
    mjm = world.compiled.mjm
    collides = {int(b) for b in mjm.geom_bodyid[(mjm.geom_contype | mjm.geom_conaffinity) != 0]}
    sketch = sketch_pieces(world)
    assert len(sketch.surfaces) == len(collides)
    middles = [vertices.mean(axis=0) for vertices, _, _, _ in sketch.surfaces]
    apple = world.data.xpos[world.compiled.scene.bodies["apple"]]
    assert min(np.linalg.norm(middle - apple) for middle in middles) < 0.05
    for vertices, faces, _, opacity in sketch.surfaces:
        assert faces.max() < len(vertices)
        assert 0.0 < opacity <= 1.0
