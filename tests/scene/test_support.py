"""Supports by name: the floor, parts of objects, and static geoms and bodies of the model."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import UnknownNameError
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.support import Support, is_static, static_supports
from tests.scene.memory import cubes_on, spec_of


def test_what_never_moves_is_found_by_the_names_of_geoms_and_bodies():
    """Geoms of the world and of welded bodies; nothing that is free, jointed or moved by mocap."""
    model = spec_of().compile()
    found = static_supports(model, {"cabinet": model.body("cab/cabinet").id})
    assert set(found) == {"ground", "ledge", "roof", "terrain", "cab/cabinet", "cab/case"}
    assert found["ground"] == Support(model.body("terrain").id, None, model.geom("ground").id)
    assert found["terrain"] == Support(model.body("terrain").id)
    assert found["ledge"].body == 0
    assert found["cab/case"].owner == "cabinet"
    spec = spec_of()
    spec.body("cab/cabinet").mocap = True
    moved = spec.compile()
    assert "cab/case" not in static_supports(moved, {})
    assert np.count_nonzero(is_static(moved)[moved.geom_bodyid]) == 3


def test_names_of_objects_and_the_floor_go_before_those_of_the_model():
    """With `floor` the word means the ground workspace; otherwise a geom of that name is one like others."""
    spec = spec_of()
    spec.geom("ground").name = "floor"
    plain = build_model(SceneConfig.load({"model": spec, "objects": {"terrain": {"body": "cube_0/cube"}}}))
    assert plain.support("floor", "here").geom == plain.mjm.geom("floor").id
    assert plain.support("terrain", "here") == Support(plain.mjm.body("cube_0/cube").id, "terrain")
    with_floor = build_model(SceneConfig.load({"model": spec, "floor": {"size": [1, 1]}}))
    assert with_floor.support("floor", "here") == Support(0, is_floor=True)


def test_an_unknown_support_lists_what_there_is():
    """With the nearest name first, and without a model the objects alone."""
    with pytest.raises(UnknownNameError, match=r"cube_0\.on: unknown support 'legde'\. Did you mean 'ledge'\?"):
        build_model(SceneConfig.load({"model": spec_of(), "objects": cubes_on("legde", 1)}))
