"""Cameras of a scene in its model: where they are, what carries them, and names that do not exist."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, UnknownNameError
from sceniris_gym.scene.build import build_model

SCENE: dict[str, Any] = {
    "floor": {"size": [2, 2]},
    "robot": {"asset": "heron", "base": [0.5, 0, 0], "yaw": 90},
    "objects": {"block": {"asset": "block", "on": "floor"}},
}


def model_with(cameras: dict[str, Any], **more: Any) -> Any:
    """Return the scene with these cameras."""
    return build_model(SceneConfig.load({**SCENE, "cameras": cameras, **more}))


def test_a_camera_looks_at_its_point_from_its_place():
    """In the frame of the world or of its body: the point lies on the optical axis, and up is up."""
    cameras = {
        "front": {"pos": [1.0, -1.0, 0.8], "look_at": [0, 0, 0.1], "fovy": 30},
        "base": {"body": "robot", "pos": [0.4, 0.1, 0.9], "look_at": [0.2, 0.3, 0.0]},
        "rider": {"body": "block", "pos": [0, 0, 0.3], "look_at": [0, 0, 0], "up": [0, 1, 0]},
    }
    scene = model_with(cameras)
    data = mujoco.MjData(scene.mjm)
    data.qpos[:] = scene.home_qpos
    mujoco.mj_forward(scene.mjm, data)
    for name, words in cameras.items():
        carrier = {"front": 0, "base": scene.bodies["robot"], "rider": scene.bodies["block"]}[name]
        frame, origin = data.xmat[carrier].reshape(3, 3), data.xpos[carrier]
        eye, point = (origin + frame @ np.array(words[w]) for w in ("pos", "look_at"))
        camera = data.camera(name)
        np.testing.assert_allclose(camera.xpos, eye, atol=1e-6)
        axes = camera.xmat.reshape(3, 3)
        np.testing.assert_allclose(axes[:, 2], (eye - point) / np.linalg.norm(eye - point), atol=1e-6)
        assert axes[:, 1] @ frame @ np.array(words.get("up", [0, 0, 1])) > 0.1
    assert scene.mjm.camera("front").fovy == 30
    assert scene.mjm.camera("rider").bodyid == scene.bodies["block"]


def test_cameras_change_no_hash():
    """And one that is called 'overview' takes the place of the automatic one."""
    view = {"pos": [1.0, 0, 1.0], "look_at": [0, 0, 0]}
    plain, seen = model_with({}), model_with({"overview": view})
    assert plain.hash == seen.hash
    assert (plain.mjm.ncam, seen.mjm.ncam) == (1, 1)
    np.testing.assert_allclose(seen.mjm.camera("overview").pos, view["pos"])


def test_a_body_inside_a_robot_has_the_robots_name_or_that_of_its_asset():
    """`robot/...` and `heron/...` are the same body."""
    mjm = model_with({}).mjm
    inside = [mjm.body(i).name for i in range(mjm.nbody) if mjm.body(i).name.startswith("heron/")][-1]
    view = {"pos": [0, 0, 0.1], "look_at": [0, 0, 1]}
    names = {"a": inside, "b": inside.replace("heron/", "robot/")}
    seen = model_with({name: {**view, "body": body} for name, body in names.items()}).mjm
    assert seen.camera("a").bodyid == seen.camera("b").bodyid == seen.body(inside).id


def test_an_object_with_variants_carries_a_camera():
    """The body that its variants share does, by the name of the object."""
    view = {"body": "thing", "pos": [0, 0, 0.3], "look_at": [0, 0, 0]}
    sim = model_with({"eye": view}, objects={"thing": {"asset": ["can", "mug"], "on": "floor"}}).sim
    assert sim.mjm.camera("eye").bodyid == sim.bodies["thing"]


def test_names_that_do_not_exist_or_are_taken_are_refused():
    """With the key; a model that cannot be edited gets no camera."""
    view = {"pos": [0, 0, 1], "look_at": [0, 0, 0]}
    with pytest.raises(UnknownNameError, match=r"cameras\.eye\.body: unknown body 'blok'.*block"):
        model_with({"eye": {**view, "body": "blok"}})
    spec = mujoco.MjSpec.from_string('<mujoco><worldbody><camera name="eye"/></worldbody></mujoco>')
    with pytest.raises(SceneKeyError, match=r"cameras\.eye: the model has a camera of this name"):
        build_model(SceneConfig.load({"model": spec, "cameras": {"eye": view}}))
    with pytest.raises(SceneKeyError, match=r"cameras\.eye: would be added to the model"):
        build_model(SceneConfig.load({"model": spec.compile(), "cameras": {"eye": view}}))
