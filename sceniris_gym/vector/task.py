"""`Task`: a scene, what is observed of it, what is rewarded, and when an episode ends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import torch
from torch import Tensor

from sceniris_gym.sim.versions import SLEEPING as SLEEPING
from sceniris_gym.vector.state import State

Observation = dict[str, dict[str, Tensor]]
"""{group: {name: tensor of shape (num_envs, ...)}}; groups are `policy` and `critic`."""


def regrouped(observation: Observation, policy: Sequence[str], more: Sequence[str]) -> Observation:
    """Show the policy what it names of what the critic sees, and the critic the same and then `more`."""
    seen = observation["critic"]
    shown = {name: seen[name] for name in policy}
    return {"policy": shown, "critic": shown | {name: seen[name] for name in more}}


FRICTION_PYRAMIDS: dict[str, Any] = {"cone": mujoco.mjtCone.mjCONE_PYRAMIDAL, "impratio": 1.0}
"""Options for tasks that grip nothing: a step takes half the time, but what is gripped for long creeps."""


class Task:
    """Base class of tasks. All methods work on all worlds at once, in torch operations without host synchronisation.

    A task reads the worlds through a State, in which poses are in the robot's base frame. It may keep its own tensors:
    make them in `bind`, write to them in place, and reset those of masked worlds in `on_reset`.

    Attributes:
        scene: The name of a shipped scene, or the path of a scene file.
        needs: What the task reads that kinematics does not bring up to date, keys of sceniris_gym.sim.batch.NEEDS.
        substeps: Physics steps in a control step.
        action_size: Length of an action; None is the number of controls of the scene.
        options: Fields of MjOption that are other than the scene's in this task's physics. Layouts do not depend on
            them.
    """

    scene: str = ""
    needs: tuple[str, ...] = ()
    substeps: int = 4
    action_size: int | None = None
    options: Mapping[str, Any] = {}

    def bind(self, s: State) -> None:
        """Prepare for the worlds of `s`; called once, before anything else."""

    def observe(self, s: State) -> Observation:
        """Return what is observed: {group: {name: tensor of shape (num_envs, ...)}}.

        The group `policy` is for the actor, `critic` for the critic in training.
        """
        raise NotImplementedError

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the reward terms of the step just taken, each of shape (num_envs,); the reward is their sum.

        Any names will do except those of statistics: episodes, length, return and success.
        """
        raise NotImplementedError

    def success(self, s: State) -> Tensor:
        """Return the worlds in which the goal is reached, shape (num_envs,), bool."""
        raise NotImplementedError

    def terminated(self, s: State) -> Tensor:
        """Return the worlds in which the episode terminates, shape (num_envs,), bool; by default none."""
        return torch.zeros(s.num_envs, dtype=torch.bool, device=s.device)

    def apply(self, s: State, action: Tensor) -> None:
        """Write controls for an action in [-1, 1], shape (num_envs, action_size); by default scaled to their ranges."""
        lower, upper = s.control_range.unbind(dim=1)
        s.ctrl.copy_(lower + (action + 1.0) * 0.5 * (upper - lower))

    def on_reset(self, s: State, mask: Tensor) -> None:
        """React to the reset of the worlds in `mask`, shape (num_envs,), bool. Do not change other worlds."""
