"""Settings of environments: merged with those of the task, and given as classes or mappings."""

from __future__ import annotations

from typing import Any

import gymnasium
import pytest
import warp as wp
from gymnasium.envs.registration import EnvSpec

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, UnknownNameError
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.settings import ImageConfig, RenderConfig, SimConfig, as_image_config, as_settings
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import Reach

TASK = SimConfig(nconmax=40, copy=False)
CAMERAS = {"front": {"size": (8, 8)}}


def test_a_mapping_replaces_the_fields_that_it_has():
    """Also by the default of the class. The other fields stay as in the task."""
    assert as_settings(TASK, {"copy": True, "nconmax": None}, "sim_config") == SimConfig()
    assert as_settings(TASK, {"graph": False}, "sim_config") == SimConfig(nconmax=40, graph=False, copy=False)


def test_a_dataclass_replaces_all_settings_of_the_task():
    """Its fields at their defaults too."""
    given = SimConfig(njmax=200)
    assert as_settings(TASK, given, "sim_config") is given


def test_no_settings_are_those_of_the_task():
    """Also an empty mapping."""
    assert as_settings(TASK, None, "sim_config") == as_settings(TASK, {}, "sim_config") == TASK


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"nconmx": 3}, UnknownNameError, "Did you mean 'nconmax'"),
        (3, ArgumentTypeError, "sim_config should be a SimConfig"),
        (RenderConfig(), ArgumentTypeError, "sim_config should be a SimConfig"),
    ],
)
def test_other_settings_are_refused(given, error, message):
    """With the nearest name, or the class that belongs there."""
    with pytest.raises(error, match=message):
        as_settings(TASK, given, "sim_config")
    with pytest.raises(error, match=message):  # before the scene is looked for
        SceneVectorEnv(Reach, scene="nowhere", sim_config=given)


def test_images_are_given_in_three_forms():
    """A class, a mapping of its fields, and only the cameras. The task's cameras are used if a user gives none."""
    task = ImageConfig(cameras=CAMERAS, every=2, final=True)
    assert as_image_config(None, CAMERAS) == ImageConfig(cameras=CAMERAS)
    assert as_image_config(None, {"cameras": CAMERAS, "final": True}) == ImageConfig(cameras=CAMERAS, final=True)
    assert as_image_config(task, {"every": 1}) == ImageConfig(cameras=CAMERAS, final=True)
    assert as_image_config(task, {"final": False}) == ImageConfig(cameras=CAMERAS, every=2)
    assert as_image_config(task, ImageConfig(every=3)) == ImageConfig(cameras=CAMERAS, every=3)
    side = ImageConfig(cameras={"side": {"size": (4, 4)}})
    assert as_image_config(task, side) is side
    assert as_image_config(task, None) is task
    assert as_image_config(task, {}) is None


@pytest.mark.parametrize(
    ("cls", "words", "message"),
    [
        (SimConfig, {"nconmax": 0}, "sim_config: nconmax should be an integer of at least 1, got 0"),
        (SimConfig, {"njmax": 1.5}, "sim_config: njmax should be an integer"),
        (SimConfig, {"nvmax": True}, "sim_config: nvmax should be an integer"),
        (SimConfig, {"graph": None}, "sim_config: graph should be a bool"),
        (SimConfig, {"copy": "no"}, "sim_config: copy should be a bool"),
        (
            SimConfig,
            {"prefetch": 1},
            r"sim_config: prefetch should be a boolean, a wp\.Stream or None, got .* wp\.stream_from_torch",
        ),
        (RenderConfig, {"num_envs": 0}, "render_config: num_envs should be"),
        (RenderConfig, {"size": (0, 8)}, r"render_config: size\[0\] should be"),
        (RenderConfig, {"camera": 0}, "render_config: camera should be a str"),
        (ImageConfig, {"cameras": ["front"]}, "images: cameras should be a Mapping"),
        (ImageConfig, {"every": 0}, "images: every should be"),
        (ImageConfig, {"final": 1}, "images: final should be a bool"),
    ],
)
def test_wrong_values_are_refused(cls: type, words: dict[str, Any], message: str):
    """By the name of the argument and of the field."""
    with pytest.raises(ArgumentError, match=f"^{message}"):
        cls(**words)


def test_prefetch_may_be_a_stream():
    """As in a ResetRandomizer."""
    stream = wp.Stream.__new__(wp.Stream)
    assert SimConfig(prefetch=stream).prefetch is stream


@pytest.mark.parametrize(("own", "room"), [(True, 40), (False, None)])
def test_another_scene_leaves_out_only_the_room_of_the_task(reach_scene: CompiledScene, own: bool, room: int | None):
    """Its graphs, prefetching and copies stay, unless the user gives other ones."""

    class Elsewhere(Reach):
        scene = reach_scene.config.name if own else "elsewhere"
        sim_config = SimConfig(nconmax=40, njmax=160, nvmax=9, graph=False, prefetch=True, copy=False)

    envs = SceneVectorEnv(Elsewhere, 1, scene=reach_scene, sim_config={"copy": True, "njmax": 200})
    nvmax = 9 if own else None
    assert envs.sim_config == SimConfig(nconmax=room, njmax=200, nvmax=nvmax, graph=False, prefetch=True)


def test_registered_environments_merge_settings_and_survive_json():
    """A dataclass comes back as a mapping; the budget of the task is kept."""
    words = {"sim_config": {"graph": False}, "render_config": {"size": [16, 8]}}
    spec = EnvSpec.from_json(gymnasium.spec("sceniris_gym/TabletopReach-v0").to_json())
    spec.kwargs |= words
    envs = gymnasium.make_vec(EnvSpec.from_json(spec.to_json()), num_envs=1, device="cpu").unwrapped
    assert isinstance(envs, SceneVectorEnv)
    assert envs.sim_config == SimConfig(nconmax=40, njmax=160, graph=False)
    assert envs.batch.data.naconmax == 40
