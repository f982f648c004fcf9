"""A vector environment by its Gymnasium id: random actions, seeds, masked resets, and the layouts in `info`."""

import gymnasium as gym
import numpy as np
import torch
import tyro

import sceniris_gym  # noqa: F401, registers the environments


def main(num_envs: int = 64, steps: int = 250, device: str | None = None) -> None:
    """Act at random in DrawerPick-v0.

    Args:
        num_envs: number of worlds.
        steps: control steps, of 20 ms each.
        device: "cpu" or "cuda:0", by default cuda:0 if available, otherwise cpu.
    """
    envs = gym.make_vec("sceniris_gym/DrawerPick-v0", num_envs=num_envs, device=device)
    obs, info = envs.reset(seed=0)  # world i gets seed i: the same layouts on every run
    print("one world observes", envs.single_observation_space, "and takes", envs.single_action_space)
    print("policy:", tuple(obs["policy"].shape), "critic:", tuple(obs["critic"].shape), "on", obs["policy"].device)
    print("layouts: seeds", info["layout"]["seed"][:4].tolist(), "episodes", info["layout"]["episode"][:4].tolist())

    # A world whose episode ends is reset within the step, to the layout of its next episode.
    envs.action_space.seed(0)
    total, ended = torch.zeros(num_envs, device=obs["policy"].device), 0
    for _ in range(steps):
        action = envs.action_space.sample()  # a NumPy array, or a tensor on the device
        obs, reward, terminated, truncated, info = envs.step(action)
        total += reward
        ended += int((terminated | truncated).sum())
    fallbacks = int(info["layout"]["fallback"].sum())
    print(f"{steps} steps of {num_envs} worlds: mean reward {total.mean() / steps:.3f}, {ended} episodes ended")
    print("reward terms:", {name: round(float(term.mean()), 3) for name, term in info["reward_terms"].items()})
    print(f"{fallbacks} worlds hold a layout from the bank, all others a fresh layout")

    # Fresh layouts for every second world. The state of the others stays bitwise unchanged.
    mask = np.arange(num_envs) % 2 == 0
    before = obs["policy"]
    obs, info = envs.reset(options={"reset_mask": mask})
    kept = torch.equal(obs["policy"][~mask], before[~mask])
    print(f"masked reset of {mask.sum()} worlds; the others kept their observations: {kept}")
    envs.close()


if __name__ == "__main__":
    tyro.cli(main)
