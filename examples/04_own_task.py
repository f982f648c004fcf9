"""A task and its scene from scratch: an arm moves its fingers to an orange on a table."""

import gymnasium as gym
import torch
import tyro
from torch import Tensor

from sceniris_gym import ArmController, State, Task

SCENE = {
    "robot": {"asset": "panda", "base": [-0.3, 0.0, 0.4]},
    "objects": {
        "table": {"asset": "table", "kind": "static"},
        "orange": {"asset": "orange", "on": "table", "ratio_on_support": 1, "reachable": "map"},
    },
}


class TouchOrange(Task):
    """Task of moving the fingertips to within 6 cm of the orange. Poses are in the robot's base frame."""

    action_size = 7

    def bind(self, s: State) -> None:
        self.arm = ArmController(s)  # a scene with several robots needs the robot's name

    def apply(self, s: State, action: Tensor) -> None:
        self.arm.move_joints(s, action)

    def observe(self, s: State) -> dict[str, dict[str, Tensor]]:
        return {"policy": {"arm_qpos": self.arm.qpos(s), "arm_qvel": self.arm.qvel(s), "way": self.way(s)}}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        near = 1.0 - torch.tanh(5.0 * self.way(s).norm(dim=1))
        return {"near": near, "effort": -0.01 * action.square().mean(dim=1)}

    def success(self, s: State) -> Tensor:
        return self.way(s).norm(dim=1) < 0.06

    def way(self, s: State) -> Tensor:
        """Return the vector from the fingertips to the orange [m], shape (num_envs, 3)."""
        return s.site("orange/grasp")[:, :3] - self.arm.tool(s)[:, :3]


def main(num_envs: int = 64, steps: int = 100, device: str | None = None) -> None:
    """Make the environment, and take random actions."""
    gym.register("TouchOrange-v0", vector_entry_point="sceniris_gym:SceneVectorEnv", max_episode_steps=100)
    envs = gym.make_vec("TouchOrange-v0", num_envs=num_envs, task=TouchOrange, scene=SCENE, device=device)
    obs, _ = envs.reset(seed=0)
    start = nearest = obs["policy"][:, -3:].norm(dim=1)
    for _ in range(steps):
        obs, *_ = envs.step(envs.action_space.sample())
        nearest = torch.minimum(nearest, obs["policy"][:, -3:].norm(dim=1))
    print(f"fingers to orange: {start.mean():.2f} m at the start, {nearest.mean():.2f} m at best")


if __name__ == "__main__":
    tyro.cli(main)
