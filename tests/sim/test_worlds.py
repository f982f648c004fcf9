"""`make_worlds`: Model and Data of the simulated scene, with rows for each world, and room for contacts."""

import mujoco_warp as mjw
import numpy as np
import pytest

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.sim.batch import default_budget
from sceniris_gym.sim.fit import make_worlds
from sceniris_gym.sim.randomizer import ResetRandomizer

VARIED = {
    "bank": 4,
    "objects": {
        "table": {"asset": "table", "kind": "static"},
        "thing": {"asset": ["can", "mug"], "on": "table", "randomize": {"friction": {"scale": [0.5, 2.0]}}},
    },
}


def test_worlds_have_rows_for_variants_draws_and_named_fields():
    """One row per world in these fields and no others; a reset writes them and a step runs."""
    compiled = compile_scene(VARIED, "cpu")
    model, data = make_worlds(compiled, 3, fields="dof_damping")
    assert data.nworld == 3
    assert {getattr(model, name).shape[0] for name in ("body_mass", "geom_friction", "dof_damping")} == {3}
    assert model.jnt_solref.shape[0] == 1
    randomizer = ResetRandomizer(compiled, model, data, seed=3)
    randomizer.reset()
    mjw.step(model, data)
    assert np.isfinite(data.qpos.numpy()).all()


def test_the_default_room_is_that_of_the_scene(small_scene):
    """And a number of one's own replaces it."""
    nconmax, njmax = default_budget(small_scene.sim_mjm, small_scene.scene)
    _, data = make_worlds(small_scene, 2)
    assert (data.naconmax, data.njmax) == (2 * nconmax, njmax)
    _, data = make_worlds(small_scene, 2, nconmax=5, njmax=7)
    assert (data.naconmax, data.njmax) == (10, 7)


@pytest.mark.parametrize(
    ("words", "error", "message"),
    [
        ({"nworld": 0}, ArgumentError, "make_worlds: nworld"),
        ({"nconmax": 1.5}, ArgumentError, "make_worlds: nconmax"),
        ({"fields": "geom_size"}, UnknownNameError, "geom_size"),
        ({"fields": 3}, ArgumentTypeError, "make_worlds: fields"),
        ({"compiled": "mid"}, ArgumentTypeError, "make_worlds: compiled"),
    ],
)
def test_wrong_arguments_are_refused(small_scene, words, error, message):
    """By the name of the argument."""
    with pytest.raises(error, match=message):
        make_worlds(**{"compiled": small_scene, "nworld": 2, **words})  # pyrefly: ignore[bad-argument-type]
