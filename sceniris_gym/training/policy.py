"""`load_policy` loads the policy of a training run. Use it to act, to evaluate or to export the policy."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from sceniris_gym.adapters.rsl_rl import RslRlVecEnvWrapper, TensorDict, as_tensordict
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.training.records import MODEL, read_config
from sceniris_gym.training.runner import load_checkpoint, runner_of
from sceniris_gym.training.settings import Settings
from sceniris_gym.training.task_scenes import make_env, scene_of


class Policy:
    """A trained policy. Call it with observations to get actions.

    Args:
        run: The folder of a run.
        task: The task of `env`.
        settings: The settings of the run.
        env: Worlds of the task. The shapes of their observations determine the sizes of the networks.
        trust: As in `load_policy`.

    Attributes:
        task: Id of the training task.
        device: Device of the networks. Observations should be on the same device.
    """

    def __init__(self, run: Path, task: str, settings: Settings, env: RslRlVecEnvWrapper, *, trust: bool) -> None:
        self.task, self.device = task, env.unwrapped.device
        self._runner = runner_of(env, settings, 0)
        load_checkpoint(self._runner, run / MODEL, str(self.device), trust=trust)
        self._act = self._runner.get_inference_policy(str(self.device))

    def __call__(self, observation: Mapping[str, Any] | TensorDict | Tensor) -> Tensor:
        """Return actions in [-1, 1], shape (num_envs, size), for observations of SceneVectorEnv on `device`."""
        named = {"policy": observation} if isinstance(observation, Tensor) else observation
        seen = named if isinstance(named, TensorDict) else as_tensordict(named)
        with torch.inference_mode():
            return self._act(seen).clamp(-1.0, 1.0)

    def export(self, path: str | Path) -> None:
        """Write the deterministic policy as TorchScript, including its normalisation of observations.

        `torch.jit.load(path)` returns a module that takes the flat observation group `policy`, shape (n, size), and
        returns actions before they are clipped to [-1, 1].
        """
        path = Path(path)
        self._runner.export_policy_to_jit(str(path.parent), path.name)


def load_policy(run: str | Path, device: str | None = None, *, trust: bool = False) -> Policy:
    """Return the deterministic policy of a run.

    Args:
        run: The folder that `sceniris-gym train --out` made.
        device: "cpu" or "cuda:0". None takes cuda:0 if there is a GPU, and cpu otherwise.
        trust: Also read a checkpoint that holds pickled objects, although these can run any code.

    Raises:
        ArgumentError: The folder has no run, or its checkpoint cannot be read.
        MissingExtraError: rsl-rl is not installed.
    """
    folder = Path(run)
    task, settings = read_config(folder)
    envs = make_env(task, 1, compile_scene(scene_of(task, reachable=True), device), split="eval")
    return Policy(folder, task, settings, RslRlVecEnvWrapper(envs), trust=trust)
