"""A scene's camera sees what is placed, and not behind the robot; and pictures show each body once."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from sceniris_gym.scene.backdrop import OVERVIEW
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.overview import Overview, picture_groups

WITH_ROBOT = ["tabletop_lift", "tabletop_reach", "clutter_push", "drawer_pick"]
GROUPS = np.array([1, 1, 1, 0, 0, 0], np.uint8)


def camera_of(mjm: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Return position and axes of the camera in a state."""
    mujoco.mj_kinematics(mjm, data)
    mujoco.mj_comPos(mjm, data)
    mujoco.mj_camlight(mjm, data)
    camera = data.camera(OVERVIEW)
    return camera.xpos.copy(), camera.xmat.reshape(3, 3).copy()


@pytest.mark.parametrize("name", [*WITH_ROBOT, "mid", "clutter"])
def test_objects_are_in_the_picture_and_not_behind_the_robot(name: str):
    """In 20 layouts every free object projects into a picture of 4:3, and the robot hides few of them."""
    compiled = compile_scene(name, "cpu")
    table, mjm = make_table(compiled, 20, 0), compiled.mjm
    data, hit = mujoco.MjData(mjm), np.zeros(1, np.int32)
    free = [n for n, part in compiled.config.objects.items() if part.kind == "free"]
    robot = compiled.scene.subtree("robot") if compiled.config.robot is not None else []
    hidden = []
    for i in range(len(table)):
        table.put(data, i)
        eye, axes = camera_of(mjm, data)
        slope = np.tan(np.radians(mjm.camera(OVERVIEW).fovy[0] / 2.0))
        for body in (compiled.scene.bodies[n] for n in free):
            at = data.xpos[body] + [0.0, 0.0, 0.02]
            local = (at - eye) @ axes
            assert abs(local[0]) < -local[2] * slope * 4.0 / 3.0
            assert abs(local[1]) < -local[2] * slope
            mujoco.mj_ray(mjm, data, eye, at - eye, GROUPS, 1, -1, hit, None)
            hidden.append(hit[0] >= 0 and mjm.geom_bodyid[hit[0]] in robot)
    assert np.mean(hidden) < 0.1


def test_a_scene_without_a_robot_is_seen_from_the_front():
    """The camera is where y is less than in the scene, looks down, and its right is level."""
    scene = build_model(SceneConfig.load("mid"))
    eye, axes = camera_of(scene.mjm, mujoco.MjData(scene.mjm))
    assert eye[1] < -0.5
    assert axes[2, 2] > 0.5
    assert axes[2, 0] == pytest.approx(0.0, abs=1e-9)


def boxes(scene: SceneModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the box around all that is to be seen."""
    points = Overview(scene.config, scene.mjm, scene.home_qpos).seen()
    return points.min(axis=0), points.max(axis=0)


def test_what_is_seen_is_where_things_are_put():
    """The region of an object and not the whole floor; what stands on what is placed; and an empty scene."""
    floor = {"floor": {"size": [2.0, 2.0]}}
    near = {"apple": {"asset": "apple", "on": "floor", "region": {"box": [[0.1, 0.2], [0.3, 0.4]]}}}
    for region in (near["apple"]["region"], {"points": [[0.1, 0.4], [0.3, 0.2]]}):
        scene = {**floor, "objects": {"apple": {**near["apple"], "region": region}}}
        low, high = boxes(build_model(SceneConfig.load(scene)))
        assert np.all(low[:2] > [-0.1, 0.0])
        assert np.all(high[:2] < [0.5, 0.6])
    stacked = {**near, "box": {"asset": "chest", "on": "floor"}, "lemon": {"asset": "lemon", "on": "box"}}
    low, high = boxes(build_model(SceneConfig.load({**floor, "objects": stacked})))
    assert high[2] > 0.1
    assert np.all(high[:2] > 0.9)
    low, high = boxes(build_model(SceneConfig.load(floor)))
    assert (low[0], high[0]) == (-1.0, 1.0)


@pytest.mark.parametrize(
    "region", [{"box": [[-0.2, -0.2, 0.6], [0.2, 0.2, 0.9]]}, {"points": [[0, 0, 0.9], [0, 0.1, 0]]}]
)
def test_a_marker_in_space_is_seen(region: dict):
    """Its box, or its points, are part of what the camera frames."""
    goal = {"goal": {"kind": "marker", "region": region}}
    _, high = boxes(build_model(SceneConfig.load({"floor": {"size": [1.0, 1.0]}, "objects": goal})))
    assert high[2] == pytest.approx(0.9)


def test_nothing_is_drawn_twice():
    """Shapes for collisions are hidden where a body has looks in another group, but not otherwise, nor in the world."""
    looks = 'contype="0" conaffinity="0" size=".1"'
    mjm = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody>
        <geom name="ground" type="plane" size="1 1 1"/><geom name="rug" {looks} group="1"/>
        <body><geom name="hull" size=".1"/><geom name="skin" {looks} group="1"/></body>
        <body><geom name="ball" size=".1"/><geom name="dot" {looks}/><geom name="core" size=".1" group="3"/></body>
        <body><geom name="bare" size=".1"/><geom name="glass" {looks} group="1" rgba="1 1 1 0"/></body>
        </worldbody></mujoco>"""
    )
    groups = picture_groups(mjm)
    shown = {mjm.geom(i).name for i in range(mjm.ngeom) if groups[i] in (0, 1, 2)}
    assert shown == {"ground", "rug", "skin", "ball", "dot", "bare", "glass"}
