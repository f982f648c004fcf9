"""A task in which an arm is driven from outside."""

from __future__ import annotations

from typing import Any

import torch

from sceniris_gym.vector import arm_controller
from tests.vector.conftest import Reach


class Drive(Reach):
    """Nothing but an arm, driven from outside."""

    substeps = 4
    move: Any

    def bind(self, s: Any) -> None:
        """Find the arm."""
        self.arm = arm_controller.ArmController(s)

    def apply(self, s: Any, action: torch.Tensor) -> None:
        """Do what was set as `move`."""
        self.move(s, action)

    def observe(self, s: Any) -> dict:
        """Show the joints."""
        return {"policy": {"arm": self.arm.qpos(s)}}

    def reward(self, s: Any, action: torch.Tensor) -> dict:
        """Reward nothing."""
        return {"nothing": torch.zeros(s.num_envs)}

    def success(self, s: Any) -> torch.Tensor:
        """Achieve nothing."""
        return torch.zeros(s.num_envs, dtype=torch.bool)

    def terminated(self, s: Any) -> torch.Tensor:
        """End never."""
        return torch.zeros(s.num_envs, dtype=torch.bool)

    def on_reset(self, s: Any, mask: torch.Tensor) -> None:
        """Let the tool's target be where the tool is."""
        self.arm.start(s, mask)
