"""Policies by name: a run of `train` or its checkpoint, TorchScript, ONNX, Stable-Baselines3, or a user's function."""

import pickle
import sys
import zipfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from sceniris_gym.errors import ArgumentError, ScenirisError, import_extra
from sceniris_gym.files import no_file
from sceniris_gym.training.settings import MODEL, PICKLE, of_a_run, read_checkpoint
from sceniris_gym.training.task_scenes import import_here
from sceniris_gym.vector.vector_env import SceneVectorEnv

_BLOCK = 64
"""Networks see a multiple of this number of rows: the rounding of a row then does not depend on the other rows."""
Policy = Callable[[dict[str, Tensor]], Any]
"""Takes the observation groups of all worlds, each (num_envs, size), and returns actions, (num_envs, action size)."""
GROUP = "policy"
"""The observation group that a policy gets."""
FORMS = (
    "the folder of a run, a checkpoint of rsl-rl (.pt), TorchScript (.pt), ONNX (.onnx), a model of "
    "Stable-Baselines3 (.zip), or 'module:function'"
)

_ALGORITHMS = ("PPO", "A2C", "SAC", "TD3", "DDPG")
_NORMALIZATIONS = ("normalize.pkl", "vecnormalize.pkl")
# rsl-rl's EmpiricalNormalization: the prefix of its tensors, and the number that it adds to standard deviations.
_NORMAL, _LEAST_STD = "obs_normalizer.", 0.01


def policy_of(name: str, device: str = "cpu", *, trust: bool = False) -> Policy:
    """Return a policy by its name.

    Args:
        name: The folder of a run, the path of a .pt, .onnx or .zip file, or 'module:function'. A .pt file should be
            TorchScript, or a checkpoint of rsl-rl's MLPModel with its default activation. A .zip file should be a model
            of Stable-Baselines3. If the folder of a .zip file has a normalize.pkl or vecnormalize.pkl, the VecNormalize
            in it normalises the observations.
        device: The device of the observations, as torch names it.
        trust: Whether a .zip file and its VecNormalize may be read, and the task of a run with images be imported. Both
            execute code that these files hold or name.

    Raises:
        ArgumentError: The name has another form, the file cannot be used, or it needs `trust`.
        MissingExtraError: The library of the policy is not installed.
    """
    path = Path(name)
    if path.is_dir():
        path, name = path / MODEL, str(path / MODEL)
    if path.suffix in (".pt", ".zip", ".onnx"):
        if not path.is_file():
            raise ArgumentError(f"policy {name}: {no_file(path)}. Give {FORMS}.")
        if path.suffix == ".zip":
            if not trust:
                raise ArgumentError(f"policy {name}: a model of Stable-Baselines3 {PICKLE}")
            return _of_stable_baselines(path, device)
        if path.suffix == ".onnx":
            return _of_onnx(path)
        return _of_script(path, device) if _is_script(path) else _of_rsl_rl(path, device, trust=trust)
    module, colon, function = name.partition(":")
    if not colon:
        raise ArgumentError(f"policy {name}: should be {FORMS}.")
    try:
        policy = getattr(import_here(module), function)
    except (ImportError, AttributeError, ValueError) as error:
        raise ArgumentError(f"policy {name}: cannot be imported: {error}. Give {FORMS}.") from None
    if not callable(policy):
        raise ArgumentError(f"policy {name}: should be a function that takes observations and returns actions.")
    return policy


def fitted(policy: Policy, name: str, envs: SceneVectorEnv) -> Callable[[Any], Any]:
    """Return a policy as a function of the observations of `envs`. It reports observations that do not fit.

    Raises:
        ArgumentError: The returned function raises it if the policy fails, or returns actions of another shape.
    """
    shape = tuple(envs.action_space.shape or ())

    def act(observation: Any) -> Any:
        groups = envs.groups_of(observation)
        seen = ", ".join(f"{key} {tuple(part.shape)}" for key, part in groups.items() if isinstance(part, Tensor))
        try:
            if (got := tuple(np.shape(actions := policy(groups)))) == shape:
                return actions
        except ScenirisError:
            raise
        except Exception as error:
            raise ArgumentError(f"policy {name}: cannot take the observations {seen}: {error!r:.300}.") from error
        raise ArgumentError(f"policy {name}: should return actions of shape {shape} for {seen}, got {got}.")

    return act


