"""KitchenAny-v0 and its scene: other furniture in every layout, and what the task observes and rewards."""

from __future__ import annotations

import importlib
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch

import sceniris_gym
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.envs.stated import check_stated

module = importlib.import_module("sceniris_gym.envs.kitchen_any")
FOLDER = Path(str(module.__file__)).parent / "furniture"
UNITS = tuple(f"unit_{i}" for i in range(1, 7))


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return the scene of the task, which tests of all shipped scenes compile, too."""
    return compile_scene("kitchen_any", "cpu")


def test_the_furniture_is_what_the_command_writes(tmp_path: Path):
    """The same bytes; the scene's comment names the command."""
    sceniris_gym.furniture(tmp_path, n=48)
    written = sorted(tmp_path.glob("*.xml"))
    assert [path.name for path in written] == sorted(path.name for path in FOLDER.glob("*_00*.xml"))
    for path in written:
        assert path.read_bytes() == (FOLDER / path.name).read_bytes(), path.name


def test_kitchens_differ(compiled: CompiledScene):
    """Hardly any two of a hundred layouts have the same units, and all twelve things are there."""
    config, table = compiled.config, make_table(compiled, 100, 0)
    assert table.valid.mean() > 0.9
    drawn = {
        tuple(row) for row in table.present[:, [compiled.slots.index(m) for u in UNITS for m in config.variants[u]]]
    }
    assert len(drawn) > 90
    free = {name.partition("/")[0] for name, part in config.objects.items() if part.kind == "free"}
    assert len(free) == 12
    for name in free:
        members = [member for member in config.objects if member.partition("/")[0] == name]
        assert (table.present[:, [compiled.slots.index(member) for member in members]].sum(axis=1) == 1).all(), name


def test_the_docstring_lists_what_is_observed(compiled: CompiledScene):
    """Names, shapes and sizes; a shelf without an opening is observed as closed."""
    envs = gymnasium.make_vec("sceniris_gym/KitchenAny-v0", num_envs=8, scene=compiled)
    assert isinstance(envs, SceneVectorEnv)
    assert envs.max_episode_steps == 300
    more = [("position", (1,)), ("touching", (2,)), ("banana_velocity", (6,))]
    check_stated(module.KitchenAny, envs, more)
    observation, _ = envs.reset(seed=0)
    assert all(np.isfinite(values.numpy()).all() for values in observation.values())
    opening = envs.state.joint("unit_1", "opening")[:, 1]
    kinds = [compiled.config.variants["unit_1"][i] for i in envs.state.variant("unit_1").tolist()]
    assert opening.isnan().tolist() == ["shelves" in kind for kind in kinds]


def test_a_banana_at_the_goal_is_a_success_if_it_is_held(compiled: CompiledScene):
    """Put there without the hand, it is none, and `carrying` stays 0."""
    envs = SceneVectorEnv(module.KitchenAny, 4, scene=compiled, autoreset_mode="Disabled")
    envs.reset(seed=1)
    s = envs.state
    before = envs.task.distance(s)  # pyrefly: ignore[missing-attribute]
    s.put_pose("banana", s.pose("goal"), torch.tensor([True, True, False, False]))
    after = envs.task.distance(s)  # pyrefly: ignore[missing-attribute]
    assert (after[:2] < 1e-3).all()
    assert torch.equal(after[2:], before[2:])
    assert not envs.task.success(s).any()
    assert not envs.task.reward(s, torch.zeros(4, 7))["carrying"].any()
