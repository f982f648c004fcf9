"""What a task is: a scene, what is observed of it, what is rewarded, and when it is done."""

from __future__ import annotations

import torch
from torch import Tensor

from sceniris_gym.vector.state import State

Observation = dict[str, dict[str, Tensor]]
"""Group (`policy`, `critic`) to name to tensor of shape (num_envs, ...)."""


class Task:
    """Base class of tasks. All methods work on all worlds at once, in torch operations without host synchronisation.

    A task reads the worlds through a State, in which poses are in the robot's base frame. It may keep tensors of its
    own: make them in `bind`, write to them in place, and start those of masked worlds afresh in `on_reset`.

    Attributes:
        scene: the name of a shipped scene, or the path of a scene file
        needs: what else than kinematics must be current when the task reads it, keys of sceniris_gym.sim.batch.NEEDS
        substeps: physics steps in a control step
        action_size: length of an action; None is the number of controls of the scene
    """

    scene: str = ""
    needs: tuple[str, ...] = ()
    substeps: int = 4
    action_size: int | None = None

    def bind(self, s: State) -> None:
        """Prepare for the worlds of `s`; called once, before anything else."""

    def observe(self, s: State) -> Observation:
        """Return what is observed: {group: {name: tensor of shape (num_envs, ...)}}.

        The group `policy` is what an actor may see, `critic` what a critic may see in training.
        """
        raise NotImplementedError

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the terms of the reward of the step just taken, each of shape (num_envs,); their sum counts.

        Names are free, but for those of statistics: episodes, length, return and success.
        """
        raise NotImplementedError

    def success(self, s: State) -> Tensor:
        """Return in which worlds the goal is reached, shape (num_envs,), bool."""
        raise NotImplementedError

    def terminated(self, s: State) -> Tensor:
        """Return in which worlds the episode ends here, shape (num_envs,), bool; by default nowhere."""
        return torch.zeros(s.num_envs, dtype=torch.bool, device=s.device)

    def apply(self, s: State, action: Tensor) -> None:
        """Write controls for an action in [-1, 1], shape (num_envs, action_size); by default over their ranges."""
        lower, upper = s.control_range.unbind(dim=1)
        s.ctrl.copy_(lower + (action + 1.0) * 0.5 * (upper - lower))

    def on_reset(self, s: State, mask: Tensor) -> None:
        """React to the reset of the masked worlds; `mask` has shape (num_envs,), bool. Other worlds must not change."""
