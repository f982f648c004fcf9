"""Train with rsl-rl on all GPUs of a host, with separate worlds and layouts on each GPU.

    torchrun --standalone --nproc-per-node gpu examples/08_all_gpus.py

If you start this program with `python`, it trains on one GPU. Needs the extra: pip install 'sceniris-gym[rsl-rl]'.
"""

from pathlib import Path

import gymnasium as gym
import torch
import tyro
from rsl_rl.runners import OnPolicyRunner

from sceniris_gym.adapters.rsl_rl import RslRlVecEnvWrapper

ENV_ID = "sceniris_gym:sceniris_gym/TabletopReach-v0"
MODEL = {"class_name": "MLPModel", "hidden_dims": [256, 128, 64], "activation": "elu", "obs_normalization": True}
CONFIG = {
    "num_steps_per_env": 24,
    "save_interval": 100,
    "obs_groups": {"actor": ["policy"], "critic": ["critic"]},
    "actor": {**MODEL, "distribution_cfg": {"class_name": "GaussianDistribution"}},
    "critic": MODEL,
    "algorithm": {"class_name": "PPO", "gamma": 0.98, "entropy_coef": 0.002, "num_mini_batches": 4},
}


def main(
    num_envs: int = 4096,
    iterations: int = 300,
    seed: int = 0,
    device: str | None = None,
    out: Path = Path("all_gpus"),
) -> None:
    """Train. The first process writes checkpoints, and a log of averages over its worlds.

    Args:
        num_envs: number of worlds of each process.
        iterations: updates of the policy, with gradients averaged over the processes.
        seed: world i of process r gets the seed r * 2^40 + seed + i.
        device: "cpu" or "cuda:0", by default a separate GPU for each process.
        out: folder for checkpoints and the log.
    """
    envs = RslRlVecEnvWrapper(gym.make_vec(ENV_ID, num_envs=num_envs, device=device), seed=seed)
    rank = envs.unwrapped.rank
    torch.manual_seed(seed * rank.size + rank.number)  # for action noise. Initial weights come from the first process
    runner = OnPolicyRunner(envs, {**CONFIG, "seed": seed}, log_dir=str(out), device=str(envs.device))
    runner.learn(iterations, init_at_random_ep_len=True)
    print(f"process {rank.number} of {rank.size}: {envs.unwrapped.statistics.read()['success']:.3f} success")
    if torch.distributed.is_initialized():
        torch.distributed.destroy_process_group()


if __name__ == "__main__":
    tyro.cli(main)
