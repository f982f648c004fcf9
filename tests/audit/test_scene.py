"""The scene as the audit sees it: the hulls of its objects."""

import mujoco
import numpy as np
import pytest

from sceniris_gym.audit.scene import JudgedScene
from sceniris_gym.config.scene import SceneConfig


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
