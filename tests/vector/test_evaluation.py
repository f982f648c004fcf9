"""Evaluations: each row is what its episode was, however many worlds share the work."""

from __future__ import annotations

from collections.abc import Callable

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor

from sceniris_gym.errors import ArgumentError, SceneMismatchError
from sceniris_gym.layout.tables import make_table
from sceniris_gym.levels import ADR, LevelReplay
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.evaluation import evaluate
from sceniris_gym.vector.state import State
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import Reach

STEPS = 4
SLIDE = "objects.cabinet.joints.slide"


class Timed(Reach):
    """Success in the second step alone; worlds with an even seed end early, after three."""

    def success(self, s: State) -> Tensor:
        """At a time."""
        return s.elapsed == 2

    def terminated(self, s: State) -> Tensor:
        """By the seed."""
        return (s.elapsed >= 3) & (s.seed % 2 == 0)


@pytest.fixture
def make(reach_scene: CompiledScene) -> Callable[..., SceneVectorEnv]:
    """Return a function that makes environments of episodes of four steps."""
    return lambda num_envs, task=Timed, **words: SceneVectorEnv(
        task, num_envs, scene=reach_scene, max_episode_steps=STEPS, **words
    )


def turning(observation: dict) -> Tensor:
    """A policy that depends on what it sees."""
    policy = torch.as_tensor(observation["policy"])
    return torch.tanh(policy[:, :5])


def test_rows_are_those_of_the_episodes(make: Callable[..., SceneVectorEnv]):
    """Success at the end and ever, lengths and sums of rewards, by stepping the same episodes by hand."""
    envs = make(3)
    ids = [envs.compiled.layout_id(seed, episode) for seed, episode in ((7, 0), (8, 2), (9, 0), (4, 1))]
    found = evaluate(turning, envs, ids)
    assert [row.id for row in found] == ids
    assert [(row.success, row.success_once, row.length, row.fallback) for row in found] == [
        (False, True, 4, False),
        (False, True, 3, False),
        (False, True, 4, False),
        (False, True, 3, False),
    ]
    single = make(1, autoreset_mode="Disabled")
    for row, (seed, episode) in zip(found, ((7, 0), (8, 2), (9, 0), (4, 1)), strict=True):
        observation, _ = single.reset(seed=[seed])
        for _ in range(episode):
            observation, _ = single.reset()
        total = 0.0
        for _ in range(row.length):
            observation, reward, *_ = single.step(turning(observation))
            total += float(reward[0])
        assert row.total_reward == pytest.approx(total, rel=1e-6)


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("output", ["torch", "numpy"])
def test_they_do_not_depend_on_how_many_run_at_a_time(make: Callable[..., SceneVectorEnv], mode, output: str):
    """Nor on what happens to finished worlds."""
    expected = evaluate(turning, make(5), 5)
    assert evaluate(turning, make(2, autoreset_mode=mode, output=output), 5) == expected
    assert evaluate(turning, make(5)) == expected
    assert len({row.total_reward for row in expected}) == 5


def test_an_end_with_success_counts_as_such(make: Callable[..., SceneVectorEnv]):
    """Of the last step, not of one before or of the next episode."""

    class Last(Timed):
        def success(self, s: State) -> Tensor:
            return s.elapsed == STEPS

    assert [row.success for row in evaluate(turning, make(4, Last), 4)] == [False, True, False, True]


def test_what_is_not_of_the_environment_is_refused(make: Callable[..., SceneVectorEnv], reach_scene: CompiledScene):
    """Ids of another scene or split, no ids, and episodes without end."""
    envs = make(2)
    with pytest.raises(ArgumentError, match="should be scenehash"):
        evaluate(turning, envs, ["seven"])
    with pytest.raises(SceneMismatchError, match="belongs to scene"):
        evaluate(turning, envs, [f"{'0' * 16}:train:0:0"])
    with pytest.raises(SceneMismatchError, match="the split 'eval', not 'train'"):
        evaluate(turning, envs, [reach_scene.layout_id(0, 0, "eval")])
    with pytest.raises(ValueError, match="max_episode_steps"):
        evaluate(turning, SceneVectorEnv(Timed, 2, scene=reach_scene))


def test_one_id_and_numbers_of_any_library_are_taken(make: Callable[..., SceneVectorEnv]):
    """A single id is no sequence of letters; a negative number is refused."""
    envs = make(2)
    expected = evaluate(turning, envs, 3)
    assert evaluate(turning, envs, np.int64(3)) == expected  # pyrefly: ignore[bad-argument-type]
    assert evaluate(turning, envs, expected[1].id) == expected[1:2]
    with pytest.raises(ArgumentError, match="evaluate: layouts should be an integer of at least 0, got -1"):
        evaluate(turning, envs, -1)


