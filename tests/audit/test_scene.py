"""The scene as the audit sees it: carriers, whose names must agree with the model, and hulls of objects."""

import mujoco
import numpy as np
import pytest

from sceniris_gym.audit.scene import Carrier, JudgedScene
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
        return JudgedScene(model, config, bodies).carrier(parent)

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


def test_a_footprint_has_the_corners_of_all_parts():
    """Of a cube and a post through its top: all of the cube's, and the upper ones of the post. A mark is a point."""
    mjm = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body name="thing" pos="3 1 2" euler="0 0 40"><freejoint/>
        <geom type="box" size=".5 .5 .5" pos=".5 .5 .5"/>
        <geom type="box" size=".125 .125 .75" pos=".375 .375 1.25"/></body>
        <body name="mark" mocap="true"/></worldbody></mujoco>"""
    )
    objects = {"thing": {"asset": "thing", "on": "floor"}, "mark": {"kind": "marker", "on": "floor"}}
    scene = JudgedScene(mjm, SceneConfig.load({"floor": {"size": [2, 2]}, "objects": objects}), {"thing": 1, "mark": 2})
    hulls = scene.hulls(scene.solids)
    cube = {(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)}
    expected = sorted(cube | {(x, y, 2) for x in (0.25, 0.5) for y in (0.25, 0.5)})
    assert sorted(map(tuple, np.round(hulls["thing"], 9) + 0.0)) == [pytest.approx(p) for p in expected]
    assert hulls["mark"].tolist() == [[0.0, 0.0, 0.0]]
