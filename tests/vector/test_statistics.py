"""Results of a step, and statistics of finished episodes: counted once, in every autoreset mode."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
import warp as wp
from torch import Tensor

from sceniris_gym.vector.statistics import EpisodeStatistics, Outcome
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.stepping import actions, leaves

STEPS = 40


def play(envs, steps: int = STEPS) -> list[tuple[float, int, bool, dict[str, float]]]:
    """Step with changing actions, and list return, length, success and terms of the episodes that finish, by hand."""
    envs.reset(seed=0)
    generator = torch.Generator().manual_seed(0)
    kept: list[list] = [[] for _ in range(envs.num_envs)]
    due, finished = [False] * envs.num_envs, []
    for _ in range(steps):
        action = 2.0 * torch.rand(envs.num_envs, 5, generator=generator) - 1.0
        _, reward, terminated, truncated, info = envs.step(action)
        for i, track in enumerate(kept):
            if due[i]:  # the step that only resets, where the mode is NEXT_STEP
                due[i] = False
                continue
            terms = {name: float(term[i]) for name, term in info["reward_terms"].items()}
            track.append((float(reward[i]), bool(info["success"][i]), terms))
            if terminated[i] or truncated[i]:
                total = {name: sum(step[2][name] for step in track) for name in terms}
                finished.append((sum(step[0] for step in track), len(track), track[-1][1], total))
                track.clear()
                due[i] = envs.autoreset_mode.value == "NextStep"
    return finished


@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
def test_the_means_are_those_of_the_finished_episodes(make_env, mode):
    """Ended early or truncated, several a world: as counted by hand from what the steps return."""
    envs = make_env(3, max_episode_steps=6, autoreset_mode=mode)
    finished = play(envs)
    assert len(finished) > 6
    assert len({length for _, length, _, _ in finished}) > 2
    found = envs.statistics.read()
    count = len(finished)
    assert found["episodes"] == count
    assert found["return"] == pytest.approx(sum(episode[0] for episode in finished) / count, rel=1e-5)
    assert found["length"] == pytest.approx(sum(episode[1] for episode in finished) / count)
    assert found["success"] == pytest.approx(sum(episode[2] for episode in finished) / count)
    assert found["reward_terms"].keys() == {"near", "effort"}
    for name, mean in found["reward_terms"].items():
        assert mean == pytest.approx(sum(episode[3][name] for episode in finished) / count, rel=1e-5)


def test_reading_begins_new_sums_unless_told_otherwise(make_env):
    """A second reading speaks of later episodes only; without any, the means are not numbers."""
    envs = make_env(2, max_episode_steps=2)
    nothing = envs.statistics.read()
    assert nothing["episodes"] == 0
    assert math.isnan(nothing["return"])
    assert nothing["reward_terms"] == {}
    envs.reset(seed=0)
    for _ in range(5):
        envs.step(torch.zeros(2, 5))
    assert envs.statistics.read(clear=False) == envs.statistics.read()
    assert envs.statistics.read()["episodes"] == 0
    _, reward, *_ = envs.step(torch.zeros(2, 5))
    last = envs.statistics.read()
    assert (last["episodes"], last["length"]) == (2, 2.0)
    assert last["return"] < float(reward.mean()), "the step before the reading belongs to the episode"


def test_the_latest_sums_are_of_the_last_step_alone(make_env):
    """Before any step, in one that finishes nothing, and in one that does, also after a reading."""
    envs = make_env(2, max_episode_steps=2)
    envs.reset(seed=0)
    assert envs.statistics.latest().tolist() == [0.0] * 4
    for _ in range(2):
        total = envs.step(torch.zeros(2, 5))[1]
        assert envs.statistics.latest().tolist() == [0.0] * 6
        total = total + envs.step(torch.zeros(2, 5))[1]
        envs.statistics.read()
        latest = dict(zip(envs.statistics.names, envs.statistics.latest().tolist(), strict=True))
        assert (latest["episodes"], latest["length"]) == (2.0, 4.0)
        assert latest["near"] + latest["effort"] == pytest.approx(float(total.sum()), rel=1e-5)


def test_an_episode_that_a_reset_cuts_short_does_not_count(make_env):
    """Neither its steps nor its reward are found in the next one."""
    envs = make_env(2, max_episode_steps=3, autoreset_mode="Disabled")
    envs.reset(seed=0)
    envs.step(torch.zeros(2, 5))
    envs.reset(options={"reset_mask": torch.tensor([True, False])})
    for _ in range(2):
        envs.step(torch.zeros(2, 5))
    assert envs.statistics.read()["episodes"] == 1
    envs.reset(seed=1)
    total = torch.zeros(2)
    for _ in range(3):
        total += envs.step(torch.zeros(2, 5))[1]
    found = envs.statistics.read()
    assert (found["episodes"], found["length"]) == (2, 3.0)
    assert found["return"] == pytest.approx(float(total.mean()), rel=1e-5)


def test_with_autoreset_disabled_an_end_counts_once(make_env):
    """A finished world goes on until it is reset; that is no episode."""
    envs = make_env(2, max_episode_steps=2, autoreset_mode="Disabled")
    envs.reset(seed=0)
    for _ in range(5):
        envs.step(torch.zeros(2, 5))
    assert envs.statistics.read()["episodes"] == 2
    envs.reset()
    for _ in range(2):
        envs.step(torch.zeros(2, 5))
    assert envs.statistics.read()["episodes"] == 2


def test_success_is_that_of_the_last_step():
    """One of two worlds ends in success, the other had it in between."""
    statistics, no = EpisodeStatistics(2, torch.device("cpu")), torch.zeros(2, dtype=torch.bool)
    for success, done in (([False, True], [False, False]), ([True, False], [True, True])):
        gained = torch.tensor([[1.0, 2.0]])
        flags = torch.tensor(success), no, torch.tensor(done), no
        statistics.add(Outcome(("near",), gained, *flags), torch.tensor([2, 2]))
    assert statistics.read() == {
        "episodes": 2,
        "return": 3.0,
        "length": 2.0,
        "success": 0.5,
        "broken": 0,
        "reward_terms": {"near": 3.0},
    }


def test_a_first_step_under_inference_mode_leaves_buffers_that_others_may_write_to(make_env):
    """Training loops begin under inference mode and go on without it."""
    envs = make_env(2, max_episode_steps=2)
    with torch.inference_mode():
        envs.reset(seed=0)
        envs.step(torch.zeros(2, 5))
    envs.step(torch.zeros(2, 5))
    assert envs.statistics.read()["episodes"] == 2


def test_a_broken_world_does_not_spoil_the_sums(make_env):
    """A world with positions that are no numbers ends with what it had gained before."""
    envs = make_env(2)
    envs.reset(seed=0)
    _, reward, *_ = envs.step(torch.zeros(2, 5))
    qvel = envs.batch.data.qvel.numpy()
    qvel[0] = math.nan
    envs.batch.data.qvel.assign(qvel)
    envs.step(torch.zeros(2, 5))
    found = envs.statistics.read()
    assert (found["episodes"], found["length"]) == (1, 2.0)
    assert found["return"] == pytest.approx(float(reward[0]))


def test_without_copy_all_but_observations_is_kept(make_env):
    """The final info is of the episode that ended, and neither it nor the new one changes in later steps."""
    envs = make_env(2, sim_config={"copy": False}, max_episode_steps=2)
    envs.task.success = lambda s: flags  # a task may return a tensor that it writes to
    flags = torch.ones(2, dtype=torch.bool)
    envs.reset(seed=5)
    envs.step(actions(2))
    *outcome, info = envs.step(actions(2))
    flags.fill_(False)
    final = info["final_info"]
    kept = [outcome[1:], {name: value for name, value in info.items() if name != "final_obs"}]
    copies = [leaf.clone() for leaf in leaves(kept)]
    for _ in range(3):
        envs.step(actions(2))
    assert final["layout"]["episode"].tolist() == [0, 0]
    assert info["layout"]["episode"].tolist() == [1, 1]
    assert final["success"].tolist() == info["success"].tolist() == [True, True]
    for leaf, copy in zip(leaves(kept), copies, strict=True):
        assert torch.equal(leaf, copy)


def test_a_world_with_nans_is_ended_and_cured(make_env):
    """A broken world is terminated with reward 0 and starts anew; its neighbour goes on."""
    envs = make_env(2)
    envs.reset(seed=0)
    qvel = envs.batch.data.qvel.numpy()
    qvel[0] = np.nan
    envs.batch.data.qvel.assign(qvel)
    observation, reward, terminated, _, info = envs.step(actions(2))
    assert terminated.tolist() == info["_final_obs"].tolist() == info["broken"].tolist() == [True, False]
    assert info["final_info"]["broken"].tolist() == [True, False]
    assert info["final_info"]["layout"]["seed"].tolist() == [0, 1]
    assert envs.statistics.read()["broken"] == 1
    assert float(reward[0]) == 0.0
    assert torch.isfinite(observation["critic"]).all()
    twin = make_env(2)
    twin.reset(seed=0)
    twin.reset()
    np.testing.assert_array_equal(envs.step(actions(2))[0]["critic"][0], twin.step(actions(2))[0]["critic"][0])


def _poison_ctrl(envs: SceneVectorEnv, value: Tensor) -> None:
    envs.task.apply = lambda s, action: s.ctrl[:, 2].copy_(value)  # which its range keeps from the positions


def _poison_act(envs: SceneVectorEnv, value: Tensor) -> None:
    act = wp.to_torch(envs.batch.data.act)
    envs.task.apply = lambda s, action: act[:, 0].copy_(value)


def _poison_reward(envs: SceneVectorEnv, value: Tensor) -> None:
    envs.task.reward = lambda s, action: {"near": value.clone(), "one": torch.ones(2)}


def _poison_observation(envs: SceneVectorEnv, value: Tensor) -> None:
    envs.task.observe = lambda s: {"policy": {"x": value[:, None] * s.elapsed[:, None].clamp(max=1)}}


POISONS = (_poison_ctrl, _poison_act, _poison_reward, _poison_observation)


@pytest.mark.parametrize("mode", ["SameStep", "NextStep", "Disabled"])
@pytest.mark.parametrize("poison", POISONS)
def test_a_world_is_broken_in_the_step_that_has_the_nan(make_env, poison, mode: str):
    """By controls, activations, rewards or observations: terminated with reward 0, once, and finite after its reset."""
    envs, value = make_env(2, autoreset_mode=mode, observation_groups=("policy",)), torch.zeros(2)
    poison(envs, value)
    envs.reset(seed=0)
    assert not envs.step(actions(2))[-1]["broken"].any()
    value[1] = np.nan if mode != "NextStep" else np.inf
    _, reward, terminated, _, info = envs.step(actions(2))
    assert info["broken"].tolist() == terminated.tolist() == [False, True]
    assert float(reward[1]) == 0.0
    assert info["reward_terms"]["near"].isfinite().all()
    assert envs.statistics.read()["broken"] == 1
    value.zero_()
    if mode == "Disabled":
        envs.reset(options={"reset_mask": terminated})
    observation, _, terminated, _, info = envs.step(actions(2))
    assert not (info["broken"] | terminated).any()
    assert observation["policy"].isfinite().all()
    assert envs.state.finite.all()


@pytest.mark.parametrize("dtype", [torch.float64, torch.float16, torch.int64])
def test_rewards_are_of_single_precision_whatever_a_task_returns(make_env, dtype):
    """Their terms too."""
    envs = make_env(2)
    envs.task.reward = lambda s, action: {"three": torch.full((2,), 3, dtype=dtype)}
    envs.reset(seed=0)
    _, reward, _, _, info = envs.step(actions(2))
    assert reward.dtype == info["reward_terms"]["three"].dtype == torch.float32
    assert reward.tolist() == [3.0, 3.0]
