"""Your own learning loop: PPO (Schulman et al. 2017) in one file, all of it on the worlds' device."""

import time

import gymnasium as gym
import torch
import tyro
from torch import Tensor, nn
from torch.distributions import Normal

from sceniris_gym import SceneVectorEnv

GAMMA, LAMBDA, CLIP, ENTROPY, EPOCHS, BATCHES = 0.98, 0.95, 0.2, 0.002, 5, 4


class Normalizer(nn.Module):
    """Normalization of observations to mean 0 and variance 1, by the statistics of all observations so far."""

    mean: Tensor
    variance: Tensor
    count: Tensor

    def __init__(self, size: int) -> None:
        super().__init__()
        for name, value in (("mean", torch.zeros(size)), ("variance", torch.ones(size)), ("count", torch.zeros(()))):
            self.register_buffer(name, value)

    def forward(self, x: Tensor) -> Tensor:
        """Return the observations normalized, with outliers clipped."""
        return ((x - self.mean) / (self.variance + 1e-4).sqrt()).clamp(-10.0, 10.0)

    def learn(self, x: Tensor) -> None:
        """Update the statistics with a batch (Chan, Golub and LeVeque 1979)."""
        variance, mean = torch.var_mean(x, dim=0, correction=0)
        total = self.count + len(x)
        shift, share = mean - self.mean, len(x) / total
        self.variance += share * (variance - self.variance + shift**2 * (1.0 - share))
        self.mean += share * shift
        self.count.copy_(total)


def mlp(size: int, out: int, gain: float) -> nn.Sequential:
    """Return a small network; `gain` is that of the initial weights of its last layer."""
    layers = [nn.Linear(size, 256), nn.Linear(256, 128), nn.Linear(128, out)]
    for layer in layers:
        nn.init.orthogonal_(layer.weight, gain if layer is layers[-1] else 2**0.5)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(layers[0], nn.ELU(), layers[1], nn.ELU(), layers[2])


class Agent(nn.Module):
    """An actor that observes the group `policy`, and a critic that observes the group `critic`."""

    def __init__(self, seen: int, privileged: int, actions: int) -> None:
        super().__init__()
        self.seen, self.privileged = Normalizer(seen), Normalizer(privileged)
        self.actor, self.critic = mlp(seen, actions, 0.01), mlp(privileged, 1, 1.0)
        self.log_std = nn.Parameter(torch.zeros(actions))

    def policy(self, seen: Tensor) -> Normal:
        """Return the distribution of actions."""
        return Normal(self.actor(self.seen(seen)), self.log_std.exp())

    def value(self, privileged: Tensor) -> Tensor:
        """Return the expected sum of discounted rewards."""
        return self.critic(self.privileged(privileged))[..., 0]


def advantages(rewards: Tensor, values: Tensor, done: Tensor) -> Tensor:
    """Return generalized advantages (Schulman et al. 2016), shape (steps, num_envs); `values` has one more step."""
    found, later = torch.zeros_like(rewards), torch.zeros_like(rewards[0])
    for t in reversed(range(len(rewards))):
        going_on = ~done[t]
        later = rewards[t] - values[t] + GAMMA * going_on * (values[t + 1] + LAMBDA * later)
        found[t] = later
    return found


def collect(envs: gym.vector.VectorEnv, agent: Agent, obs: dict[str, Tensor], steps: int) -> tuple[dict, dict]:
    """Run the policy; return the transitions, shape (steps, num_envs, ...), and the last observation."""
    rows: list[dict[str, Tensor]] = []
    for _ in range(steps):
        dist = agent.policy(obs["policy"])
        action = dist.sample()
        after, reward, terminated, truncated, info = envs.step(action)
        # a truncated episode would have gone on: bootstrap with the value of its last observation. That of a world
        # that broke is NaN, so it is selected rather than multiplied by 0.
        to_come = agent.value(info["final_obs"]["critic"])
        reward = reward + GAMMA * torch.where(truncated & ~terminated, to_come, 0.0)
        row = {"action": action, "log_prob": dist.log_prob(action).sum(-1), "value": agent.value(obs["critic"])}
        rows.append({**obs, **row, "reward": reward, "done": terminated | truncated})
        obs = after
    return {name: torch.stack([row[name] for row in rows]) for name in rows[0]}, obs


def learn(agent: Agent, optimizer: torch.optim.Optimizer, data: dict[str, Tensor]) -> None:
    """Update the agent on the collected data, in minibatches."""
    size = len(data["advantage"])
    for _ in range(EPOCHS):
        for index in torch.randperm(size, device=data["advantage"].device).chunk(BATCHES):
            dist, advantage = agent.policy(data["policy"][index]), data["advantage"][index]
            ratio = (dist.log_prob(data["action"][index]).sum(-1) - data["log_prob"][index]).exp()
            gain = torch.minimum(ratio * advantage, ratio.clamp(1.0 - CLIP, 1.0 + CLIP) * advantage)
            error = (agent.value(data["critic"][index]) - data["return"][index]).square()
            loss = error.mean() - gain.mean() - ENTROPY * dist.entropy().sum(-1).mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), 1.0)
            optimizer.step()


def main(
    task: str = "TabletopReach-v0",
    num_envs: int = 2048,
    iterations: int = 300,
    steps: int = 24,
    seed: int = 0,
    device: str | None = None,
) -> None:
    """Train, and print the progress.

    Args:
        task: id of an environment of this package, without its namespace.
        num_envs: number of worlds.
        iterations: updates of the agent.
        steps: control steps of each world between two updates.
        seed: seed of layouts, network and actions.
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one, else cpu.
    """
    torch.manual_seed(seed)
    envs = gym.make_vec(f"sceniris_gym/{task}", num_envs=num_envs, device=device)
    assert isinstance(envs, SceneVectorEnv)
    obs, _ = envs.reset(seed=seed)
    actions = len(envs.single_action_space.sample())
    agent = Agent(obs["policy"].shape[1], obs["critic"].shape[1], actions).to(envs.device)
    optimizer = torch.optim.Adam(agent.parameters(), lr=5e-4)
    start = time.perf_counter()
    for iteration in range(1, iterations + 1):
        with torch.no_grad():
            data, obs = collect(envs, agent, obs, steps)
            values = torch.cat([data["value"], agent.value(obs["critic"])[None]])
            data["advantage"] = advantages(data["reward"], values, data["done"])
            data["return"] = data["advantage"] + data["value"]
            data["advantage"] = (data["advantage"] - data["advantage"].mean()) / (data["advantage"].std() + 1e-8)
        data = {name: part.flatten(0, 1) for name, part in data.items()}
        learn(agent, optimizer, data)
        agent.seen.learn(data["policy"])
        agent.privileged.learn(data["critic"])
        if iteration % 10 == 0 or iteration == iterations:
            found = envs.statistics.read()
            total = iteration * steps * num_envs
            print(
                f"{total:,} steps, {time.perf_counter() - start:.0f} s: {found['episodes']} episodes, "
                f"return {found['return']:.2f}, success {found['success']:.2f}"
            )
    envs.close()


if __name__ == "__main__":
    tyro.cli(main)
