"""The layers by name."""

from __future__ import annotations

import numpy as np

from sceniris_gym.viewer.layers import HINTS, PARKED, REACH, SKETCHES, sketch_names
from tests.viewer.worlds_on_show import world_of


def test_names_stand_above_their_objects():
    """All objects, or one."""
    world = world_of("mid")
    words = dict(sketch_names(world).words)
    assert set(words) == {"cabinet", "apple", "banana"}
    apple = world.data.xpos[world.compiled.scene.bodies["apple"]]
    assert np.linalg.norm(words["apple"][:2] - apple[:2]) < 0.05
    assert words["apple"][2] > apple[2]
    assert [name for name, _ in sketch_names(world, "apple").words] == ["apple"]


def test_every_layer_has_a_hint():
    """Every layer has a sentence that tells what it shows."""
    assert set(HINTS) == {*SKETCHES, PARKED, REACH}
    assert all(hint.endswith(".") for hint in HINTS.values())