def _of_group(act: Callable[[Tensor], Any]) -> Policy:
    """Return a policy that gives the observation group `policy`, padded to full blocks, to a network."""

    def policy(observation: dict[str, Tensor]) -> Any:
        seen = observation[GROUP]
        return act(torch.cat([seen, seen.new_zeros(-len(seen) % _BLOCK, seen.shape[1])]))[: len(seen)]

    return policy


def _is_script(path: Path) -> bool:
    names = zipfile.ZipFile(path).namelist() if zipfile.is_zipfile(path) else []
    return any(name.endswith("/constants.pkl") for name in names)


def _of_script(path: Path, device: str) -> Policy:
    try:
        module = torch.jit.load(str(path), map_location=device).eval()
    except RuntimeError as error:
        raise ArgumentError(f"policy {path}: should be a file of torch.jit.save: {error!s:.200}") from None
    return _of_group(module)


def _of_onnx(path: Path) -> Policy:
    library = import_extra("onnxruntime", "onnx")
    try:
        session = library.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    except Exception as error:
        raise ArgumentError(f"policy {path}: should be an ONNX model: {error!s:.200}") from None
    name = session.get_inputs()[0].name
    return _of_group(lambda seen: session.run(None, {name: seen.cpu().numpy()})[0])


def _of_rsl_rl(path: Path, device: str, *, trust: bool) -> Policy:
    with of_a_run(path):
        stored = read_checkpoint(path, device)["actor_state_dict"]
        if trust and any(str(key).startswith("cnns.") for key in stored):
            from sceniris_gym.training.runner import load_policy  # late: needs the extra rsl-rl

            return load_policy(path.parent, device)
        weights = [value for key, value in stored.items() if key.startswith("mlp.") and key.endswith(".weight")]
        if not weights:
            raise ArgumentError(f"policy {path}: should hold an MLPModel of rsl-rl, got {', '.join(stored)}.")
        sizes = [weights[0].shape[1], *(w.shape[0] for w in weights)]
        layers = [part for pair in pairwise(sizes) for part in (torch.nn.Linear(*pair), torch.nn.ELU())]
        network = torch.nn.Sequential(*layers[:-1]).to(device)
        network.load_state_dict({k.removeprefix("mlp."): v for k, v in stored.items() if k.startswith("mlp.")})
        mean, scale = 0.0, 1.0
        if _NORMAL + "_mean" in stored:
            mean, scale = stored[_NORMAL + "_mean"], stored[_NORMAL + "_std"] + _LEAST_STD

    @torch.inference_mode()
    def act(seen: Tensor) -> Tensor:
        if seen.shape[1] != sizes[0]:
            raise ArgumentError(f"policy {path}: takes {sizes[0]} observations, but this task has {seen.shape[1]}.")
        return network((seen - mean) / scale)

    return _of_group(act)


def _of_stable_baselines(path: Path, device: str) -> Policy:
    stable_baselines3 = import_extra("stable_baselines3", "sb3")
    if not zipfile.is_zipfile(path):
        raise ArgumentError(f"policy {path}: should be a .zip that Stable-Baselines3 saved.")
    why = ""
    for name in _ALGORITHMS:  # the file does not name its algorithm
        try:
            model = getattr(stable_baselines3, name).load(path, device=device)
            break
        except Exception as error:
            why = str(error).splitlines()[0] if str(error) else type(error).__name__
    else:
        raise ArgumentError(f"policy {path}: should be a model of {', '.join(_ALGORITHMS)}. Loading failed: {why}.")
    normalized = _normalization(path)

    return _of_group(lambda seen: model.predict(normalized(seen.cpu().numpy()), deterministic=True)[0])


def _normalization(path: Path) -> Callable[[np.ndarray], Any]:
    """Return the function that normalises the observations for the model at `path`.

    The function is from the VecNormalize in the model's folder. Without such a file, it returns its argument.
    """
    beside = [path.with_name(name) for name in _NORMALIZATIONS if path.with_name(name).is_file()]
    if not beside:
        return lambda seen: seen
    try:
        with beside[0].open("rb") as file:
            normalize: Callable[[np.ndarray], Any] = pickle.load(file).normalize_obs  # as trusted as the model
    except Exception as error:
        raise ArgumentError(f"policy {path}: {beside[0]}: should be a saved VecNormalize: {error}.") from None
    print(f"sceniris_gym: {beside[0]} normalises the observations of the policy", file=sys.stderr, flush=True)
    return normalize
