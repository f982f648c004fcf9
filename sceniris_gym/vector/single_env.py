"""`SceneEnv`: one world of a task as a Gymnasium environment, for `gymnasium.make`."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from sceniris_gym.device.fixed import Fixed
from sceniris_gym.sim.snapshot import Snapshot
from sceniris_gym.vector.rendering import RENDER_MODES
from sceniris_gym.vector.task import Task
from sceniris_gym.vector.vector_env import SceneVectorEnv


class SceneEnv(Fixed, gymnasium.Env):
    """One world of a task, with numpy observations and no autoreset.

    Args:
        task: A Task, its class, or "module:Class".
        kwargs: Arguments of SceneVectorEnv, except num_envs, output and autoreset_mode.
    """

    _FIXED = ("envs",)
    _ARGUMENTS = ("compiled", *SceneVectorEnv._ARGUMENTS)  # `compiled` is an attribute of `envs`
    metadata: dict[str, Any] = {"render_modes": RENDER_MODES}  # noqa: RUF012, Gymnasium reads it from the class

    def __init__(self, task: Task | type[Task] | str, **kwargs: Any) -> None:
        self.envs = SceneVectorEnv(task, 1, output="numpy", autoreset_mode=AutoresetMode.DISABLED, **kwargs)
        self.render_mode = self.envs.render_mode
        self.metadata = {**self.metadata, "render_fps": self.envs.metadata["render_fps"]}
        self.observation_space = self.envs.single_observation_space
        self.action_space = self.envs.single_action_space
        self._np_random, self._np_random_seed = self.envs.np_random, self.envs.np_random_seed

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Give the world the layout of episode 0 of `seed`. If `seed` is None, the world gets its next episode.

        options={"layouts": id} selects the layout with this id, and {"state": snapshot} restores a snapshot.
        """
        observation, info = self.envs.reset(seed=seed, options=options)
        if seed is not None:
            self._np_random, self._np_random_seed = self.envs.np_random, self.envs.np_random_seed
        return _first(observation), _first(info)

    def set_param(self, name: str, value: Any) -> None:
        """Give a param a new value from the next layout on, as `SceneVectorEnv.set_param` does."""
        self.envs.set_param(name, value)

    def layout_id(self) -> str:
        """Return the id of the present layout, for `reset(options={"layouts": id})`."""
        return self.envs.layout_ids()[0]

    def redraw(self, objects: str | Sequence[str]) -> None:
        """Move objects to new places in the middle of the episode, as `SceneVectorEnv.redraw` does."""
        self.envs.redraw(objects)

    def snapshot(self) -> Snapshot:
        """Copy the state of the world, for `reset(options={"state": snapshot})`."""
        return self.envs.snapshot()

    def set_wrapper_attr(self, name: str, value: Any, *, force: bool = True) -> bool:
        """Set an attribute, or a param if `name` has a dot. Gymnasium's SyncVectorEnv.set_attr calls this method."""
        if "." not in name:
            return super().set_wrapper_attr(name, value, force=force)
        self.set_param(name, value)
        return True

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take one control step with an action in [-1, 1]."""
        observation, reward, terminated, truncated, info = self.envs.step(np.asarray(action)[None])
        return _first(observation), float(reward[0]), bool(terminated[0]), bool(truncated[0]), _first(info)

    def render(self) -> np.ndarray | None:
        """Return a picture, (height, width, 3) uint8, or None unless the render mode is "rgb_array"."""
        frames = self.envs.render()
        return None if frames is None else frames[0]

    def close(self) -> None:
        """Close the environment. A second call has no effect."""
        self.envs.close()


def _first(value: Any) -> Any:
    return {key: _first(item) for key, item in value.items()} if isinstance(value, dict) else value[0]
