"""Fields drawn by the words of a scene: their distributions, elements, masks and names."""

from __future__ import annotations

from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp
from scipy import stats
from scipy.spatial.transform import Rotation

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.device.random import named_stream
from sceniris_gym.layout.layouts import view_of
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.sim.model_fields import ModelFields

MODEL = """
<mujoco>
  <asset>
    <texture name="wood" type="2d" builtin="flat" width="8" height="8"/>
    <texture name="steel" type="2d" builtin="flat" width="8" height="8"/>
    <texture name="clay" type="2d" builtin="flat" width="8" height="8"/>
    <material name="grain" texture="wood" rgba="0.2 0.4 0.6 1"/>
  </asset>
  <worldbody>
    <light name="lamp" pos="0 0 3"/><camera name="side" pos="0 -1 0.4" euler="80 0 10"/>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="box" pos="0 0 .1"><freejoint/><geom type="box" size=".05 .04 .03" material="grain"/></body>
    <body name="cup" pos="1 0 .1"><freejoint/><geom size=".05"/><geom size=".03" pos=".1 0 0"/></body>
    <body name="arm"><geom size=".05"/><body name="upper" pos="0 0 .1"><joint name="one" axis="0 1 0" damping="2"/>
      <geom type="capsule" size=".02 .1" pos="0 0 .1" mass="1"/><body name="fore" pos="0 0 .2">
      <joint name="two" axis="0 1 0" damping="4"/><geom type="capsule" size=".02 .1" mass="0.5"/></body></body></body>
  </worldbody>
  <actuator><position joint="one" kp="10" kv="1"/><position joint="two" kp="20" kv="2"/></actuator>
</mujoco>
"""
MODEL_WORDS = {
    "objects": {
        "box": {
            "randomize": {
                "mass": {"scale": [0.5, 2.0], "distribution": "log_uniform"},
                "friction": {"abs": [0.8, 0.1], "distribution": "normal"},
                "rgba": {"scale": [0.5, 1.0]},
            }
        },
        "cup": {
            "randomize": {
                "mass": {"add": [-0.1, 0.3]},
                "friction": {"scale": [[0.5, 1, 1], [1.5, 2, 2]], "each": True},
                "rgba": {"choice": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]},
            }
        },
    },
    "robot": {
        "in_model": "arm",
        "tcp": {"body": "fore"},
        "randomize": {"damping": {"scale": [0.5, 1.5], "each": True}, "gains": {"scale": [0.5, 2]}},
    },
    "randomize": {
        "gravity": {"add": [[-0.1, -0.1, -0.5], [0.1, 0.1, 0.5]]},
        "lights": {"lamp": {"castshadow": {"choice": [True, False]}, "diffuse": {"abs": [[0.2] * 3, [0.9] * 3]}}},
        "cameras": {"side": {"quat": {"add": [[-5, -5, -5], [5, 5, 5]]}, "fovy": {"add": [-5, 5]}}},
        "materials": {"grain": {"texid": {"choice": ["clay", "wood", "steel"]}}},
    },
}
FIELDS = ("body_mass", "body_inertia", "body_invweight0", "geom_friction", "geom_rgba", "dof_damping", "cam_quat")


@pytest.fixture(scope="module")
def scene() -> SceneModel:
    """Return a scene in which much is drawn."""
    return build_model(SceneConfig.load({"model": mujoco.MjSpec.from_string(MODEL)} | MODEL_WORDS))


def drawn(scene: SceneModel, seeds: Any, *, mask: Any = None, episode: Any = 0, split: str = "train") -> ModelFields:
    """Return fields that were drawn for these seeds."""
    nworld = len(seeds)
    with wp.ScopedDevice("cpu"):
        fields = ModelFields(scene, mjw.put_model(scene.mjm), mjw.make_data(scene.mjm, nworld), grow=True)
        given = np.ones(nworld, bool) if mask is None else mask
        episodes = np.broadcast_to(episode, nworld).astype(np.int32)
        key = {"draw_seed": seeds, "draw_episode": episodes, "draw_stream": np.full(nworld, named_stream(split))}
        layouts = view_of(nworld, "cpu", key)
        fields.launch_draw(wp.array(given, dtype=wp.bool), layouts)
    return fields


