"""A task from nothing: the arm of the scene `drawer_pick` touches the handle of the open drawer, wherever that is."""

import gymnasium as gym
import torch
import tyro
from torch import Tensor

from sceniris_gym import State, Task


class TouchHandle(Task):
    """Bring the point between the finger tips to the handle; success is 3 cm. Poses are in the robot's base frame."""

    scene = "drawer_pick"  # or a scene file of your own
    action_size = 7

    def bind(self, s: State) -> None:
        """Look up once what the steps need."""
        limits = torch.tensor(s.mjm.actuator_ctrlrange[:7], dtype=torch.float32, device=s.device)
        self.low, self.high = limits.unbind(dim=1)

    def apply(self, s: State, action: Tensor) -> None:
        """Move the targets of the seven joints by up to 0.04 rad in a step."""
        s.ctrl[:, :7] = torch.clamp(s.ctrl[:, :7] + 0.04 * action, self.low, self.high)

    def observe(self, s: State) -> dict[str, dict[str, Tensor]]:
        """Joints, and the way from the fingers to the handle [m]."""
        joints = {"arm_qpos": s.qpos("panda")[:, :7], "arm_qvel": s.qvel("panda")[:, :7]}
        return {"policy": {**joints, "to_handle": self.to_handle(s)}}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Pay for being near, and a little less for moving much."""
        near = 1.0 - torch.tanh(5.0 * self.to_handle(s).norm(dim=1))
        return {"near": near, "effort": -0.01 * action.square().mean(dim=1)}

    def success(self, s: State) -> Tensor:
        """Say where the fingers are at the handle."""
        return self.to_handle(s).norm(dim=1) < 0.03

    def terminated(self, s: State) -> Tensor:
        """End the episode with success."""
        return self.success(s)

    @staticmethod
    def to_handle(s: State) -> Tensor:
        """Return the way from the fingers to the handle [m], shape (num_envs, 3)."""
        return s.site("cabinet/upper_handle")[:, :3] - s.site("panda/tcp")[:, :3]


gym.register(
    id="TouchHandle-v0",
    vector_entry_point="sceniris_gym:SceneVectorEnv",
    kwargs={"task": TouchHandle},
    max_episode_steps=150,
)


def main(num_envs: int = 64, steps: int = 150, device: str | None = None) -> None:
    """Act at random in the new environment.

    Args:
        num_envs: worlds that are stepped together.
        steps: control steps, of 20 ms each.
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one, else cpu.
    """
    # parts of the scene can be replaced by their keys: here the drawer is anywhere from half open to open
    overrides = {"objects.cabinet.joints.upper": {"fraction": [0.5, 1.0]}}
    envs = gym.make_vec("TouchHandle-v0", num_envs=num_envs, device=device, overrides=overrides)
    obs, _ = envs.reset(seed=0)
    envs.action_space.seed(0)
    start = obs["policy"][:, -3:].norm(dim=1)
    nearest, reached = start.clone(), 0
    for _ in range(steps):
        obs, _, _, _, info = envs.step(envs.action_space.sample())
        nearest = torch.minimum(nearest, obs["policy"][:, -3:].norm(dim=1))
        reached += int(info["success"].sum())
    print(f"fingers to handle: {start.mean():.2f} m at the start, {nearest.mean():.2f} m at best, {reached} touches")
    envs.close()


if __name__ == "__main__":
    tyro.cli(main)
