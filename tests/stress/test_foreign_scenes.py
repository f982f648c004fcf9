"""The judge of other packages' scenes finds what was pushed into something, and nothing else."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.layout.compile import compile_scene
from tests.scene.memory import NEAR, cubes_on, model_text
from tests.stress.foreign_scenes import COMPOSED, SCENES, depths


def test_what_was_pushed_into_something_is_found():
    """A cube 5 mm inside the ground, and two cubes inside each other; a layout as it was made has no contact."""
    mjm = mujoco.MjModel.from_xml_string(model_text(cubes=2))
    objects = cubes_on("ground", 2, region=NEAR)
    compiled = compile_scene({"model": mjm, "objects": objects, "home": "init_state", "bank": 3}, "cpu")
    qpos = compiled.bank.qpos.numpy()[:3]
    qpos[1, 4] -= 0.0055
    qpos[2, 9:16] = qpos[2, 2:9] + [0.03, 0, 0, 0, 0, 0, 0]
    nothing = np.zeros((3, 0, 3)), np.zeros((3, 0, 4))
    found = depths(compiled, qpos, *nothing)
    assert found[0] == 0.0
    assert found[1] == pytest.approx(0.005, abs=1e-4)
    assert found[2] > 0.001


def test_scenes_are_as_short_as_they_should_be():
    """Ten lines at most, with that of the model's path."""
    for path, words in SCENES.items():
        assert len(words.strip().splitlines()) + (path not in COMPOSED) <= 10
