"""Policies by name: a checkpoint of rsl-rl, a model of Stable-Baselines3, or a user's function."""

import importlib
import os
import pickle
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from sceniris_gym.errors import ArgumentError, import_extra
from sceniris_gym.files import no_file
from sceniris_gym.training.records import PICKLE, of_a_run, read_checkpoint

Policy = Callable[[dict[str, Tensor]], Any]
"""Takes the observation groups of all worlds, each (num_envs, size), and returns actions, (num_envs, action size)."""
GROUP = "policy"
"""The observation group that a policy gets."""
FORMS = "a checkpoint of rsl-rl (.pt), a model of Stable-Baselines3 (.zip), or 'module:function'"

_ALGORITHMS = ("PPO", "A2C", "SAC", "TD3", "DDPG")
_NORMALIZATIONS = ("normalize.pkl", "vecnormalize.pkl")


def policy_of(name: str, device: str = "cpu", *, trust: bool = False) -> Policy:
    """Return a policy by its name.

    Args:
        name: The path of a .pt or .zip file, or 'module:function'. A .pt should be a checkpoint of rsl-rl's MLPModel
            with its default activation. If the folder of a .zip has a normalize.pkl or vecnormalize.pkl, this
            VecNormalize normalises the observations.
        device: The device of the observations, as torch names it.
        trust: Allow to read a .zip and its VecNormalize, which executes the code in these files.

    Raises:
        ArgumentError: The name has another form, the file cannot be used, or it is a .zip and `trust` is False.
        MissingExtraError: The library of the policy is not installed.
    """
    path = Path(name)
    if path.suffix in (".pt", ".zip") and not path.is_file():
        raise ArgumentError(f"--policy {name}: {no_file(path)}. Give {FORMS}.")
    if path.suffix == ".pt":
        return _of_rsl_rl(path, device)
    if path.suffix == ".zip":
        if not trust:
            raise ArgumentError(f"--policy {name}: a model of Stable-Baselines3 {PICKLE}")
        return _of_stable_baselines(path, device)
    module, colon, function = name.partition(":")
    if not colon:
        raise ArgumentError(f"--policy {name}: should be {FORMS}.")
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())  # an installed program does not search the working directory
    try:
        policy = getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        raise ArgumentError(f"--policy {name}: cannot be imported: {error}. Give {FORMS}.") from None
    if not callable(policy):
        raise ArgumentError(f"--policy {name}: should be a function that takes observations and returns actions.")
    return policy


def _of_rsl_rl(path: Path, device: str) -> Policy:
    modules = import_extra("rsl_rl.modules", "rsl-rl", "rsl_rl")
    with of_a_run(path):
        stored = read_checkpoint(path, device)["actor_state_dict"]
        weights = [value for key, value in stored.items() if key.startswith("mlp.") and key.endswith(".weight")]
        if not weights:
            raise ArgumentError(f"--policy {path}: should hold an MLPModel of rsl-rl, got {', '.join(stored)}.")
        sizes = [weights[0].shape[1], *(w.shape[0] for w in weights)]
        network = modules.MLP(sizes[0], sizes[-1], sizes[1:-1], "elu").to(device)
        network.load_state_dict({k.removeprefix("mlp."): v for k, v in stored.items() if k.startswith("mlp.")})
        normal = {k.removeprefix("obs_normalizer."): v for k, v in stored.items() if k.startswith("obs_normalizer.")}
        scale = torch.nn.Identity()
        if normal:
            scale = modules.EmpiricalNormalization(sizes[0]).to(device)
            scale.load_state_dict(normal)
    scale.eval()

    @torch.inference_mode()
    def policy(observation: dict[str, Tensor]) -> Tensor:
        seen = observation[GROUP]
        if seen.shape[1] != sizes[0]:
            raise ArgumentError(f"--policy {path}: takes {sizes[0]} observations, but this task has {seen.shape[1]}.")
        return network(scale(seen))

    return policy


def _of_stable_baselines(path: Path, device: str) -> Policy:
    stable_baselines3 = import_extra("stable_baselines3", "sb3")
    if not zipfile.is_zipfile(path):
        raise ArgumentError(f"--policy {path}: should be a .zip that Stable-Baselines3 saved.")
    why = ""
    for name in _ALGORITHMS:  # the file does not name its algorithm
        try:
            model = getattr(stable_baselines3, name).load(path, device=device)
            break
        except Exception as error:
            why = str(error).splitlines()[0] if str(error) else type(error).__name__
    else:
        raise ArgumentError(f"--policy {path}: should be a model of {', '.join(_ALGORITHMS)}. Loading failed: {why}.")
    normalized = _normalization(path)

    def policy(observation: dict[str, Tensor]) -> Any:
        return model.predict(normalized(observation[GROUP].cpu().numpy()), deterministic=True)[0]

    return policy


def _normalization(path: Path) -> Callable[[np.ndarray], Any]:
    """Return the function that normalises a model's observations: the VecNormalize in its folder, or the identity."""
    beside = [path.with_name(name) for name in _NORMALIZATIONS if path.with_name(name).is_file()]
    if not beside:
        return lambda seen: seen
    try:
        with beside[0].open("rb") as file:
            normalize: Callable[[np.ndarray], Any] = pickle.load(file).normalize_obs  # as trusted as the model
    except Exception as error:
        raise ArgumentError(f"--policy {path}: {beside[0]}: should be a saved VecNormalize: {error}.") from None
    print(f"sceniris_gym: {beside[0]} normalises the observations of the policy", file=sys.stderr, flush=True)
    return normalize
