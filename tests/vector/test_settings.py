"""Settings of environments: merged with those of the task, and given as classes or mappings."""

from __future__ import annotations

import gymnasium
import pytest
from gymnasium.envs.registration import EnvSpec

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, UnknownNameError
from sceniris_gym.vector.settings import ImageConfig, RenderConfig, SimConfig, as_image_config, as_settings
from sceniris_gym.vector.vector_env import SceneVectorEnv

TASK = SimConfig(nconmax=40, njmax=160)
CAMERAS = {"front": {"size": (8, 8)}}


@pytest.mark.parametrize("given", [SimConfig(graph=False, njmax=200), {"graph": False, "njmax": 200}])
def test_settings_of_a_user_replace_those_of_the_task(given):
    """One by one: the others stay as the task has them."""
    assert as_settings(TASK, given, "sim_config") == SimConfig(nconmax=40, njmax=200, graph=False)


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


def test_images_are_given_in_three_forms():
    """A class, a mapping of its fields, and the cameras alone; the task's are used where a user gives none."""
    task = ImageConfig(cameras=CAMERAS, every=2)
    assert as_image_config(None, CAMERAS) == ImageConfig(cameras=CAMERAS)
    assert as_image_config(None, {"cameras": CAMERAS, "final": True}) == ImageConfig(cameras=CAMERAS, final=True)
    assert as_image_config(task, {"final": True}) == ImageConfig(cameras=CAMERAS, every=2, final=True)
    assert as_image_config(task, None) is task
    assert as_image_config(task, {}) is None


def test_what_is_not_a_picture_is_refused():
    """A number of worlds, a size and an interval that cannot be."""
    for make in (lambda: RenderConfig(num_envs=0), lambda: RenderConfig(size=(0, 8)), lambda: ImageConfig(every=0)):
        with pytest.raises(ArgumentError, match="should be"):
            make()


def test_registered_environments_merge_settings_and_survive_json():
    """A dataclass comes back as a mapping; the budget of the task is kept."""
    words = {"sim_config": {"graph": False}, "render_config": {"size": [16, 8]}}
    spec = EnvSpec.from_json(gymnasium.spec("sceniris_gym/TabletopReach-v0").to_json())
    spec.kwargs |= words
    envs = gymnasium.make_vec(EnvSpec.from_json(spec.to_json()), num_envs=1, device="cpu").unwrapped
    assert isinstance(envs, SceneVectorEnv)
    assert envs.sim_config == SimConfig(nconmax=40, njmax=160, graph=False)
    assert envs.batch.data.naconmax == 40