@pytest.fixture(scope="module")
def many(scene: SceneModel) -> ModelFields:
    """Return the fields of a thousand worlds."""
    return drawn(scene, np.arange(1000))


def rows(fields: ModelFields, name: str) -> np.ndarray:
    """Return a field, shape (nworld, n, ...)."""
    return fields.rows[name].numpy()


DISTRIBUTIONS = {
    "box.mass": stats.loguniform(0.5, 2.0),
    "box.friction": stats.truncnorm(-3.0, 3.0, 0.8, 0.1),
    "box.rgba": stats.uniform(0.5, 0.5),
    "cup.mass": stats.uniform(-0.1, 0.4),
    "robot.gains": stats.uniform(0.5, 1.5),
    "lights.lamp.diffuse": stats.uniform(0.2, 0.7),
    "cameras.side.quat": stats.uniform(-5.0, 10.0),
}


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_numbers_have_their_distributions(many: ModelFields, name: str):
    """Kolmogorov and Smirnov over 1,000 worlds, of each number; different numbers are not the same."""
    numbers = many.parameter(name, "test").numpy()
    for column in numbers.T:
        assert stats.kstest(column, DISTRIBUTIONS[name].cdf).pvalue > 0.001
    assert len(np.unique(numbers[0])) == numbers.shape[1]


@pytest.mark.parametrize("name", ["lights.lamp.castshadow", "materials.grain.texid", "cup.rgba"])
def test_each_choice_is_as_likely(many: ModelFields, name: str):
    """Chi-square over 1,000 worlds."""
    counts = np.unique(many.parameter(name, "test").numpy()[:, 0], return_counts=True)[1]
    assert len(counts) == (2 if name.endswith("castshadow") else 3)
    assert stats.chisquare(counts).pvalue > 0.001


def test_fields_are_what_the_words_say(many: ModelFields, scene: SceneModel):
    """Relative to the model or instead of it, for the elements of their names alone; inertias follow masses."""
    mjm, numbers = scene.mjm, {draw.name: many.parameter(draw.name, "test").numpy() for draw in scene.draws}
    box, cup = mjm.body("box").id, mjm.body("cup").id
    mass, inertia = rows(many, "body_mass"), rows(many, "body_inertia")
    np.testing.assert_allclose(mass[:, box], mjm.body_mass[box] * numbers["box.mass"][:, 0], rtol=1e-6)
    np.testing.assert_allclose(mass[:, cup], mjm.body_mass[cup] + numbers["cup.mass"][:, 0], rtol=1e-6)
    for body in (box, cup):
        ratio = mass[:, body, None] / mjm.body_mass[body]
        np.testing.assert_allclose(inertia[:, body], mjm.body_inertia[body] * ratio, rtol=1e-5)
    others = np.setdiff1d(np.arange(mjm.nbody), [box, cup])
    np.testing.assert_allclose(mass[:, others], np.tile(mjm.body_mass[others], (1000, 1)), rtol=1e-6)
    friction, first = rows(many, "geom_friction"), mjm.body_geomadr[cup]
    np.testing.assert_allclose(friction[:, mjm.body_geomadr[box], 0], numbers["box.friction"][:, 0], rtol=1e-6)
    scales = numbers["cup.friction"].reshape(1000, 2, 3)
    np.testing.assert_allclose(friction[:, first : first + 2], mjm.geom_friction[first : first + 2] * scales, rtol=1e-5)
    rgba = rows(many, "geom_rgba")
    np.testing.assert_allclose(rgba[:, mjm.body_geomadr[box], :3], [0.2, 0.4, 0.6] * numbers["box.rgba"], rtol=1e-5)
    np.testing.assert_array_equal(rgba[:, first, :3], np.eye(3)[numbers["cup.rgba"][:, 0].astype(int)])
    np.testing.assert_array_equal(rgba[:, first], rgba[:, first + 1])
    damping = rows(many, "dof_damping")[:, -2:]
    np.testing.assert_allclose(damping, [2.0, 4.0] * numbers["robot.damping"], rtol=1e-6)
    gain, bias = rows(many, "actuator_gainprm")[:, :, 0], rows(many, "actuator_biasprm")
    np.testing.assert_allclose(gain, [10.0, 20.0] * numbers["robot.gains"], rtol=1e-6)
    np.testing.assert_allclose(bias[:, :, 1:3], -np.stack([gain, gain / 10.0], axis=2), rtol=1e-5)
    np.testing.assert_allclose(rows(many, "gravity"), mjm.opt.gravity + numbers["gravity"], rtol=1e-5)
    np.testing.assert_array_equal(rows(many, "light_castshadow"), numbers["lights.lamp.castshadow"] > 0.5)
    np.testing.assert_array_equal(rows(many, "mat_texid")[:, 0, 1], numbers["materials.grain.texid"][:, 0])
    np.testing.assert_array_equal(np.delete(rows(many, "mat_texid")[:, 0], 1, axis=1), -1)


