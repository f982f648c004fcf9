"""`Sb3VecEnvWrapper`: a SceneVectorEnv for `PPO("MlpPolicy", Sb3VecEnvWrapper(envs))` of Stable-Baselines3."""

from __future__ import annotations

import inspect
import time
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import VectorEnv
from torch import Tensor

from sceniris_gym.errors import ArgumentError, check_names, import_extra, refuses_old_imports
from sceniris_gym.vector.arguments import RESET_MASK, as_reset_mask
from sceniris_gym.vector.observer import GROUP, picture_names
from sceniris_gym.vector.vector_env import as_same_step

import_extra("stable_baselines3", "sb3", "stable-baselines3")
from stable_baselines3.common.monitor import Monitor  # noqa: E402
from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvObs, VecEnvStepReturn  # noqa: E402


class Sb3VecEnvWrapper(VecEnv):
    """A SceneVectorEnv as a VecEnv of Stable-Baselines3, which returns numpy arrays.

    A step copies observations, rewards and flags of all worlds to the host. A world's info is empty unless its episode
    finished in the step. It then has `terminal_observation`, `TimeLimit.truncated`, `is_success` (of the last step),
    `broken` (the state was not finite), `episode` (`r`, `l` and `t` as in Monitor, from the environment's unscaled
    rewards), and `layout`, the episode's `info["layout"]` (`seed`, `episode`, `fallback` and others). The rows of
    finished worlds are selected on the device, so only these rows are copied. `reset_infos` has the present layout of
    each world.

    All worlds share one environment. `get_attr` reads an attribute of the environment or its task once, and
    `env_method` calls a method once. Both repeat the result for every index. `set_attr` can set params in single
    worlds, but other attributes only in all worlds together. The options of SceneVectorEnv.reset also apply to all
    worlds together. `env_is_wrapped` is true only for Monitor, because the environment provides Monitor's infos.

    Args:
        env: A SceneVectorEnv with autoreset SAME_STEP, output "torch" and copy=True.
        group: The part of the observation for the agent: a group, or a picture such as "wrist/rgb" (for "CnnPolicy").
            A sequence of names selects a dict of parts (for "MultiInputPolicy"). Pictures need an environment with
            `ImageConfig.final`, because agents see the last observation of an episode.

    Raises:
        ArgumentTypeError: `env` is not a SceneVectorEnv.
        ArgumentError: `env` has other settings.
        UnknownNameError: There is no such group or picture.
    """

    def __init__(self, env: VectorEnv, group: str | Sequence[str] = "policy") -> None:
        env = as_same_step(env, "Sb3VecEnvWrapper")
        parts = _parts(env.groups_of(env.single_observation_space))
        names = [group] if isinstance(group, str) else list(group)
        check_names("observation group", names, f"task {type(env.task).__name__}", parts)
        images = env.image_config
        if images is not None and not images.final and any(name not in env.observation_names for name in names):
            raise ArgumentError("Sb3VecEnvWrapper: final_obs lacks images. Make env with ImageConfig(..., final=True).")
        self.env, self.group = env, group
        space = parts[group] if isinstance(group, str) else gymnasium.spaces.Dict({name: parts[name] for name in names})
        super().__init__(env.num_envs, space, env.single_action_space)
        self.metadata["render_fps"] = env.metadata["render_fps"]
        self._actions: Any = None
        self._returns = np.zeros(env.num_envs)
        self._lengths = np.zeros(env.num_envs, dtype=int)
        self._began = time.time()

    def reset(self) -> VecEnvObs:
        """Reset with the seeds and options set since the last reset, and return observations of all worlds."""
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        options = self._options[0]
        observation, info = self.env.reset(seed=seeds, options=options)
        mask = as_reset_mask(options, self.num_envs)
        chosen = slice(None) if mask is None else mask
        self._returns[chosen], self._lengths[chosen] = 0.0, 0
        self.reset_infos = _rows({"layout": info["layout"]}, range(self.num_envs))
        self._reset_seeds()
        self._reset_options()
        return self.seen(observation)

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions for step_wait."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Take the step and return observations, rewards (float32), dones (bool), and infos, which may be empty."""
        observation, reward, terminated, truncated, info = self.env.step(self._actions)
        rewards, flags = to_host(reward), to_host(torch.stack([terminated, truncated]))
        dones = flags[0] | flags[1]
        self._returns += rewards
        self._lengths += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        worlds = np.flatnonzero(dones)
        if len(worlds):
            self._fill(infos, worlds, flags, info)
        return self.seen(observation), rewards, dones, infos

    def seen(self, observation: dict[str, Any], worlds: Tensor | None = None) -> Any:
        """Return the agent's part of an observation of the environment, on the host, as an array or a dict of arrays.

        Args:
            observation: Observation of all worlds, as the environment returns it.
            worlds: Ids of worlds to select. In their values, 0 replaces NaN and infinity, because the last observation
                of a diverged world may have NaNs, and NaN * 0 would spoil a replay buffer's targets. None selects all
                worlds, with unchanged values.
        """
        parts = _parts(self.env.groups_of(observation))

        def part(name: str) -> np.ndarray:
            return to_host(parts[name] if worlds is None else parts[name][worlds].nan_to_num(0.0, 0.0, 0.0))

        return part(self.group) if isinstance(self.group, str) else {name: part(name) for name in self.group}

    def set_options(self, options: list[dict] | dict | None = None) -> None:
        """Store options for the next reset, the same for all worlds.

        Raises:
            ArgumentError: The options are a list with options for single worlds.
        """
        if isinstance(options, list) and any(options):
            raise ArgumentError(
                f"options should be one dict for all worlds together, such as {{'{RESET_MASK}': ...}}, got a list."
            )
        super().set_options(None if isinstance(options, list) else options)

    def close(self) -> None:
        """Close the wrapped environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the environment or its task, repeated for every index.

        Raises:
            AttributeError: The environment and its task lack the attribute.
            IndexError: An index is out of range. Negative indices count from the last world.
        """
        return [getattr(self._owner(attr_name), attr_name)] * len(self._chosen(indices))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set a param (a name with a dot) in some worlds, or an attribute of the environment or its task in all worlds.

        Raises:
            AttributeError: The environment and its task lack the attribute.
            UnknownNameError: The environment's attribute is not in SETTABLE.
            ArgumentError: An attribute is set with indices of some worlds.
            IndexError: An index is out of range.
        """
        if "." in attr_name:
            self.env.set_param(attr_name, value, np.isin(np.arange(self.num_envs), self._chosen(indices)))
            return
        if len(set(self._chosen(indices))) != self.num_envs:
            raise ArgumentError(f"set_attr: '{attr_name}' is one value for all worlds. Leave out the indices.")
        owner = self._owner(attr_name)
        if owner is self.env:
            self.env.set_attr(attr_name, value)
        else:
            setattr(owner, attr_name, value)

    def env_method(self, method_name: str, *method_args, indices: VecEnvIndices = None, **method_kwargs) -> list[Any]:
        """Call a method of the environment or its task once, and return its result for every index."""
        method, chosen = getattr(self._owner(method_name), method_name), self._chosen(indices)
        if len(set(chosen)) != self.num_envs and "worlds" in inspect.signature(method).parameters:
            raise ArgumentError(f"env_method: '{method_name}' has an argument `worlds`. Pass it instead of indices.")
        return [method(*method_args, **method_kwargs)] * len(chosen)

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices: VecEnvIndices = None) -> list[bool]:
        """Return True for Monitor, whose `episode` infos the environment provides, and False for all other wrappers."""
        return [wrapper_class is Monitor] * len(self._chosen(indices))

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Return pictures of the first `RenderConfig.num_envs` worlds, (height, width, 3) uint8."""
        frames = self.env.render()
        if frames is None:
            warnings.warn("env should be made with render_mode='rgb_array' to return pictures.", stacklevel=2)
            return [None] * self.num_envs
        return frames

    def _fill(self, infos: list[dict[str, Any]], worlds: np.ndarray, flags: np.ndarray, info: dict[str, Any]) -> None:
        """Write the infos of the finished worlds, and restart their returns and lengths."""
        rows = torch.as_tensor(worlds, device=self.env.device)
        last, final = self.seen(info["final_obs"], rows), info["final_info"]
        ended = _rows({"is_success": final["success"], "broken": final["broken"], "layout": final["layout"]}, rows)
        begun = _rows({"layout": info["layout"]}, rows)
        seconds = round(time.time() - self._began, 6)
        for k, i in enumerate(worlds):
            infos[i] = {
                "terminal_observation": last[k] if isinstance(last, np.ndarray) else {n: x[k] for n, x in last.items()},
                "TimeLimit.truncated": bool(flags[1, i] and not flags[0, i]),
                "episode": {"r": round(float(self._returns[i]), 6), "l": int(self._lengths[i]), "t": seconds},
                **ended[k],
            }
            self.reset_infos[i] = begun[k]
        self._returns[worlds], self._lengths[worlds] = 0.0, 0

    def _owner(self, name: str) -> Any:
        """Return the environment or its task, whichever has the attribute."""
        for owner in (self.env, self.env.task):
            if hasattr(owner, name):
                return owner
        raise AttributeError(f"{type(self.env).__name__} and {type(self.env.task).__name__} have no attribute '{name}'")

    def _chosen(self, indices: VecEnvIndices) -> list[int]:
        return [range(self.num_envs)[i] for i in self._get_indices(indices)]


def _parts(groups: Mapping[str, Any]) -> dict[str, Any]:
    """Return groups by their names, and pictures by names such as 'wrist/rgb'."""
    rest = {name: group for name, group in groups.items() if name != GROUP}
    return rest | picture_names(groups.get(GROUP, {}))


def to_host(tensor: Tensor) -> np.ndarray:
    """Return a tensor as a numpy array. All copies from the device go through this function."""
    return tensor.cpu().numpy()


def _rows(columns: dict[str, Any], worlds: Sequence[int] | Tensor) -> list[dict[str, Any]]:
    """Split tensors with a row for each world, or nested dicts of them, into a dict of numbers for each of `worlds`."""
    lists = {
        name: _rows(values, worlds) if isinstance(values, dict) else to_host(values[torch.as_tensor(worlds)]).tolist()
        for name, values in columns.items()
    }
    return [{name: values[i] for name, values in lists.items()} for i in range(len(worlds))]


__getattr__ = refuses_old_imports(__name__)
