"""Train Stable-Baselines3's PPO from pixels on TabletopReachPixels-v0, and evaluate it on unseen layouts.

Needs the extra: pip install 'sceniris-gym[sb3]'.
"""

import gymnasium as gym
import tyro
from stable_baselines3 import PPO

from sceniris_gym import evaluate
from sceniris_gym.adapters.sb3 import Sb3VecEnvWrapper

ENV_ID = "sceniris_gym:sceniris_gym/TabletopReachPixels-v0"
SEEN = ("policy", "front/rgb", "wrist/rgb")
"""Parts of the observation: one group of numbers, two pictures."""


def main(num_envs: int = 256, steps: int = 4_000_000, device: str | None = None, out: str = "pixels.zip") -> None:
    """Train, print the statistics of episodes, and save and evaluate the policy."""
    made = {"num_envs": num_envs, "device": device, "images": {"final": True}}
    envs = Sb3VecEnvWrapper(gym.make_vec(ENV_ID, **made), SEEN)
    model = PPO("MultiInputPolicy", envs, n_steps=24, batch_size=6 * num_envs, gamma=0.98, seed=0)
    for _ in range(10):
        model.learn(steps // 10, reset_num_timesteps=False)
        found = envs.get_attr("statistics")[0].read()  # over the episodes that ended since the last call
        print(f"{model.num_timesteps} steps: return {found['return']:.3f}, success {found['success']:.2f}")
    model.save(out)

    unseen = Sb3VecEnvWrapper(gym.make_vec(ENV_ID, split="eval", **made), SEEN)
    results = evaluate(lambda observation: model.predict(unseen.seen(observation), deterministic=True)[0], unseen.env)
    print(f"{sum(row.success for row in results)} of {len(results)} unseen layouts")


if __name__ == "__main__":
    tyro.cli(main)