def test_cameras_turn_about_their_own_axes(many: ModelFields, scene: SceneModel):
    """By a rotation vector in degrees, against SciPy's; what follows is MuJoCo's."""
    mjm, camera = scene.mjm, scene.mjm.camera("side").id
    turn = Rotation.from_rotvec(many.parameter("cameras.side.quat", "test").numpy(), degrees=True)
    expected = Rotation.from_quat(mjm.cam_quat[camera], scalar_first=True) * turn
    found = Rotation.from_quat(rows(many, "cam_quat")[:, camera], scalar_first=True)
    assert (expected.inv() * found).magnitude().max() < 1e-5
    np.testing.assert_allclose(rows(many, "cam_mat0")[:, camera], found.as_matrix(), atol=1e-5)


def test_what_follows_is_that_of_mujoco(many: ModelFields, scene: SceneModel):
    """Weights and masses of subtrees, of a hundred worlds, against mj_setConst."""
    for world in range(100):
        mjm = scene.mjm.__copy__()
        for name in ("body_mass", "body_inertia"):
            getattr(mjm, name)[:] = rows(many, name)[world]
        mujoco.mj_setConst(mjm, mujoco.MjData(mjm))
        for name in ("body_subtreemass", "body_invweight0", "dof_invweight0"):
            np.testing.assert_allclose(rows(many, name)[world], getattr(mjm, name), rtol=1e-5, atol=1e-9)


def test_fields_belong_to_seed_episode_and_split(many: ModelFields, scene: SceneModel):
    """In any order and number of worlds; worlds outside of the mask, or of no episode, keep those of the model."""
    some = drawn(scene, [700, 3, 5, 9], mask=np.array([True, True, False, True]), episode=np.array([0, 0, 0, -1]))
    for name in FIELDS:
        np.testing.assert_array_equal(rows(some, name)[:2], rows(many, name)[[700, 3]], err_msg=name)
        np.testing.assert_allclose(rows(some, name)[2], rows(some, name)[3], rtol=1e-6, err_msg=name)
    np.testing.assert_allclose(rows(some, "body_mass")[2], scene.mjm.body_mass, rtol=1e-6)
    for other in (drawn(scene, [3], episode=1), drawn(scene, [3], split="eval")):
        assert (rows(other, "body_mass")[0] != rows(many, "body_mass")[3]).any()


def test_a_draw_does_not_depend_on_the_others(many: ModelFields):
    """By its name: with fewer words in the scene the mass is the same."""
    words = {"objects": {"box": {"randomize": {"mass": MODEL_WORDS["objects"]["box"]["randomize"]["mass"]}}}}
    alone = build_model(SceneConfig.load({"model": mujoco.MjSpec.from_string(MODEL)} | words))
    fields = drawn(alone, [0, 1])
    box = alone.mjm.body("box").id
    np.testing.assert_array_equal(rows(fields, "body_mass")[:, box], rows(many, "body_mass")[:2, box])
