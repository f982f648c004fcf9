"""Pictures of the first worlds of a batch."""

import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import UnknownNameError
from sceniris_gym.pictures.camera import FrameCamera
from sceniris_gym.scene.model import build_model
from sceniris_gym.sim.batch import Batch


def test_worlds_without_mocap_bodies_have_pictures():
    """Nothing but a free object on the floor: there are no mocap poses to copy."""
    scene = build_model(
        SceneConfig.load({"floor": {"size": [1, 1]}, "objects": {"block": {"asset": "block", "on": "floor"}}})
    )
    assert scene.mjm.nmocap == 0
    batch = Batch(scene, 3, "cpu", graph=False)
    pictures = FrameCamera(scene.mjm, batch.model, 2, 32, 24).take(batch.data)
    assert pictures.shape == (2, 24, 32, 3)
    assert len(np.unique(pictures)) > 2


def test_a_picture_shows_a_world_as_it_is_and_leaves_it_so(small_scene):
    """The red block of the second world is moved to the right: so is it in the picture, and no array has changed."""
    batch = Batch(small_scene.scene, 3, "cpu", graph=False)
    batch.update()
    qpos = batch.data.qpos.numpy()
    qpos[:, 1], qpos[:, 2] = [-0.3, 0.3, 0.0], -0.4
    batch.data.qpos.assign(qpos)
    before = {name: getattr(batch.data, name).numpy().copy() for name in ("qpos", "xpos", "time", "nacon")}
    camera = FrameCamera(small_scene.mjm, batch.model, 2, 60, 40)
    pictures = camera.take(batch.data).astype(int)
    red = (pictures[..., 0] > 100) & (pictures[..., 1] < 60) & (pictures[..., 2] < 60)
    left, right = (np.flatnonzero(picture.any(axis=0)) for picture in red)
    assert left.max() < 30 < right.min()
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(batch.data, name).numpy(), values, err_msg=name)
    batch.data.qpos.assign(np.roll(qpos, 1, axis=0))
    np.testing.assert_array_equal(camera.take(batch.data)[1], pictures[0])


def test_a_camera_that_the_scene_does_not_have_is_refused(small_scene):
    """With the names of those that it has."""
    batch = Batch(small_scene.scene, 1, "cpu", graph=False)
    with pytest.raises(UnknownNameError, match=r"unknown camera 'side'.*overview"):
        FrameCamera(small_scene.mjm, batch.model, 1, 32, 24, camera="side")
