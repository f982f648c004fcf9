"""TabletopLiftAny-v0: what it observes, things that training never sees, and a script that lifts."""

from __future__ import annotations

import importlib

import gymnasium
import pytest
import torch
from torch import Tensor

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.arm_controller import TOOL_STEP, YAW_STEP
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.envs.stated import check_stated, values

TabletopLiftAny = importlib.import_module("sceniris_gym.envs.tabletop_lift_any").TabletopLiftAny


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return the CompiledScene of the task, built once."""
    return compile_scene(SceneConfig.load("tabletop_lift_any", {"bank": 8}), "cpu")


def scripted(envs: SceneVectorEnv, observation: dict, closed: Tensor) -> Tensor:
    """Return actions that go over the grasp, down to it, close (counted in `closed`) and go up; from observations."""
    grasp, lead = values(envs, observation, "tcp_to_grasp"), values(envs, observation, "tool_lead")
    cos, sin = values(envs, observation, "turn_to_grasp").unbind(dim=1)
    turn = 0.5 * torch.atan2(sin, cos)
    aside = grasp[:, :2].norm(dim=1) + 0.05 * turn.abs()
    closed += (closed > 0) | ((grasp.norm(dim=1) < 0.008) & (turn.abs() < 0.05))
    height = torch.where(aside > 0.01, grasp[:, 2] + 0.06, grasp[:, 2])
    height = torch.where(closed > 0, torch.where(closed > 12, 0.04, 0.0), height)
    still = (closed > 0)[:, None]
    way = torch.cat([torch.where(still, 0.0, grasp[:, :2]), height[:, None], torch.where(still, 0.0, turn[:, None])], 1)
    limit, step = torch.tensor([0.04, 0.04, 0.04, 0.3]), torch.tensor([TOOL_STEP] * 3 + [YAW_STEP])
    moved = ((way.clamp(-limit, limit) - lead) / step).clamp(-1, 1)
    return torch.cat([moved, torch.where(closed > 0, -1.0, 1.0)[:, None]], dim=1)


def test_the_docstring_lists_what_is_observed(compiled):
    """Names, shapes and sizes."""
    envs = gymnasium.make_vec("sceniris_gym/TabletopLiftAny-v0", num_envs=1, scene=compiled)
    assert isinstance(envs, SceneVectorEnv)
    assert envs.max_episode_steps == 150
    check_stated(TabletopLiftAny, envs, [("variant", (16,)), ("object_velocities", (3, 6))])


def test_training_never_sees_what_it_is_judged_on(compiled):
    """Eight things in each split, none in both."""
    seen = {}
    for split in ("train", "eval"):
        envs = SceneVectorEnv(TabletopLiftAny, 96, scene=compiled, split=split)
        seen[split] = set(envs.reset(seed=0)[1]["layout"]["variants"]["target"].tolist())
        assert len(seen[split]) == 8
    assert not seen["train"] & seen["eval"]


@pytest.mark.slow
@pytest.mark.parametrize("split", ["train", "eval"])
def test_a_script_lifts_most_things(compiled, split: str):
    """Of either split, by observations alone; the terms of the reward come one after the other, and success last."""
    envs = SceneVectorEnv(TabletopLiftAny, 16, scene=compiled, split=split, autoreset_mode="Disabled")
    observation, info = envs.reset(seed=3)
    things = info["layout"]["variants"]["target"]
    closed = torch.zeros(16, dtype=torch.long)
    seen: dict[str, list[Tensor]] = {name: [] for name in ("grasping", "lifting", "holding")}
    success = torch.zeros(16, dtype=torch.bool)
    for _ in range(150):
        observation, _, _, _, info = envs.step(scripted(envs, observation, closed))
        for name, steps in seen.items():
            steps.append(info["reward_terms"][name] > 0.005)
        success |= info["success"]
    assert success.float().mean() > 0.6, f"{split}: {things.tolist()}, {success.tolist()}"
    assert len(set(things[success].tolist())) >= 4
    first = {name: torch.stack(steps).int().argmax(dim=0)[success] for name, steps in seen.items()}
    assert (first["grasping"] <= first["lifting"]).all()
    assert (first["lifting"] < first["holding"]).all()
