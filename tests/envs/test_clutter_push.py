"""ClutterPush-v0: what it observes and rewards, and a script that pushes."""

from __future__ import annotations

import importlib
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.envs.stated import check_stated, values

ENV_ID = "sceniris_gym/ClutterPush-v0"
module = importlib.import_module("sceniris_gym.envs.clutter_push")
ClutterPush = module.ClutterPush


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return the CompiledScene of the task, built once."""
    return compile_scene(SceneConfig.load("clutter_push", {"bank": 8}), "cpu")


def test_the_docstring_lists_what_is_observed(compiled):
    """Names, shapes and sizes."""
    envs = gymnasium.make_vec(ENV_ID, num_envs=1, scene=compiled)
    assert isinstance(envs, SceneVectorEnv)
    assert envs.max_episode_steps == 250
    check_stated(ClutterPush, envs, [("tcp_to_behind", (3,)), ("object_velocities", (4, 6))])


def test_a_push_begins_behind_the_tin(compiled):
    """On the line from the mark through the tin, 6 cm on, 2 cm over the table."""
    envs = SceneVectorEnv(ClutterPush, 8, scene=compiled)
    observation, _ = envs.reset(seed=1)
    way, tin = values(envs, observation, "tcp_to_behind", "critic"), values(envs, observation, "tcp_to_tin")
    goal = values(envs, observation, "tin_to_goal")
    back = way - tin
    torch.testing.assert_close(back[:, :2].norm(dim=1), torch.full((8,), 0.06), rtol=0, atol=1e-5)
    torch.testing.assert_close(back[:, 2], torch.full((8,), 0.02), rtol=0, atol=1e-5)
    cosine = torch.nn.functional.cosine_similarity(back[:, :2], goal[:, :2])
    torch.testing.assert_close(cosine, torch.full((8,), -1.0))


def test_the_can_is_in_the_way(compiled):
    """Its middle is within 5 cm of the straight line from the tin to the mark, in nearly all worlds beside the tin."""
    envs = SceneVectorEnv(ClutterPush, 64, scene=compiled)
    envs.reset(seed=40)
    tin, goal, can = envs.state.poses(("tin", "goal", "can"))[:, :, :2].unbind(dim=1)
    way = goal - tin
    share = (((can - tin) * way).sum(dim=1) / way.square().sum(dim=1)).clamp(0.0, 1.0)
    assert (can - tin - share[:, None] * way).norm(dim=1).max() <= 0.0501
    assert (envs.state.layout_status == 1).float().mean() >= 0.98


def test_the_mark_is_seen(compiled):
    """In every picture some green is where the mark is, and none without it."""
    envs = SceneVectorEnv(ClutterPush, 4, scene=compiled, render_mode="rgb_array", render_config={"size": (160, 120)})
    envs.reset(seed=41)
    green = []
    for height in (0.0, -1.0):
        moved = envs.batch.data.mocap_pos.numpy()
        moved[:, 0, 2] += height
        envs.batch.data.mocap_pos.assign(moved)
        frames = np.stack(envs.render() or ()).astype(int)
        green.append(
            ((frames[..., 1] > 1.5 * frames[..., 0]) & (frames[..., 1] > 1.5 * frames[..., 2])).sum(axis=(1, 2))
        )
    assert green[0].min() >= 4
    assert green[1].max() == 0


def test_terms_of_the_reward(compiled):
    """A tin on the mark, and clutter that moves."""
    envs = SceneVectorEnv(ClutterPush, 2, scene=compiled, autoreset_mode="Disabled")
    envs.reset(seed=3)
    task: Any = envs.task
    s, d = envs.state, envs.batch.data
    away = task.to_goal(s).norm(dim=1)
    terms = task.reward(s, torch.zeros(2, 4))
    torch.testing.assert_close(terms["pushing"], 0.08 * (1 - torch.tanh(5 * away)))
    assert (terms["arrived"] == 0).all()
    assert (terms["disturbing"] == 0).all()
    assert (terms["reaching"] > 0).all()
    qpos, qvel = d.qpos.numpy(), d.qvel.numpy()
    tin, can = compiled.mjm.joint("tin/free"), compiled.mjm.joint("can/free")
    qpos[0, tin.qposadr[0] : tin.qposadr[0] + 2] = d.mocap_pos.numpy()[0, 0, :2] + [0.02, 0.0]
    qvel[1, can.dofadr[0] : can.dofadr[0] + 3] = [0.0, 0.5, 0.0]
    d.qpos.assign(qpos)
    d.qvel.assign(qvel)
    envs.batch.update()
    terms = task.reward(s, torch.ones(2, 4))
    assert terms["arrived"].tolist() == pytest.approx([0.04, 0.0])
    assert terms["resting"].tolist() == pytest.approx([0.08, 0.0])
    assert terms["disturbing"].tolist() == pytest.approx([0.0, -0.005])
    assert terms["effort"].tolist() == pytest.approx([-0.001, -0.001])
    assert task.success(s).tolist() == [True, False]


def test_a_tin_that_passes_over_the_mark_has_not_arrived(compiled):
    """It is there, but faster than 1 cm/s: no success, and no reward for resting."""
    envs = SceneVectorEnv(ClutterPush, 2, scene=compiled, autoreset_mode="Disabled")
    envs.reset(seed=3)
    task: Any = envs.task
    d, tin = envs.batch.data, compiled.mjm.joint("tin/free")
    qpos, qvel = d.qpos.numpy(), d.qvel.numpy()
    qpos[:, tin.qposadr[0] : tin.qposadr[0] + 2] = d.mocap_pos.numpy()[:, 0, :2]
    qvel[:, tin.dofadr[0]] = [0.009, 0.011]
    d.qpos.assign(qpos)
    d.qvel.assign(qvel)
    envs.batch.update()
    terms = task.reward(envs.state, torch.zeros(2, 4))
    assert (terms["arrived"] > 0).tolist() == [True, True]
    assert (terms["resting"] > 0).tolist() == [True, False]
    assert task.success(envs.state).tolist() == [True, False]


ASIDE = {
    "objects.goal.region": {"box": [[-0.06, 0.18], [0.06, 0.24]]},
    "objects.tin.region": {"box": [[-0.06, 0.0], [0.06, 0.08]]},
    "objects.can.relations": [],
    "objects.can.region": {"box": [[-0.24, 0.06], [-0.22, 0.26]]},
    "objects.orange.region": {"box": [[0.22, 0.06], [0.24, 0.14]]},
    "objects.block.region": {"box": [[0.22, 0.18], [0.24, 0.26]]},
}


@pytest.mark.slow
def test_a_script_pushes_where_the_way_is_free():
    """Over, down, and along, and once more where the tin rolls aside: it arrives where the clutter does not stand."""
    envs = SceneVectorEnv(ClutterPush, 6, device="cpu", overrides=ASIDE, autoreset_mode="Disabled")
    observation, _ = envs.reset(seed=20)
    down, there = torch.zeros(6, dtype=torch.bool), torch.zeros(6, dtype=torch.bool)
    returns, info = [], {}
    for _ in range(250):
        way = values(envs, observation, "tcp_to_behind", "critic")
        left = values(envs, observation, "tin_to_goal")[:, :2]
        down |= way[:, :2].norm(dim=1) < 0.01
        pushing = down & (way[:, 2] > -0.01)
        line = torch.nn.functional.normalize(left, dim=1)
        across = way[:, :2] - (way[:, :2] * line).sum(dim=1, keepdim=True) * line
        push = 2.0 * across + 0.014 * line  # a round tin rolls aside from where it is not pushed in its middle
        down &= across.norm(dim=1) < 0.03
        there |= left.norm(dim=1) < 0.03
        flat = torch.where(pushing[:, None], push, way[:, :2])
        height = torch.where(down, way[:, 2], way[:, 2] + 0.1)
        tool, target = values(envs, observation, "tcp_pose")[:, :3], values(envs, observation, "tool_target")
        wanted = tool + torch.cat([flat, height[:, None]], dim=1).clamp(-0.03, 0.03)
        action = torch.cat([(wanted - target[:, :3]) / 0.02, -target[:, 3:] / 0.1], dim=1)
        action[there] = torch.tensor([0.0, 0.0, 0.2, 0.0])  # away from it
        observation, reward, _, _, info = envs.step(action)
        returns.append(reward)
    assert info["success"].all(), "at the last step"
    fifths = torch.stack(returns).reshape(5, 50, 6).sum(dim=1)
    assert (fifths[1:3] > fifths[:2]).all(), "the reward grows on the way"
    assert fifths[3:].min() > 9.0
