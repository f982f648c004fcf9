"""`Task`: a scene with observations, rewards and ends of episodes."""

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
    """Return the critic's tensors named in `policy` as the group `policy`, and these and `more` as `critic`."""
    seen = observation["critic"]
    shown = {name: seen[name] for name in policy}
    return {"policy": shown, "critic": shown | {name: seen[name] for name in more}}


FRICTION_PYRAMIDS: dict[str, Any] = {"cone": mujoco.mjtCone.mjCONE_PYRAMIDAL, "impratio": 1.0}
"""Options for tasks that grip nothing: a step takes half the time, but objects slip slowly in a long grip."""


class Task:
    """Base class of tasks. All methods work on all worlds at once, in torch operations without host synchronisation.

    A task reads the worlds through a State, with poses in the robot's base frame. It may have tensors of its own: make
    them in `bind`, write to them in place, and reset those of masked worlds in `on_reset`.

    Attributes:
        scene: The name of a shipped scene, or the path of a scene file.
        needs: Quantities that the task reads and kinematics does not update, keys of sceniris_gym.sim.batch.NEEDS.
        substeps: Physics steps in a control step.
        action_size: Length of an action; None is the number of controls of the scene.
        model_fields: Fields of the physics model that get a row for each world, to write to in `on_reset`; see
            `State.model_field`.
        options: Fields of MjOption that differ from the scene's in the physics of this task. Layouts do not depend on
            them.
    """

    scene: str = ""
    needs: tuple[str, ...] = ()
    substeps: int = 4
    action_size: int | None = None
    model_fields: tuple[str, ...] = ()
    options: Mapping[str, Any] = {}

    def bind(self, s: State) -> None:
        """Prepare for the worlds of `s`; called once, before anything else."""

    def observe(self, s: State) -> Observation:
        """Return the observations: {group: {name: tensor of shape (num_envs, ...)}}.

        The group `policy` is for the actor, `critic` for the critic in training.
        """
        raise NotImplementedError

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the reward terms of the last step, each of shape (num_envs,); the reward is their sum.

        A term may have any name but those of statistics: episodes, length, return, success and broken.
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
