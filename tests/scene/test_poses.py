"""Addresses of poses and joints, and poses of bodies in many layouts, compared with MuJoCo's layout by layout."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import NotSupportedError, UnknownNameError
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.poses import body_poses, joint_address, pose_address, product, rotated
from tests.scene.memory import cubes_on, spec_of

MJCF = """
<mujoco>
  <worldbody>
    <body name="stand" pos="1 2 3" euler="10 20 30">
      <geom size=".1"/>
      <body name="slide" pos=".1 .2 .3" euler="0 40 0">
        <joint type="slide" axis="1 2 3" pos=".1 0 0" ref="0.2"/><geom size=".1"/>
        <body name="door" pos="0 .2 0">
          <joint type="hinge" axis="0 1 1" pos=".05 .1 0" ref="30"/><joint type="hinge" axis="1 0 0" pos="0 0 .1"/>
          <geom size=".1"/>
          <body name="ball" pos=".3 0 0"><joint type="ball" pos="0 0 .2"/><geom size=".1"/></body>
        </body>
      </body>
    </body>
    <body name="free" euler="90 0 0"><freejoint/><geom size=".1"/>
      <body name="lid" pos="0 0 .1"><joint type="hinge" axis="0 0 1"/><geom size=".1"/></body>
    </body>
    <body name="fixture" mocap="true"><geom size=".1"/>
      <body name="drawer" euler="0 0 45"><joint type="slide" axis="0 1 0"/><geom size=".1"/></body>
    </body>
  </worldbody>
</mujoco>
"""


def test_poses_are_those_of_mujoco():
    """All kinds of joints, several of a body, references, fixtures, and quaternions that are not of length one."""
    mjm, draws = mujoco.MjModel.from_xml_string(MJCF), np.random.default_rng(0)
    qpos = draws.normal(size=(20, mjm.nq)).astype(np.float32)
    pos, quat = (draws.normal(size=(20, 1, n)).astype(np.float32) for n in (3, 4))
    data = mujoco.MjData(mjm)
    wanted = np.zeros((mjm.nbody, 20, 7))
    for i in range(20):
        data.qpos[:], data.mocap_pos[:], data.mocap_quat[:] = qpos[i], pos[i], quat[i]
        mujoco.mj_kinematics(mjm, data)
        wanted[:, i] = np.hstack([data.xpos, data.xquat])
    for body in range(mjm.nbody):
        places, turns = body_poses(mjm, body, qpos, pos, quat)
        np.testing.assert_allclose(places, wanted[body, :, :3], atol=1e-9, err_msg=mjm.body(body).name)
        same = np.abs((turns * wanted[body, :, 3:]).sum(axis=1))
        np.testing.assert_allclose(same, 1.0, atol=1e-9, err_msg=mjm.body(body).name)


def test_products_and_turns_are_those_of_mujoco():
    """Row by row, and one for all."""
    draws = np.random.default_rng(1)
    a, b, v = draws.normal(size=(5, 4)), draws.normal(size=(5, 4)), draws.normal(size=(5, 3))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    for i in range(5):
        wanted, turned = np.zeros(4), np.zeros(3)
        mujoco.mju_mulQuat(wanted, a[i], b[i])
        np.testing.assert_allclose(product(a, b)[i], wanted, atol=1e-12)
        mujoco.mju_rotVecQuat(turned, v[i], a[i])
        np.testing.assert_allclose(rotated(v, a)[i], turned, atol=1e-12)
        np.testing.assert_allclose(rotated(v[0], a)[0], rotated(v, a)[0], atol=1e-12)
        np.testing.assert_allclose(product(a, b[0])[0], product(a, b)[0], atol=1e-12)


@pytest.fixture(scope="module")
def scene() -> SceneModel:
    """Return a scene with a free, a mocap, a fixed and a jointed object."""
    spec = spec_of()
    spec.body("cab/cabinet").mocap = True
    objects = {
        **cubes_on("ledge", 2),
        "cabinet": {"body": "cab/cabinet", "kind": "fixture"},
        "post": {"kind": "static"},
        "terrain": {"kind": "static"},
    }
    return build_model(SceneConfig.load({"model": spec, "objects": objects}))


def test_a_pose_is_in_qpos_among_mocap_bodies_or_nowhere(scene: SceneModel):
    """By the kind of the object's root body."""
    mjm = scene.mjm
    assert pose_address(scene, "cube_1", "here") == ("qpos", mjm.jnt_qposadr[mjm.body("cube_1/cube").jntadr[0]])
    assert pose_address(scene, "cabinet", "here") == ("mocap", 0)
    assert pose_address(scene, "terrain", "here") == ("body", mjm.body("terrain").id)
    with pytest.raises(NotSupportedError, match="'post' hangs on joints"):
        pose_address(scene, "post", "here")
    with pytest.raises(UnknownNameError, match="here: unknown object 'cube_3'"):
        pose_address(scene, "cube_3", "here")


def test_a_joint_goes_by_its_name_in_the_model_or_in_its_object(scene: SceneModel):
    """`cab/slide`, `cabinet/slide` and, as no other object has one, `slide`."""
    adr = int(scene.mjm.joint("cab/slide").qposadr[0])
    for name in ("cab/slide", "cabinet/slide", "slide"):
        assert joint_address(scene, name, "here") == (adr, 1)
    assert joint_address(scene, "turn", "here") == (int(scene.mjm.joint("turn").qposadr[0]), 1)
    with pytest.raises(UnknownNameError, match=r"here: unknown joint 'slid'\. Did you mean 'cab/slide'"):
        joint_address(scene, "slid", "here")
