"""Pictures of a batch, or of its first worlds."""

import mujoco
import numpy as np
import pytest
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import MemoryLimitError, UnknownNameError
from sceniris_gym.pictures.camera import Cameras
from sceniris_gym.pictures.context import Looks, Shot
from sceniris_gym.scene.build import build_model
from sceniris_gym.sim.batch import Batch
from tests.device.loads import found, loaded


def test_worlds_without_mocap_bodies_have_pictures():
    """Nothing but a free object on the floor: there are no mocap poses to copy."""
    scene = build_model(
        SceneConfig.load({"floor": {"size": [1, 1]}, "objects": {"block": {"asset": "block", "on": "floor"}}})
    )
    assert scene.mjm.nmocap == 0
    batch = Batch(scene, 3, "cpu", graph=False)
    batch.update()
    cameras = Cameras(scene, batch.model, batch.data, {"overview": Shot((32, 24))}, Looks(), nworld=2)
    cameras.launch()
    pictures = cameras.images["overview"]["rgb"].numpy()
    assert pictures.shape == (2, 24, 32, 3)
    assert len(np.unique(pictures)) > 2
    assert found(cameras._launch) == loaded(cameras._launch)


def test_a_picture_shows_a_world_as_it_is_and_leaves_it_so(small_scene):
    """The red block of the second world is moved to the right: so is it in the picture, and no array has changed."""
    batch = Batch(small_scene.scene, 3, "cpu", graph=False)
    qpos = batch.data.qpos.numpy()
    qpos[:, 1], qpos[:, 2] = [-0.3, 0.3, 0.0], -0.4
    batch.data.qpos.assign(qpos)
    batch.update()
    before = {name: getattr(batch.data, name).numpy().copy() for name in ("qpos", "xpos", "cam_xpos", "time", "nacon")}
    cameras = Cameras(small_scene.scene, batch.model, batch.data, {"overview": Shot((60, 40))}, Looks(), nworld=2)
    cameras.launch()
    pictures = cameras.images["overview"]["rgb"].numpy().astype(int)
    red = (pictures[..., 0] > 100) & (pictures[..., 1] < 60) & (pictures[..., 2] < 60)
    left, right = (np.flatnonzero(picture.any(axis=0)) for picture in red)
    assert left.max() < 30 < right.min()
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(batch.data, name).numpy(), values, err_msg=name)
    batch.data.qpos.assign(np.roll(qpos, 1, axis=0))
    batch.update()
    cameras.launch()
    np.testing.assert_array_equal(cameras.images["overview"]["rgb"].numpy()[1], pictures[0])


def test_a_camera_that_the_scene_does_not_have_is_refused(small_scene):
    """With the names of those that it has."""
    batch = Batch(small_scene.scene, 1, "cpu", graph=False)
    with pytest.raises(UnknownNameError, match=r"unknown camera 'side'.*overview"):
        Cameras(small_scene.scene, batch.model, batch.data, {"side": Shot((32, 24))}, Looks())


def test_pictures_that_are_too_large_are_refused(small_scene):
    """With their size, before anything is allocated."""
    batch = Batch(small_scene.scene, 64, "cpu", graph=False)
    with pytest.raises(MemoryLimitError, match=r"64 pictures: takes \d{3}\.\d GiB or more"):
        Cameras(small_scene.scene, batch.model, batch.data, {"overview": Shot((16384, 16384))}, Looks())


def test_a_camera_follows_a_centre_of_mass():
    """A camera that tracks a ball sees it in the middle, wherever it is."""
    eye = '<camera name="eye" mode="targetbodycom" target="ball" pos="0 -2 1" fovy="20"/>'
    ball = '<body name="ball"><freejoint/><geom size=".1" rgba="1 0 0 1"/></body>'
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{eye}{ball}</worldbody></mujoco>")
    scene = build_model(SceneConfig.load({"model": spec}))
    batch = Batch(scene, 2, "cpu", graph=False)
    batch.data.qpos.assign(np.array([[-0.5, 0, 0, 1, 0, 0, 0], [0.5, 1, 0, 1, 0, 0, 0]], np.float32))
    batch.update()
    cameras = Cameras(scene, batch.model, batch.data, {"eye": Shot((15, 15), ("depth",))}, Looks())
    cameras.launch()
    depth = cameras.images["eye"]["depth"].numpy()[..., 0]
    distance = np.linalg.norm([[-0.5, 2, -1], [0.5, 3, -1]], axis=1) - 0.1
    np.testing.assert_allclose(depth[:, 7, 7], distance, atol=1e-3)
    assert (depth[:, 0, 0] == 0.0).all()


def test_worlds_are_drawn_by_their_own_rows_of_the_model(small_scene):
    """The block is blue in the second world, the third camera stands further away, and the fourth has a wide lens."""
    batch = Batch(small_scene.scene, 4, "cpu", graph=False)
    mjm, m = small_scene.mjm, batch.model
    block, eye = mjm.geom_bodyid == mjm.body("block").id, mjm.camera("overview").id
    rgba, pos, fovy = (np.tile(a, (4,) + (1,) * a.ndim) for a in (mjm.geom_rgba, mjm.cam_pos, mjm.cam_fovy))
    rgba[1, block] = [0.1, 0.1, 0.9, 1.0]
    pos[2, eye] *= 1.5
    fovy[3, eye] = 80.0
    m.geom_rgba, m.cam_pos = wp.array(rgba, dtype=wp.vec4), wp.array(pos, dtype=wp.vec3)
    m.cam_fovy = wp.array(fovy, dtype=float)
    batch.data.qpos.assign(np.tile(small_scene.scene.home_qpos, (4, 1)))
    batch.update()
    shots = {"overview": Shot((48, 36), ("rgb", "segmentation"))}
    differ = ("geom_rgba", "cam_pos", "cam_fovy")
    cameras = Cameras(small_scene.scene, m, batch.data, shots, Looks(), differ=differ)
    cameras.launch()
    rgb, seen = (cameras.images["overview"][kind].numpy() for kind in ("rgb", "segmentation"))
    assert cameras.names == ("",)
    red, _, blue = rgb.astype(int).transpose(3, 0, 1, 2)
    reds, blues = ((a > 2 * b).sum(axis=(1, 2)) for a, b in ((red, blue), (blue, red)))
    assert reds[1] < reds[0] > 1.5 * reds[2]
    assert reds[0] > 1.5 * reds[3]
    assert (blues > 0).tolist() == [False, True, False, False]
    assert not seen.any()
