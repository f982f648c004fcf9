"""`Task`: a scene with observations, rewards and ends of episodes. Also checks the first results of its methods."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import torch
from torch import Tensor

from sceniris_gym.errors import TaskError
from sceniris_gym.sim.versions import SLEEPING as SLEEPING
from sceniris_gym.vector.settings import ImageConfig, SimConfig
from sceniris_gym.vector.state import State
from sceniris_gym.vector.statistics import COUNTS

Observation = dict[str, dict[str, Tensor]]
"""{group: {name: tensor of shape (num_envs, ...)}} with the groups `policy` and `critic`."""
TAKEN = (*COUNTS, "return")
"""Names that reward terms cannot have, because statistics and logs use them."""


def regrouped(observation: Observation, policy: Sequence[str], more: Sequence[str]) -> Observation:
    """Return new groups `policy` and `critic`, with tensors from the group `critic` of `observation`.

    The new group `policy` has the tensors that `policy` names. The new `critic` also has the tensors that `more` names.
    """
    seen = observation["critic"]
    shown = {name: seen[name] for name in policy}
    return {"policy": shown, "critic": shown | {name: seen[name] for name in more}}


FRICTION_PYRAMIDS: dict[str, Any] = {"cone": mujoco.mjtCone.mjCONE_PYRAMIDAL, "impratio": 1.0}
"""Options for tasks that do not grip objects: a step takes half the time, but objects slip slowly in a long grip."""


class Task:
    """Base class of tasks. All methods work on all worlds at once, in torch operations without host synchronisation.

    A task reads the worlds through a State, with poses in the robot's base frame. To keep tensors of a task between
    steps, make them in `bind`, write to them in place, and reset the rows of masked worlds in `on_reset`.

    Attributes:
        scene: The name of a shipped scene, or the path of a scene file.
        language: The instruction to the robot. If it is not empty, `info["language"]` has it once for each world.
        needs: Derived quantities that the task reads, in addition to the poses, which are always up to date:
            "velocity", "contacts", "sensors" (values of sensors) or "dynamics" (all results of a forward pass).
        substeps: Physics steps in a control step.
        action_size: Length of an action. None takes the number of controls of the scene.
        model_fields: Fields of the physics model that get a row for each world. `on_reset` writes to these rows through
            `State.model_field`.
        options: Fields of MjOption, by name, with other values than the scene's. They change the physics of this task,
            but not its layouts.
        images: Camera images that environments of this task observe, or None.
        sim_config: SimConfig of environments of this task, with enough room for the contacts and constraint rows of the
            task's scene. An environment with another scene ignores `nconmax`, `njmax` and `nvmax`.
    """

    scene: str = ""
    language: str = ""
    needs: tuple[str, ...] = ()
    substeps: int = 4
    action_size: int | None = None
    model_fields: tuple[str, ...] = ()
    options: Mapping[str, Any] = {}
    images: ImageConfig | None = None
    sim_config: SimConfig = SimConfig()

    def bind(self, s: State) -> None:
        """Prepare for the worlds of `s`. Called once, before the other methods."""

    def observe(self, s: State) -> Observation:
        """Return the observations: {group: {name: tensor of shape (num_envs, ...)}}.

        The actor sees the group `policy`. In training, the critic sees the group `critic`.
        """
        raise NotImplementedError(f"{type(self).__name__} should define the method observe(s).")

    def reward(self, s: State, action: Tensor) -> dict[str, Tensor]:
        """Return the reward terms of the last step, each of shape (num_envs,). The reward is their sum.

        The names of statistics are reserved: episodes, length, return, success and broken.
        """
        raise NotImplementedError(f"{type(self).__name__} should define the method reward(s, action).")

    def success(self, s: State) -> Tensor:
        """Return whether each world has reached the goal, shape (num_envs,), bool."""
        raise NotImplementedError(f"{type(self).__name__} should define the method success(s).")

    def terminated(self, s: State) -> Tensor:
        """Return whether each world's episode terminates, shape (num_envs,), bool. The default is all false."""
        return torch.zeros(s.num_envs, dtype=torch.bool, device=s.device)

    def apply(self, s: State, action: Tensor) -> None:
        """Write the controls for an action in [-1, 1], shape (num_envs, action_size).

        The default scales the action to the control ranges.
        """
        lower, upper = s.control_range.unbind(dim=1)
        s.ctrl.copy_(lower + (action + 1.0) * 0.5 * (upper - lower))

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Prepare the worlds of `mask` after their reset, shape (num_envs,), bool. Do not change other worlds."""


def check_observation(task: Task, observation: Any, num_envs: int) -> None:
    """Check that an observation is {group: {name: tensor of shape (num_envs, ...)}}.

    Raises:
        TaskError: The observation has another form. The message names the task and the returned type.
    """
    form = f"{{group: {{name: tensor of shape ({num_envs}, ...)}}}}, where an actor sees the group 'policy'"
    _check(task, "observe", observation, form, depth=2, fits=lambda t: t.shape[:1] == (num_envs,))


def check_outcome(task: Task, reward: Any, success: Any, terminated: Any, num_envs: int) -> None:
    """Check that a reward is {name: tensor of shape (num_envs,)} and that flags have shape (num_envs,), bool.

    Reward terms must not have names of statistics.

    Raises:
        TaskError: The reward or a flag has another form. The message names the task, the method and the returned type.
    """
    form = f"{{name: tensor of shape ({num_envs},)}}"
    _check(task, "reward", reward, form, depth=1, fits=lambda t: t.shape == (num_envs,))
    for name in TAKEN:
        if name in reward:
            form = f"terms with other names, such as '{name}_reward': {', '.join(TAKEN)} are names of statistics"
            raise TaskError(f"{type(task).__name__}.reward returned a term named '{name}', but should return {form}.")
    for method, flags in (("success", success), ("terminated", terminated)):
        form = f"a bool tensor of shape ({num_envs},)"
        _check(task, method, flags, form, depth=0, fits=lambda t: t.shape == (num_envs,) and t.dtype is torch.bool)


def _check(task: Task, method: str, value: Any, form: str, depth: int, fits: Callable[[Tensor], bool]) -> None:
    wrong = _first_wrong(value, depth, fits)
    if wrong is not None:
        raise TaskError(f"{type(task).__name__}.{method} returned {wrong}, but should return {form}.")


def _first_wrong(value: Any, depth: int, fits: Callable[[Tensor], bool]) -> str | None:
    """Describe the first wrong part of `value`, or return None if there is none.

    A part above `depth` should be a mapping. A part at `depth` should be a tensor for which `fits` is true.
    """
    if depth == 0:
        return None if isinstance(value, Tensor) and fits(value) else _described(value)
    if not isinstance(value, Mapping) or not value:
        return _described(value)
    parts = ((name, _first_wrong(part, depth - 1, fits)) for name, part in value.items())
    return next((f"{{{name!r}: {wrong}}}" for name, wrong in parts if wrong is not None), None)


def _described(value: Any) -> str:
    if isinstance(value, Tensor):
        name = f"{str(value.dtype).removeprefix('torch.')} tensor of shape {tuple(value.shape)}"
    elif isinstance(value, Mapping) and not value:
        name = f"empty {type(value).__name__}"
    else:
        name = type(value).__name__
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"
