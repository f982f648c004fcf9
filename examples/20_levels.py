"""Level replay: replay the layouts that teach a policy the most, then save and restore the level buffer."""

from typing import Any

import gymnasium as gym
import numpy as np
import torch
import tyro

import sceniris_gym  # noqa: F401, registers the environments
from sceniris_gym import LevelReplay

STEPS = 20  # of an episode


def main(num_envs: int = 1024, episodes: int = 20, device: str | None = None) -> None:
    """Play episodes, half of them on levels from the buffer. A level is one layout.

    Args:
        num_envs: number of worlds.
        episodes: episodes of each world.
        device: "cpu" or "cuda:0", by default cuda:0 if available, otherwise cpu.
    """
    replay = LevelReplay("failure", replay_prob=0.5, capacity=1 << 14, refresh_interval=4)
    kwargs: dict[str, Any] = {"num_envs": num_envs, "device": device, "max_episode_steps": STEPS, "curriculum": replay}
    envs = gym.make_vec("sceniris_gym/TabletopReach-v0", **kwargs)
    base: Any = envs.unwrapped
    sampler = base.randomizer.levels
    envs.reset(seed=0)
    replays = torch.zeros(num_envs, device=base.device)
    for _ in range(episodes * STEPS):
        *_, info = envs.step(envs.action_space.sample())
        replays += info["_final_info"] * (info["layout"]["level"] >= 0)
    print(f"{replays.sum() / (num_envs * episodes):.0%} of the episodes were on levels played before")
    print(f"{sampler.size} levels are in the buffer")
    drawn = sampler.sample(1000)
    print(f"1000 draws have {len(np.unique(drawn['level']))} different levels")

    state = sampler.state()  # NumPy arrays, for a checkpoint
    again: Any = gym.make_vec("sceniris_gym/TabletopReach-v0", **kwargs | {"scene": base.compiled}).unwrapped
    again.reset(seed=1)
    again.randomizer.levels.restore(state)
    print(f"after a restore, a new environment has {again.randomizer.levels.size} of them")


if __name__ == "__main__":
    tyro.cli(main)
