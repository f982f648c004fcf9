"""TabletopReachPixels-v0: what the policy is told and shown, and that it trains."""

from __future__ import annotations

import importlib

import gymnasium
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.envs.stated import check_stated

module = importlib.import_module("sceniris_gym.envs.tabletop_reach_pixels")
ENV_ID = "sceniris_gym/TabletopReachPixels-v0"


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return the CompiledScene of the task, built once."""
    return compile_scene(SceneConfig.load("tabletop_reach", {"bank": 8}), "cpu")


def test_the_policy_is_told_no_pose_of_a_thing_and_its_pictures_show_them(compiled):
    """Names, shapes and sizes; all five things are in sight of the front camera, whole or in part."""
    images = {"front": {"size": (64, 64), "data": ("rgb", "segmentation"), "thin": True}}
    envs = gymnasium.make_vec(ENV_ID, num_envs=4, scene=compiled, images=images)
    assert isinstance(envs, SceneVectorEnv)
    shapes = [("tcp_to_objects", (5, 3)), ("tcp_to_target", (3,)), ("object_velocities", (5, 3))]
    check_stated(module.TabletopReachPixels, envs, shapes)
    observation, _ = envs.reset(seed=2)
    seen = observation["images"]["front"]["segmentation"]
    assert envs.images is not None
    for thing in ("bottle", "apple", "orange", "can", "block"):
        assert (seen == envs.images.names.index(thing)).flatten(1).any(dim=1).sum() >= 3, thing