def test_mappings_of_any_length_are_taken(make: Callable[..., SceneVectorEnv]):
    """Of scalars, lists and `info["layout"]`; the ids are those of the episodes that were played."""
    envs = make(2)
    expected = evaluate(turning, envs, 3)
    assert evaluate(turning, envs, {"seed": [0, 1, 2], "episode": 0}) == expected
    assert evaluate(turning, envs, {"seed": 1, "episode": 0}) == expected[1:2]
    assert evaluate(turning, envs, envs.reset(seed=0)[1]["layout"]) == expected[:2]
    for wrong, says in (
        ({"seed": [0, 1, 2], "episode": [0, 1]}, r"\['episode'\] should be an integer, or 3 of them, got \[0, 1\]"),
        ({"seed": 1}, r" should have the keys 'seed' and 'episode', got \['seed'\]"),
        ({"seed": "a", "episode": 0}, r"\['seed'\] should be an integer, or one for each world, got 'a'"),
    ):
        with pytest.raises(ArgumentError, match=f"evaluate: layouts{says}"):
            evaluate(turning, envs, wrong)


@pytest.mark.parametrize("curriculum", [LevelReplay("learnability", replay_prob=1.0), ADR({SLIDE: [0.05, 0.1]})])
def test_a_curriculum_changes_no_result(make: Callable[..., SceneVectorEnv], curriculum: LevelReplay | ADR):
    """Params have the values of the scene file, whatever the curriculum has reached; chosen values stay."""
    envs = make(2, curriculum=curriculum, params=SLIDE)
    seeds = {"seed": [5, 6, 7, 8, 9], "episode": 0}
    expected = evaluate(turning, make(2), seeds)
    for _ in range(3):
        assert evaluate(turning, envs, seeds) == expected
    assert evaluate(turning, envs, [result.id for result in expected]) == expected
    (narrow,) = evaluate(turning, envs, {"seed": 5, "episode": 0, "params": {SLIDE: [0.1, 0.11]}})
    assert narrow.id.startswith(f"{expected[0].id}:{SLIDE}=")


def test_rows_of_stored_layouts_are_played(make: Callable[..., SceneVectorEnv], reach_scene: CompiledScene):
    """Also of seeds that are no row numbers, and more episodes than worlds."""
    table = make_table(reach_scene, 3, 70)
    envs = SceneVectorEnv(Timed, 2, scene=reach_scene, layout_source=table, max_episode_steps=3)
    assert [result.id for result in evaluate(turning, envs, 3)] == [
        reach_scene.layout_id(seed, 0) for seed in (70, 71, 72)
    ]


def test_other_environments_are_refused(make: Callable[..., SceneVectorEnv]):
    """Those of other packages, and wrappers of other libraries, whose steps return something else."""

    class Wrapped:
        unwrapped = make(2)

    for other in (gym.make_vec("CartPole-v1", num_envs=2), Wrapped()):
        with pytest.raises(ArgumentError, match=rf"should be a SceneVectorEnv.*got {type(other).__name__}\."):
            evaluate(turning, other, 2)  # pyrefly: ignore[bad-argument-type]


def test_a_policy_is_a_function(make: Callable[..., SceneVectorEnv]):
    """A mistake ends before the first reset."""
    with pytest.raises(ArgumentError, match="policy should be a function of the observations, got 3"):
        evaluate(3, make(2), 2)  # pyrefly: ignore[bad-argument-type]


def test_wrappers_may_be_around(make: Callable[..., SceneVectorEnv]):
    """They only pass on what they are given."""
    from gymnasium.wrappers.vector import TransformAction

    envs = make(2, output="numpy")
    turned = TransformAction(envs, lambda actions: -np.asarray(actions))
    mirrored = evaluate(lambda observation: -turning(observation).numpy(), turned, 2)
    assert mirrored == evaluate(turning, make(2), 2)


def test_a_policy_may_look_at_images(make_env):
    """Those of the layouts that it is judged on: the same ids give the same results with more worlds at a time."""

    def look(observation: dict) -> torch.Tensor:
        depth = observation["images"]["overview"]["depth"]
        return (depth.mean(dim=(1, 2, 3), keepdim=False)[:, None] - 1.5).clamp(-0.8, 0.8).expand(-1, 5)

    images = {"overview": {"size": (16, 12), "data": "depth"}}
    few, many = (evaluate(look, make_env(n, max_episode_steps=4, images=images), 4) for n in (2, 4))
    assert [row.id for row in few] == [row.id for row in many]
    assert [row.total_reward for row in few] == pytest.approx([row.total_reward for row in many])
