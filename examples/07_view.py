"""Watch an environment in the browser: every reset and every step, in real time.

Needs the extra: pip install 'sceniris-gym[viewer]'. The address of the page is printed on stderr. To see a scene
without an environment, run `sceniris-gym view SCENE`.
"""

from typing import Any

import gymnasium as gym
import torch
import tyro

import sceniris_gym  # noqa: F401, registers the environments


def main(
    env: str = "sceniris_gym/TabletopReach-v0",
    num_envs: int = 9,
    steps: int = 1000,
    device: str | None = None,
) -> None:
    """Watch arms that move at random.

    Args:
        env: id of the environment.
        num_envs: number of worlds.
        steps: control steps of each world.
        device: "cpu" or "cuda:0", by default cuda:0 if available, otherwise cpu.
    """
    envs: Any = gym.make_vec(env, num_envs=num_envs, device=device, render_mode="human").unwrapped
    envs.reset(seed=0)
    episodes, actions = 0, torch.zeros(num_envs, *envs.single_action_space.shape, device=envs.device)
    for step in range(steps):
        if step % 10 == 0:  # with new actions in every step, an arm only trembles
            actions = 0.5 * (2.0 * torch.rand_like(actions) - 1.0)
        _, _, terminated, truncated, _ = envs.step(actions)
        episodes += int((terminated | truncated).sum())
    print(f"{steps} steps of {num_envs} worlds were shown, in which {episodes} episodes ended")
    envs.close()


if __name__ == "__main__":
    tyro.cli(main)
