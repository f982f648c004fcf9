"""Judge a policy on layouts that it has not seen, then run the failures again and draw the first one."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import torch
import tyro

from sceniris_gym import cli, evaluate


def main(
    num_envs: int = 64, layouts: int = 256, picture: Path = Path("failure.png"), device: str | None = None
) -> None:
    """Judge a policy that moves at random.

    Args:
        num_envs: number of worlds.
        layouts: number of layouts of the split "eval": those of the seeds from 0 on.
        picture: PNG of the first layout on which the policy fails.
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one, else cpu.
    """
    env_id = "sceniris_gym:sceniris_gym/TabletopReach-v0"
    envs: Any = gym.make_vec(env_id, num_envs=num_envs, split="eval", device=device)
    noise = torch.Generator().manual_seed(0)

    def policy(observation: dict) -> torch.Tensor:
        # your network comes here, and acts on observation["policy"]
        return 2.0 * torch.rand(envs.action_space.shape, generator=noise) - 1.0

    results = evaluate(policy, envs, layouts)
    failed = [result.id for result in results if not result.success]
    print(f"{len(results) - len(failed)} of {len(results)} succeed; the first failure is {failed[0]}")

    again = evaluate(policy, envs, failed[:num_envs])  # ids are enough to get the same layouts, on any machine
    print(f"{sum(result.success for result in again)} of {len(again)} failures succeed when they are tried once more")
    cli.main(["replay", failed[0], "--out", str(picture)])
    envs.close()


if __name__ == "__main__":
    tyro.cli(main)
