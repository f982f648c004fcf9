"""Evaluate a policy on unseen layouts, run the failures again, and draw the first failure."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import torch
import tyro

from sceniris_gym import cli, evaluate


def main(
    num_envs: int = 64, layouts: int = 256, picture: Path = Path("failure.png"), device: str | None = None
) -> None:
    """Evaluate a policy with random actions, run its failures again, and draw the first failure.

    Args:
        num_envs: number of worlds.
        layouts: number of layouts of the split "eval", with seeds from 0 on.
        picture: PNG to write, of the first failed layout.
        device: "cpu" or "cuda:0", by default cuda:0 if available, otherwise cpu.
    """
    env_id = "sceniris_gym:sceniris_gym/TabletopReach-v0"
    envs: Any = gym.make_vec(env_id, num_envs=num_envs, split="eval", device=device)
    noise = torch.Generator().manual_seed(0)

    def policy(observation: dict) -> torch.Tensor:
        # Call your network here with observation["policy"].
        return 2.0 * torch.rand(envs.action_space.shape, generator=noise) - 1.0

    results = evaluate(policy, envs, layouts)
    failed = [result.id for result in results if not result.success]
    print(f"{len(results) - len(failed)} of {len(results)} succeed; the first failure is {failed[0]}")

    again = evaluate(policy, envs, failed[:num_envs])  # an id reproduces its layout on any machine
    print(f"{sum(result.success for result in again)} of {len(again)} failures succeed in a second try")
    cli.main(["replay", failed[0], "--out", str(picture)])
    envs.close()


if __name__ == "__main__":
    tyro.cli(main)
