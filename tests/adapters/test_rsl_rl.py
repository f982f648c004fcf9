"""rsl-rl's view of our environments: what it keeps, what it assigns, what it logs; and its runner."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch

from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import Reach, reach_scene

pytest.importorskip("rsl_rl")

from rsl_rl.runners import OnPolicyRunner

from sceniris_gym.adapters.rsl_rl import RslRlVecEnvWrapper

__all__ = ["reach_scene"]


@pytest.fixture
def env(reach_scene: CompiledScene) -> RslRlVecEnvWrapper:
    """Return four worlds of the small reaching task, with episodes of five steps."""
    return RslRlVecEnvWrapper(SceneVectorEnv(Reach, 4, scene=reach_scene, max_episode_steps=5), seed=3)


def config() -> dict[str, Any]:
    """Return a small configuration of the runner, a new one each time because it writes to it."""
    model = {"class_name": "MLPModel", "hidden_dims": [16], "activation": "elu", "obs_normalization": True}
    return {
        "num_steps_per_env": 4,
        "save_interval": 100,
        "obs_groups": {"actor": ["policy"], "critic": ["critic"]},
        "actor": {**model, "distribution_cfg": {"class_name": "GaussianDistribution"}},
        "critic": model,
        "algorithm": {"class_name": "PPO", "num_learning_epochs": 2, "num_mini_batches": 2},
    }


def test_sizes_are_those_of_the_environment(env):
    """Actions, the longest episode, and observations as a TensorDict of groups."""
    assert (env.num_envs, env.num_actions, env.max_episode_length) == (4, 5, 5)
    observation = env.get_observations()
    assert observation.batch_size == (4,)
    assert observation["policy"].shape == (4, 19)
    assert observation["critic"].shape == (4, 28)
    assert env.cfg == {"task": "Reach", "scene": "scene", "num_envs": 4}
    assert env.unwrapped is env.env


def test_an_environment_with_a_plain_observation_keeps_the_name_of_its_group(env, reach_scene: CompiledScene):
    """Its reset and its steps are those of an environment with a dict of groups."""
    envs = SceneVectorEnv(Reach, 4, scene=reach_scene, max_episode_steps=5, observation_groups="policy")
    plain = RslRlVecEnvWrapper(envs, seed=3)
    assert torch.equal(plain.get_observations()["policy"], env.get_observations()["policy"])
    assert torch.equal(plain.reset(seed=1)[0]["policy"], env.reset(seed=1)[0]["policy"])
    for _ in range(5):
        assert torch.equal(plain.step(torch.ones(4, 5))[0]["policy"], env.step(torch.ones(4, 5))[0]["policy"])


def test_observations_are_never_overwritten_later(env):
    """All that was handed out in twelve random steps, with resets, is what it was when it came."""
    torch.manual_seed(0)
    kept = [env.get_observations()]
    copies = [kept[0].clone()]
    with torch.inference_mode():
        for _ in range(12):
            observation, *_ = env.step(2 * torch.rand(4, 5) - 1)
            kept.append(observation)
            copies.append(observation.clone())
    for observation, copy in zip(kept, copies, strict=True):
        assert torch.equal(observation["policy"], copy["policy"])
        assert torch.equal(observation["critic"], copy["critic"])
    assert not torch.equal(kept[0]["policy"], kept[1]["policy"])


def test_assigned_episode_lengths_are_copied_into_ours(env):
    """The tensor that the environment counts in stays the same one, and decides when episodes end."""
    ours = env.env.state.elapsed
    env.episode_length_buf = torch.tensor([0, 3, 4, 1])
    assert env.env.state.elapsed is ours
    assert env.episode_length_buf.tolist() == [0, 3, 4, 1]
    _, _, dones, extras = env.step(torch.zeros(4, 5))
    assert dones.tolist() == [0, 0, 1, 0]
    assert dones.dtype == torch.long
    assert extras["time_outs"].tolist() == [False, False, True, False]
    assert env.episode_length_buf.tolist() == [1, 4, 0, 2]


def test_a_termination_is_no_time_out(env):
    """An episode that ends by itself in its last step is not reported as cut short."""
    env.episode_length_buf = torch.tensor([4, 4, 0, 0])
    action = torch.zeros(4, 5)
    action[0, 0] = action[2, 0] = 1.0  # ends these episodes
    _, _, dones, extras = env.step(action)
    assert dones.tolist() == [1, 1, 1, 0]
    assert extras["time_outs"].tolist() == [False, True, False, False]
    assert extras["success"].shape == (4,)


def test_the_log_says_how_episodes_and_resets_went(env):
    """Scalars: means over the episodes that just ended, and over the layouts that the worlds are in."""
    env.episode_length_buf = torch.tensor([3, 3, 2, 2])
    total, log = torch.zeros(4), {}
    for step in range(3):
        _, _, _, extras = env.step(torch.full((4, 5), 0.5))
        log = extras["log"]
        assert env.log is log
        if step == 0:
            assert log["Episode/length"] == 0
        if step == 1:
            first = {name: float(value) for name, value in log.items()}
            assert first["Episode/length"] == 5
            total = torch.tensor(-0.01 * 5 * 0.25 * 2)  # effort of the two steps that were taken
            assert first["Episode/effort"] == pytest.approx(float(total), abs=1e-6)
    assert float(log["Episode/effort"]) == pytest.approx(1.5 * float(total), abs=1e-6)
    assert log["Episode/near"] < 0
    assert {"Episode/success", "Reset/valid_share", "Reset/fallback_share", "Reset/attempts"} <= set(log)
    assert log["Reset/valid_share"] == 1
    assert log["Reset/attempts"] >= 1
    assert {"Reset/reject_collision", "Reset/reject_overhead"} <= set(log)
    assert all(value.shape == () for value in log.values())


def test_the_log_does_not_depend_on_who_reads_the_statistics(reach_scene: CompiledScene):
    """Read and cleared after every step, or never: the same log, step by step."""
    logs = []
    for read in (False, True):
        envs = RslRlVecEnvWrapper(SceneVectorEnv(Reach, 4, scene=reach_scene, max_episode_steps=5), seed=3)
        envs.episode_length_buf = torch.tensor([0, 1, 2, 3])
        generator = torch.Generator().manual_seed(0)
        kept = []
        for _ in range(12):
            log = envs.step(1.6 * torch.rand(4, 5, generator=generator) - 0.8)[3]["log"]
            kept.append({name: float(value) for name, value in log.items() if name.startswith("Episode/")})
            if read:
                envs.unwrapped.statistics.read()
        logs.append(kept)
    assert logs[0] == logs[1]
    assert len({log["Episode/effort"] for log in logs[0]}) > 5


def test_environments_of_another_kind_are_refused(reach_scene):
    """Without SAME_STEP, torch, copies or an end of episodes the contract cannot be kept."""
    wrongs: list[dict[str, Any]] = [
        {"autoreset_mode": "NextStep"},
        {"output": "numpy"},
        {"sim_config": {"copy": False}},
    ]
    for wrong in wrongs:
        with pytest.raises(ValueError, match="autoreset_mode='SameStep', output='torch' and SimConfig"):
            RslRlVecEnvWrapper(SceneVectorEnv(Reach, 2, scene=reach_scene, max_episode_steps=5, **wrong))
    with pytest.raises(ValueError, match="max_episode_steps"):
        RslRlVecEnvWrapper(SceneVectorEnv(Reach, 2, scene=reach_scene))


def test_the_runner_trains_saves_and_goes_on(env, tmp_path: Path):
    """A second runner that loads the first one's file has its policy and its count."""
    torch.manual_seed(1)
    runner = OnPolicyRunner(env, config(), log_dir=None, device="cpu")
    before = [p.clone() for p in runner.alg.get_policy().parameters()]
    runner.learn(3, init_at_random_ep_len=True)
    assert any(not torch.equal(a, b) for a, b in zip(before, runner.alg.get_policy().parameters(), strict=True))
    runner.save(str(tmp_path / "model.pt"), {"note": 7})
    other = OnPolicyRunner(env, config(), log_dir=None, device="cpu")
    assert other.load(str(tmp_path / "model.pt")) == {"note": 7}
    assert other.current_learning_iteration == runner.current_learning_iteration
    observation = env.get_observations()
    policies = runner.get_inference_policy("cpu"), other.get_inference_policy("cpu")
    with torch.inference_mode():
        assert torch.equal(policies[0](observation), policies[1](observation))
    other.learn(1)


def test_images_train_a_cnn_model(reach_scene: CompiledScene):
    """A camera is a group, its pictures are channels: colours from 0 to 1, then depths [m]."""
    images = {"overview": {"size": (20, 16), "data": ("rgb", "depth")}}
    inner = SceneVectorEnv(Reach, 4, scene=reach_scene, max_episode_steps=5, images=images)
    env = RslRlVecEnvWrapper(inner, seed=3)
    seen = env.get_observations()["overview"]
    assert (seen.shape, seen.dtype) == ((4, 4, 16, 20), torch.float32)
    plain, _ = inner.reset(seed=3)
    pictures = plain["images"]["overview"]
    assert torch.equal((255 * seen[:, :3]).round().to(torch.uint8), pictures["rgb"].permute(0, 3, 1, 2))
    assert torch.equal(seen[:, 3], pictures["depth"][..., 0])
    settings = config()
    settings["obs_groups"]["actor"] = ["policy", "overview"]
    settings["actor"]["class_name"] = "CNNModel"
    settings["actor"]["cnn_cfg"] = {"output_channels": [4], "kernel_size": 4, "stride": 4}
    OnPolicyRunner(env, settings, log_dir=None, device="cpu").learn(2)
