"""Train Stable-Baselines3's PPO on TabletopReachEasy-v0, and evaluate it on layouts that it has never seen.

Needs the extra: pip install 'sceniris-gym[sb3]'.
"""

from pathlib import Path

import gymnasium as gym
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecNormalize

from sceniris_gym.adapters.sb3 import SB3VecEnv

ENV_ID = "sceniris_gym:sceniris_gym/TabletopReachEasy-v0"


class PrintStatistics(BaseCallback):
    """Callback that prints statistics of the episodes of a rollout, which are summed up on the device."""

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        (statistics,) = self.training_env.get_attr("statistics", indices=0)
        found = statistics.read()
        if found["episodes"]:
            terms = ", ".join(f"{name} {value:.3f}" for name, value in found["reward_terms"].items())
            print(f"{self.num_timesteps} steps: return {found['return']:.3f}, success {found['success']:.2f}; {terms}")


def judge(model: PPO, trained: VecNormalize, num_envs: int, device: str | None) -> str:
    """Return the result of the first episodes of the split `eval`, without exploration."""
    envs = SB3VecEnv(gym.make_vec(ENV_ID, num_envs=num_envs, device=device, split="eval"))
    envs.seed(0)
    normalized = VecNormalize(envs, training=False, norm_reward=False)
    normalized.obs_rms = trained.obs_rms
    mean, deviation = evaluate_policy(model, normalized, n_eval_episodes=num_envs)
    success = envs.env.statistics.read()["success"]
    envs.close()
    return f"return {mean:.3f} +- {deviation:.3f}, success {success:.2f}"


def main(
    num_envs: int = 64,
    steps: int = 200_000,
    rollout: int = 10,
    seed: int = 0,
    device: str | None = None,
    out: Path | None = None,
) -> None:
    """Train, and evaluate before and after.

    Args:
        num_envs: number of worlds.
        steps: total number of steps over all worlds.
        rollout: steps of each world between two updates of the policy.
        seed: seed of the policy; world i gets this seed + i.
        device: device of the worlds, "cpu" or "cuda:0"; by default cuda:0 if there is one, else cpu.
        out: folder for model.zip and normalize.pkl; by default nothing is saved.
    """
    envs = VecNormalize(SB3VecEnv(gym.make_vec(ENV_ID, num_envs=num_envs, device=device)), gamma=0.9)
    model = PPO(
        "MlpPolicy",
        envs,
        n_steps=rollout,
        batch_size=num_envs * rollout // 2,
        gamma=0.9,
        learning_rate=2e-3,
        use_sde=True,  # noise that lasts for several steps moves an arm further
        sde_sample_freq=10,
        policy_kwargs={"log_std_init": -1.0},
        seed=seed,
        device="cpu",  # small networks, and SB3 exchanges numpy arrays
    )
    print("before:", judge(model, envs, num_envs, device))
    model.learn(steps, callback=PrintStatistics())
    print("after:", judge(model, envs, num_envs, device))
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        model.save(out / "model.zip")
        envs.save(str(out / "normalize.pkl"))
    envs.close()


if __name__ == "__main__":
    tyro.cli(main)
