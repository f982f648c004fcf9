"""A small reaching task over real layouts: an arm, a block and a cabinet that moves about."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.state import State
from sceniris_gym.vector.task import Observation, Task
from sceniris_gym.vector.vector_env import SceneVectorEnv

SCENE = {
    "model": str(Path(__file__).parents[1] / "data" / "small_arm.xml"),
    "floor": {"size": [1.6, 1.6]},
    "objects": {
        "cabinet": {
            "kind": "fixture",
            "on": "floor",
            "region": {"box": [[0.2, -0.1], [0.45, 0.3]]},
            "joints": {"*": {"fraction": [0.2, 0.8]}},
        },
        "block": {"on": "floor", "region": {"box": [[-0.3, -0.6], [0.3, 0.6]]}},
    },
}


class Reach(Task):
    """Bring the tool to the block; the episode ends early in the worlds whose first action is above 0.9."""

    substeps = 2

    def bind(self, s: State) -> None:
        """Remember an action and a draw of each reset."""
        self.last = torch.zeros(s.num_envs, 5, device=s.device)
        self.drawn = torch.zeros(s.num_envs, 2, device=s.device)

    def apply(self, s: State, action: Tensor) -> None:
        """Turn the arm by small changes of its targets."""
        self.last.copy_(action)
        s.ctrl[:, :2] += 0.1 * action[:, :2]

    def observe(self, s: State) -> Observation:
        """Show joints and tool to the policy, all to the critic."""
        policy = {"arm": s.qpos("arm"), "tcp": s.site("arm/tcp"), "last": self.last, "noise": s.uniform(3, stream=1)}
        return {"policy": policy, "critic": policy | {"block": s.pose("block"), "drawn": self.drawn}}

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Reward a short distance and little effort."""
        distance = (s.site("arm/tcp")[:, :3] - s.pose("block")[:, :3]).norm(dim=1)
        return {"near": -distance, "effort": -0.01 * action.square().sum(dim=1)}

    def success(self, s: State) -> Tensor:
        """Say where the tool is at the block."""
        return (s.site("arm/tcp")[:, :3] - s.pose("block")[:, :3]).norm(dim=1) < 0.05

    def terminated(self, s: State) -> Tensor:
        """End where the first action says so."""
        return self.last[:, 0] > 0.9

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Forget the action and draw anew."""
        self.last.masked_fill_(mask[:, None], 0.0)
        self.drawn.copy_(torch.where(mask[:, None], s.uniform(2, -1.0, 1.0), self.drawn))


@pytest.fixture(scope="session")
def reach_scene() -> CompiledScene:
    """Return the CompiledScene of the reaching task, built once."""
    return compile_scene(SceneConfig.load(SCENE, {"bank": 8}), "cpu")


@pytest.fixture(scope="session")
def make_env(reach_scene: CompiledScene) -> Callable[..., SceneVectorEnv]:
    """Return a function that makes environments of the reaching task."""

    def make(num_envs: int = 3, **kwargs: Any) -> SceneVectorEnv:
        return SceneVectorEnv(Reach, num_envs, scene=reach_scene, **kwargs)

    return make


@pytest.fixture(scope="module")
def cuda_scene() -> CompiledScene:
    """Return the CompiledScene of the reaching task on the GPU."""
    return compile_scene(SceneConfig.load(SCENE, {"bank": 8}), "cuda:0")
