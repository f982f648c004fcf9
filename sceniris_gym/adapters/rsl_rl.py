"""`RslRlVecEnvWrapper`: a SceneVectorEnv for `OnPolicyRunner(RslRlVecEnvWrapper(envs), config)` of rsl-rl."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from gymnasium.vector import VectorEnv
from torch import Tensor

from sceniris_gym.errors import ArgumentError, import_extra, refuses_old_imports
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.device import Cause
from sceniris_gym.vector.observer import GROUP, as_channels
from sceniris_gym.vector.vector_env import SceneVectorEnv, as_same_step

import_extra("rsl_rl.env", "rsl-rl", "rsl_rl")
from rsl_rl.env import VecEnv  # noqa: E402
from tensordict import TensorDict  # noqa: E402


def as_tensordict(observation: Mapping[str, Any]) -> TensorDict:
    """Return observations of SceneVectorEnv in rsl-rl's form, with a channels-first group for each camera."""
    images = {camera: as_channels(pictures) for camera, pictures in observation.get(GROUP, {}).items()}
    groups = {name: part for name, part in observation.items() if name != GROUP} | images
    first = next(iter(groups.values()))
    return TensorDict(groups, batch_size=[len(first)], device=first.device)


class RslRlVecEnvWrapper(VecEnv):
    """A SceneVectorEnv as a VecEnv of rsl-rl 5, without copies to the host or waits for the device.

    The observation groups keep their names, so a runner's `obs_groups` is {"actor": ["policy"], "critic": ["critic"]}.
    Each camera is a group with the camera's name, and has its pictures as channels (see `as_channels`) for rsl-rl's
    CNNModel. Returned observations are never written to again, because rsl-rl keeps references to them until after the
    next step.

    The `extras` of a step have `time_outs` (truncated and not terminated), `success` of the step, and `log`, a mapping
    of scalars on the device. `log` is also an attribute of the wrapper. `Episode/<term>` (sum over an episode),
    `Episode/success` (at its last step), `Episode/broken` (its state was not finite) and `Episode/length` (control
    steps) are means over the episodes that finished in the step. Steps without a finished episode keep the previous
    means, which are 0 at first. `Reset/valid_share`, `Reset/fallback_share` and `Reset/attempts` are means over the
    present layouts of the worlds, and `Reset/reject_<cause>` is the fraction of this cause in all candidates rejected
    so far. For stored layouts, attempts and rejections are 0.

    Args:
        env: A SceneVectorEnv with autoreset SAME_STEP, output "torch", copy=True, and max_episode_steps.
        seed: Seed of the first reset. None draws a seed.

    Raises:
        ArgumentTypeError: `env` is not a SceneVectorEnv.
        ArgumentError: `env` has other settings.
    """

    def __init__(self, env: VectorEnv, seed: int | None = None) -> None:
        env = as_same_step(env, "RslRlVecEnvWrapper")
        if env.max_episode_steps is None:
            raise ArgumentError(
                "RslRlVecEnvWrapper: env should have max_episode_steps, because rsl-rl needs a maximum episode length."
            )
        assert env.single_action_space.shape is not None
        self.env, self.device, self.num_envs = env, env.device, env.num_envs
        self.num_actions = env.single_action_space.shape[0]
        self.max_episode_length = env.max_episode_steps
        self.cfg = {"task": type(env.task).__name__, "scene": env.compiled.config.name, "num_envs": env.num_envs}
        self._observation = as_tensordict(env.groups_of(env.reset(seed=seed)[0]))
        self.log: dict[str, Tensor] = {}
        self._means = torch.zeros((), device=env.device)

    @property
    def episode_length_buf(self) -> Tensor:
        """Control steps since the reset of each world, shape (num_envs,). Assignment copies values into this tensor."""
        return self.env.state.elapsed

    @episode_length_buf.setter
    def episode_length_buf(self, steps: Tensor) -> None:
        self.env.state.elapsed.copy_(steps)

    @property
    def unwrapped(self) -> SceneVectorEnv:
        """The wrapped environment."""
        return self.env

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[TensorDict, dict[str, Any]]:
        """Reset worlds as SceneVectorEnv.reset does. The runners of rsl-rl never call this method."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._observation = as_tensordict(self.env.groups_of(observation))
        return self._observation, info

    def get_observations(self) -> TensorDict:
        """Return the observations of the last step or reset."""
        return self._observation

    def step(self, actions: Tensor) -> tuple[TensorDict, Tensor, Tensor, dict[str, Any]]:
        """Take one control step and return observations, rewards, dones (long), each (num_envs, ...), and extras."""
        observation, reward, terminated, truncated, info = self.env.step(actions)
        self._observation = as_tensordict(self.env.groups_of(observation))
        done = terminated | truncated
        self.log = self._finished() | self._resets()
        extras = {"time_outs": truncated & ~terminated, "success": info["success"], "log": self.log}
        return self._observation, reward, done.long(), extras

    def close(self) -> None:
        """Close the wrapped environment."""
        self.env.close()

    def _finished(self) -> dict[str, Tensor]:
        """Return the means over the episodes that finished in the last step."""
        statistics = self.env.statistics
        sums = statistics.latest()
        self._means = torch.where(sums[0] > 0, sums[1:] / sums[0].clamp(min=1.0), self._means)
        return {f"Episode/{name}": mean.float() for name, mean in zip(statistics.names[1:], self._means, strict=True)}

    def _resets(self) -> dict[str, Tensor]:
        """Return statistics of the present layouts, and of all rejections so far."""
        layouts = self.env.randomizer.layouts
        counts = layouts.rejections.sum(dim=0).float()
        shares = counts / counts.sum().clamp(min=1.0)
        return {
            "Reset/valid_share": (layouts.status == LayoutStatus.VALID).float().mean(),
            "Reset/fallback_share": (layouts.status == LayoutStatus.FALLBACK).float().mean(),
            "Reset/attempts": layouts.attempts.float().mean(),
            **{f"Reset/reject_{cause.name.lower()}": shares[cause] for cause in Cause if cause != Cause.NONE},
        }


__getattr__ = refuses_old_imports(__name__)
