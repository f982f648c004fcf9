"""Addresses of poses and joints, by the names of the scene."""

from __future__ import annotations

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import NotSupportedError, UnknownNameError
from sceniris_gym.scene.addresses import joint_address, pose_address
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from tests.scene.memory import cubes_on, spec_of


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
