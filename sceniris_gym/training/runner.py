"""rsl-rl's PPO for an environment."""

from __future__ import annotations

from contextlib import redirect_stdout
from typing import TYPE_CHECKING, Any

import torch

from sceniris_gym.adapters.rsl_rl import RslRlVecEnv
from sceniris_gym.training.settings import Settings

if TYPE_CHECKING:
    from rsl_rl.runners import OnPolicyRunner


_CONVOLUTIONS = {"output_channels": [32, 64, 64], "kernel_size": [8, 4, 3], "stride": [4, 2, 1]}


def runner_of(env: RslRlVecEnv, settings: Settings, seed: int) -> OnPolicyRunner:
    """Return rsl-rl's runner, with an untrained policy.

    The actor sees the observation group `policy` and the critic the group `critic`; where a task lacks one of them,
    both see the other. The actor also sees all images, by convolutions as in Mnih et al. (2015).
    """
    from rsl_rl.runners import OnPolicyRunner  # below the adapter, which says how to install it

    torch.manual_seed(seed)
    images = env.unwrapped.images
    cameras = [] if images is None else list(images.space)
    config = _config(settings, seed, list(env.unwrapped.observation_names), cameras)
    with redirect_stdout(None):  # it prints the networks
        return OnPolicyRunner(env, config, log_dir=None, device=str(env.device))


def _config(settings: Settings, seed: int, groups: list[str], cameras: list[str]) -> dict[str, Any]:
    """Return rsl-rl's configuration for a task with these observation groups and cameras."""
    actor = "policy" if "policy" in groups else groups[0]
    critic = "critic" if "critic" in groups else actor
    model = {
        "class_name": "MLPModel",
        "hidden_dims": list(settings.hidden),
        "activation": "elu",
        "obs_normalization": True,
    }
    noise = {"class_name": "GaussianDistribution", "init_std": settings.init_std, "std_range": (0.02, 2.0)}
    sight = {"class_name": "CNNModel", "cnn_cfg": _CONVOLUTIONS} if cameras else {}
    return {
        "seed": seed,
        "num_steps_per_env": settings.steps,
        "save_interval": 1_000_000_000,  # we write our own checkpoints
        "check_for_nan": False,  # would wait for the device at every step; non-finite worlds end by themselves
        "obs_groups": {"actor": [actor, *cameras], "critic": [critic]},
        "actor": {**model, **sight, "distribution_cfg": noise},
        "critic": dict(model),
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
            # values of several units would take hundreds of updates in clipped steps of 0.2
            "use_clipped_value_loss": False,
        },
    }
