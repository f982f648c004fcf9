"""Your learning loop: PPO (Schulman et al. 2017) in one file, entirely on the worlds' device."""

from typing import Any

import gymnasium as gym
import torch
import tyro
from torch import Tensor, nn
from torch.distributions import Normal

GAMMA, LAMBDA, CLIP = 0.98, 0.95, 0.2


def network(size: int, out: int) -> nn.Sequential:
    """Return an MLP. Its first layer normalises observations by the statistics of all observations so far."""
    layers = [nn.Linear(size, 256), nn.ELU(), nn.Linear(256, 128), nn.ELU(), nn.Linear(128, out)]
    return nn.Sequential(nn.BatchNorm1d(size, affine=False, momentum=None), *layers).eval()


def advantages(rewards: Tensor, values: Tensor, done: Tensor) -> Tensor:
    """Return generalised advantages (Schulman et al. 2016), shape (steps, num_envs). `values` has one more step."""
    found, later = torch.zeros_like(rewards), torch.zeros_like(rewards[0])
    for t in reversed(range(len(rewards))):
        found[t] = later = rewards[t] - values[t] + GAMMA * ~done[t] * (values[t + 1] + LAMBDA * later)
    return found


def main(task: str = "TabletopReachEasy-v0", num_envs: int = 2048, iterations: int = 120, steps: int = 24) -> None:
    """Train, and print the statistics of episodes. The critic sees more than the actor."""
    torch.manual_seed(0)
    envs: Any = gym.make_vec(f"sceniris_gym:sceniris_gym/{task}", num_envs=num_envs)
    obs, _ = envs.reset(seed=0)
    log_std = nn.Parameter(torch.zeros(envs.single_action_space.shape, device=envs.device))
    actor = network(obs["policy"].shape[1], len(log_std)).to(envs.device)
    critic = network(obs["critic"].shape[1], 1).to(envs.device)
    learnt = [*actor.parameters(), *critic.parameters(), log_std]
    optimizer = torch.optim.Adam(learnt, lr=5e-4)
    for iteration in range(1, iterations + 1):
        rows = []
        with torch.no_grad():
            for _ in range(steps):
                action = Normal(actor(obs["policy"]), log_std.exp()).sample()
                after, reward, terminated, truncated, info = envs.step(action)
                # A truncated episode counts with its value. `where` drops other values: a broken world's is NaN.
                to_come = torch.where(truncated & ~terminated, critic(info["final_obs"]["critic"])[:, 0], 0.0)
                rows.append((obs["policy"], obs["critic"], action, reward + GAMMA * to_come, terminated | truncated))
                obs = after
            seen, privileged, actions, rewards, done = (torch.stack(column) for column in zip(*rows, strict=True))
            values = torch.stack([critic(x)[:, 0] for x in (*privileged, obs["critic"])])
            gains = advantages(rewards, values, done)
            data = (seen, privileged, actions, gains + values[:-1], (gains - gains.mean()) / (gains.std() + 1e-8))
            seen, privileged, actions, returns, gains = (x.flatten(0, 1) for x in data)
            log_probs = Normal(actor(seen), log_std.exp()).log_prob(actions).sum(1)
        for index in (part for _ in range(5) for part in torch.randperm(len(seen), device=envs.device).chunk(4)):
            policy, gain = Normal(actor(seen[index]), log_std.exp()), gains[index]
            ratio = (policy.log_prob(actions[index]).sum(1) - log_probs[index]).exp()
            gain = torch.minimum(ratio * gain, ratio.clamp(1.0 - CLIP, 1.0 + CLIP) * gain)
            error = (critic(privileged[index])[:, 0] - returns[index]).square()
            optimizer.zero_grad()
            (error.mean() - gain.mean() - 0.002 * policy.entropy().sum(1).mean()).backward()
            nn.utils.clip_grad_norm_(learnt, 1.0)
            optimizer.step()
        for net, x in ((actor, seen), (critic, privileged)):
            net[0].train()(x)
            net.eval()
        if iteration % 10 == 0 or iteration == iterations:
            found, total = envs.statistics.read(), iteration * steps * num_envs
            print(f"{total:,} steps: {found['episodes']} episodes, success {found['success']:.2f}")
    envs.close()


if __name__ == "__main__":
    tyro.cli(main)
