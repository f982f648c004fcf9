"""rsl-rl's PPO for an environment, imitation of a teacher for a policy that sees images, and trained policies.

`load_policy` loads the policy of a run. Use it to act, to evaluate or to export the policy.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from sceniris_gym.adapters.rsl_rl import RslRlVecEnvWrapper, TensorDict, as_tensordict
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.training.settings import MODEL, Settings, of_a_run, read_checkpoint, read_config
from sceniris_gym.training.task_scenes import make_env, scene_of

if TYPE_CHECKING:
    from rsl_rl.runners import OnPolicyRunner

_NOISE = 0.2
"""Standard deviation of the actions of an imitating policy, so that it also visits states near its trajectories."""
POINTS = 64
"""Number of keypoints per picture."""


class Keypoints(nn.Sequential):
    """Convolutions that end in a spatial softmax (Levine et al. 2016), as an encoder of rsl-rl's CNNModel.

    Args:
        channels: Channels of the pictures of shape (n, channels, height, width), float32.
    """

    output_channels = None  # CNNModel takes None as the mark of a flat output
    output_dim = 2 * POINTS

    def __init__(self, channels: int) -> None:
        super().__init__(
            nn.Conv2d(channels, 32, 5, stride=2, padding=2),
            nn.ELU(),
            nn.Conv2d(32, 64, 3, stride=2, padding=1),
            nn.ELU(),
            nn.Conv2d(64, POINTS, 3, padding=1),
            SpatialSoftmax(),
        )


class SpatialSoftmax(nn.Module):
    """Expected picture position of each channel's activation, shape (n, 2 * channels): all y, then all x.

    The softmax over the pixels of a channel gives each position a probability. The first row and column are at -1, the
    last row and column at 1.
    """

    def forward(self, maps: Tensor) -> Tensor:
        """Return the positions for activations of shape (n, channels, height, width)."""
        shares = maps.flatten(2).softmax(dim=2).view_as(maps)
        return torch.cat([_mean(shares.sum(dim=3)), _mean(shares.sum(dim=2))], dim=1)


def _mean(shares: Tensor) -> Tensor:
    return (shares * torch.linspace(-1.0, 1.0, shares.shape[2], device=shares.device)).sum(dim=2)


def runner_of(env: RslRlVecEnvWrapper, settings: Settings, seed: int) -> OnPolicyRunner:
    """Return rsl-rl's runner, with an untrained policy.

    The actor sees the observation group `policy`, and the critic sees the group `critic`. If a task has only one group,
    both see this group. The actor also sees all images. With `settings.teacher`, the actor imitates a teacher that sees
    the group `critic`. Training takes place in the states that the actor visits (DAgger, Ross et al. 2011). Load the
    teacher before learning.
    """
    from rsl_rl.runners import DistillationRunner, OnPolicyRunner  # late: the adapter reports a missing rsl-rl first

    torch.manual_seed(seed)
    names = list(env.unwrapped.observation_names)
    sight = {name: Keypoints(seen.shape[1]) for name, seen in env.get_observations().items() if name not in names}
    imitates = settings.teacher > 0.0 and bool(sight)
    config = {
        "seed": seed,
        "num_steps_per_env": settings.steps,
        "save_interval": 1_000_000_000,  # `Run` writes the checkpoints
        "check_for_nan": False,  # would wait for the device at every step, and environments end non-finite worlds
        **(_imitation if imitates else _ppo)(settings, names, sight),
    }
    with redirect_stdout(None):  # the runner prints its networks
        return (DistillationRunner if imitates else OnPolicyRunner)(env, config, log_dir=None, device=str(env.device))


def load_checkpoint(runner: OnPolicyRunner, file: Path, device: str, *, trust: bool = False) -> Any:
    """Load the networks of a checkpoint into a runner, as rsl-rl's `load` does, and return the saved `infos`.

    Raises:
        ArgumentError: See `read_checkpoint`, or the checkpoint does not fit the networks.
    """
    stored = read_checkpoint(file, device, trust=trust)
    with of_a_run(file):
        if runner.alg.load(stored, None, True):
            runner.current_learning_iteration = stored["iter"]
        return stored["infos"]


def _ppo(settings: Settings, groups: list[str], sight: dict[str, Keypoints]) -> dict[str, Any]:
    """Return rsl-rl's configuration of PPO for a task with these observation groups and cameras."""
    actor = "policy" if "policy" in groups else groups[0]
    critic = "critic" if "critic" in groups else actor
    return {
        "obs_groups": {"actor": [actor, *sight], "critic": [critic]},
        "actor": _model(settings, sight, settings.init_std),
        "critic": _model(settings, {}),
        "algorithm": {
            "class_name": "PPO",
            "num_learning_epochs": settings.epochs,
            "num_mini_batches": settings.mini_batches,
            "gamma": settings.gamma,
            "lam": 0.95,
            "entropy_coef": settings.entropy,
            "learning_rate": 1e-3,
            "schedule": "adaptive",
            "desired_kl": settings.desired_kl,
            "clip_param": 0.2,
            "value_loss_coef": 1.0,
            # Values of several units would take hundreds of updates in clipped steps of 0.2.
            "use_clipped_value_loss": False,
        },
    }


def _imitation(settings: Settings, groups: list[str], sight: dict[str, Keypoints]) -> dict[str, Any]:
    """Return rsl-rl's configuration of imitation. The optimizer takes a step after each control step of all worlds."""
    return {
        "obs_groups": {"student": ["policy", *sight], "teacher": ["critic"]},
        "student": _model(settings, sight, _NOISE),
        "teacher": _model(settings, {}, settings.init_std),
        "algorithm": {
            "class_name": "Distillation",
            "num_learning_epochs": settings.epochs,
            "gradient_length": 1,
            "learning_rate": 5e-4,
            "loss_type": "huber",  # a teacher's actions before clipping may be far out of bounds
        },
    }


def _model(settings: Settings, sight: dict[str, Keypoints], init_std: float | None = None) -> dict[str, Any]:
    """Return rsl-rl's configuration of a network. If `init_std` is given, the network draws actions with noise."""
    model: dict[str, Any] = {
        "class_name": "CNNModel" if sight else "MLPModel",
        "hidden_dims": list(settings.hidden),
        "activation": "elu",
        "obs_normalization": True,
    }
    if sight:
        model["cnns"] = sight
    if init_std is not None:
        noise = {"class_name": "GaussianDistribution", "init_std": init_std, "std_range": (0.02, 2.0)}
        model["distribution_cfg"] = noise
    return model


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
