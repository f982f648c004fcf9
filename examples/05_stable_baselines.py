"""Train Stable-Baselines3's PPO on TabletopReachEasy-v0, and evaluate it on unseen layouts.

Needs the extra: pip install 'sceniris-gym[sb3]'.
"""

import gymnasium as gym
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecNormalize

from sceniris_gym.adapters.sb3 import Sb3VecEnvWrapper

ENV_ID = "sceniris_gym:sceniris_gym/TabletopReachEasy-v0"
SETTINGS = {
    "n_steps": 10,
    "learning_rate": 2e-3,
    "use_sde": True,  # noise that lasts several steps moves an arm further
    "sde_sample_freq": 10,
    "policy_kwargs": {"log_std_init": -1.0},
    "device": "cpu",  # the CPU is fast enough: the networks are small, and SB3 exchanges numpy arrays
}


def judge(model: PPO, trained: VecNormalize, device: str | None) -> str:
    """Return the results of a policy with deterministic actions on the first layouts of the split `eval`."""
    envs = Sb3VecEnvWrapper(gym.make_vec(ENV_ID, num_envs=trained.num_envs, device=device, split="eval"))
    envs.seed(0)
    normalized = VecNormalize(envs, training=False, norm_reward=False)
    normalized.obs_rms = trained.obs_rms
    mean, deviation = evaluate_policy(model, normalized, n_eval_episodes=envs.num_envs)
    success = envs.env.statistics.read()["success"]
    envs.close()
    return f"return {mean:.3f} +- {deviation:.3f}, success {success:.2f}"


def main(
    num_envs: int = 64,
    steps: int = 200_000,
    device: str | None = None,
    out: str = "results/sb3",
) -> None:
    """Train, evaluate before and after, and save the policy for `sceniris-gym view --policy`."""
    envs = VecNormalize(Sb3VecEnvWrapper(gym.make_vec(ENV_ID, num_envs=num_envs, device=device)), gamma=0.9)
    model = PPO("MlpPolicy", envs, gamma=0.9, batch_size=5 * num_envs, seed=0, **SETTINGS)
    print("before:", judge(model, envs, device))
    for _ in range(10):
        model.learn(steps // 10, reset_num_timesteps=False)
        found = envs.get_attr("statistics")[0].read()  # over the episodes that ended since the last call
        terms = ", ".join(f"{name} {value:.3f}" for name, value in found["reward_terms"].items())
        print(f"{model.num_timesteps} steps: return {found['return']:.3f}, success {found['success']:.2f}; {terms}")
    print("after:", judge(model, envs, device))
    model.save(f"{out}/model.zip")
    envs.save(f"{out}/normalize.pkl")
    envs.close()


if __name__ == "__main__":
    tyro.cli(main)
