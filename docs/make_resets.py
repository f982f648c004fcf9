"""The animation of the README: arms reach for one object after another, each in a fresh layout.

python -m docs.make_resets   # some minutes on a CPU
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from PIL import Image
from torch import Tensor

import sceniris_gym  # noqa: F401, registers the environments
from docs.make_worlds import SIZE, grid
from sceniris_gym.program.reach import robot_arm
from sceniris_gym.reach.solve import solve
from sceniris_gym.vector.arm_controller import JOINT_STEP

PICTURE = Path(__file__).parent / "resets.gif"
_ENV = "sceniris_gym/TabletopReach-v0"
_WORLDS, _COLUMNS = 8, 4
_EPISODE, _EPISODES, _EVERY = 36, 4, 3  # control steps per episode, episodes, control steps per picture
_COLOURS = 96
_PARTS = [7, 7, 7, 7, 15, 5, 7]  # sizes of the parts of the policy's observation


class Scripted:
    """Moves the tool over the chosen object by inverse kinematics, with only the policy's observation."""

    def __init__(self, envs: Any) -> None:
        self.arm, self.over = robot_arm(envs.compiled.scene), envs.task.over

    def __call__(self, observation: dict[str, Tensor]) -> Tensor:
        """Return actions of all worlds."""
        qpos, _, lead, tool, to_objects, chosen, _ = torch.split(observation["policy"], _PARTS, dim=1)
        way = (chosen[:, :, None] * (to_objects.reshape(-1, 5, 3) + self.over)).sum(dim=1)
        poses = torch.cat([tool[:, :3] + way, tool[:, 3:]], dim=1).numpy()
        both = zip(poses, qpos.numpy(), strict=True)
        goals = [solve(self.arm, pose[None], starts=start[None])[0][0] for pose, start in both]
        return ((torch.as_tensor(np.array(goals)) - qpos - lead) / JOINT_STEP).clamp(-1.0, 1.0)


def main() -> None:
    """Draw the picture."""
    words: dict[str, Any] = {
        "render_mode": "rgb_array",
        "render_config": {"size": (2 * SIZE[0], 2 * SIZE[1])},
        "device": "cpu",
    }
    envs: Any = gym.make_vec(_ENV, num_envs=_WORLDS, max_episode_steps=_EPISODE, **words).unwrapped
    policy, (observation, _), frames = Scripted(envs), envs.reset(seed=0), []
    for step in range(_EPISODE * _EPISODES):
        if step % _EVERY == 0:
            frames.append(grid(envs.render(), _COLUMNS, 3))
        observation, *_ = envs.step(policy(observation))
    few = [frame.quantize(_COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE) for frame in frames]
    pause = round(1000.0 * _EVERY * envs.state.dt)
    few[0].save(PICTURE, save_all=True, append_images=few[1:], duration=pause, loop=0, optimize=True)
    print(f"{PICTURE}: {len(few)} pictures, {PICTURE.stat().st_size // 1024} KiB; {envs.statistics.read()}")


if __name__ == "__main__":
    main()
