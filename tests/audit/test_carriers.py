"""Carriers of objects, as the audit reads their names: it must agree with the model, not with the generator."""

from __future__ import annotations

import pytest

from sceniris_gym.audit.carriers import Carrier, carrier_of
from sceniris_gym.audit.scene import JudgedScene
from sceniris_gym.config.scene import SceneConfig
from tests.scene.memory import cubes_on, spec_of


def test_names_mean_the_floor_objects_parts_geoms_and_bodies():
    """In this order."""
    model = spec_of().compile()
    objects = {**cubes_on("ground", 1), "cabinet": {"body": "cab/cabinet", "kind": "static"}}
    bodies = {"cube_0": model.body("cube_0/cube").id, "cabinet": model.body("cab/cabinet").id}
    config = SceneConfig.load({"model": model, "objects": objects})
    with_floor = SceneConfig.load({"model": model, "objects": objects, "floor": {"size": [1, 1]}})

    def carrier(parent: str, config: SceneConfig = config) -> Carrier:
        return carrier_of(JudgedScene(model, config, bodies), parent)

    assert carrier("floor", with_floor) == Carrier(0, is_ground=True)
    assert carrier("cube_0") == Carrier(bodies["cube_0"], owner="cube_0")
    assert carrier("cabinet/drawer") == Carrier(model.body("cab/drawer").id, owner="cabinet")
    assert carrier("ground") == Carrier(model.body("terrain").id, model.geom("ground").id)
    assert carrier("ledge") == Carrier(0, model.geom("ledge").id)
    assert carrier("cab/case") == Carrier(bodies["cabinet"], model.geom("cab/case").id, "cabinet")
    assert carrier("terrain") == Carrier(model.body("terrain").id)
    for name in ("nowhere", "floor"):  # without a floor in the scene file, 'floor' is a name like any other
        with pytest.raises(KeyError):
            carrier(name)
