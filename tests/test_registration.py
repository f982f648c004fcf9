"""The environments that Gymnasium knows by name: what their entries lead to, and what registering leaves alone."""

from __future__ import annotations

import importlib
import inspect
import subprocess
import sys
from collections.abc import Iterator

import gymnasium
import pytest

from sceniris_gym.registration import ENVS, register_envs
from sceniris_gym.vector.vector_env import SceneVectorEnv

DRAWER_PICK = "sceniris_gym/DrawerPick-v0"


@pytest.fixture
def registry() -> Iterator[dict]:
    """Return Gymnasium's registry, which is as before when the test is over."""
    before = dict(gymnasium.registry)
    yield gymnasium.registry
    gymnasium.registry.clear()
    gymnasium.registry.update(before)


def test_the_envs_are_registered_by_strings():
    """Gymnasium knows the ids after the import, and what their strings name exists."""
    specs = {name: spec for name, spec in gymnasium.registry.items() if name.startswith("sceniris_gym/")}
    assert "sceniris_gym/DrawerPick-v0" in specs
    for spec in specs.values():
        for target in (spec.entry_point, spec.vector_entry_point, spec.kwargs["task"]):
            module, _, name = str(target).partition(":")
            assert callable(getattr(importlib.import_module(module), name))


def test_registering_again_changes_nothing(registry: dict, monkeypatch: pytest.MonkeyPatch):
    """The entries stay the same objects, so one that a user has changed is kept."""
    before = dict(registry)
    monkeypatch.setattr(registry[DRAWER_PICK], "max_episode_steps", 7)
    register_envs()
    assert registry.keys() == before.keys()
    assert all(registry[name] is spec for name, spec in before.items())
    assert registry[DRAWER_PICK].max_episode_steps == 7


def test_an_entry_that_was_removed_is_made_again(registry: dict):
    """As it was, whichever others are still there."""
    removed = registry.pop(DRAWER_PICK)
    register_envs()
    assert registry[DRAWER_PICK] is not removed
    assert registry[DRAWER_PICK] == removed


def test_an_entry_is_found_without_loading_its_task():
    """After the import of the package a spec can be looked at, and neither task nor environment is in memory."""
    code = f"""
import sys, gymnasium, sceniris_gym
spec = gymnasium.spec({DRAWER_PICK!r})
print(spec.kwargs["task"])
print(*sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    task, modules = done.stdout.splitlines()
    assert task == "sceniris_gym.envs.drawer_pick:DrawerPick"
    assert not [name for name in modules.split() if name.startswith(("sceniris_gym.envs", "sceniris_gym.vector"))]


@pytest.mark.parametrize("env_id", ENVS)
def test_the_arguments_of_an_entry_are_those_of_the_environment(env_id: str):
    """All of them are taken by name, so that a misspelt one is not found only when the environment is made."""
    spec = gymnasium.spec(env_id)
    bound = inspect.signature(SceneVectorEnv).bind(num_envs=1, **spec.kwargs)
    assert bound.arguments.keys() >= spec.kwargs.keys()
    assert spec.max_episode_steps is not None
    assert spec.max_episode_steps > 0
