"""The work of two processes of one torchrun for test_ranks.py, with gloo in place of NCCL, which needs GPUs.

torchrun --standalone --nproc-per-node 2 -m tests.vector.two_processes FOLDER
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import torch
import torch.distributed as dist
from rsl_rl.runners import OnPolicyRunner

from benchmarks import many_gpus
from docs.make_examples import example
from sceniris_gym.vector.ranks import Rank
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.conftest import SCENE, Reach


def gathered(found: object) -> list[Any]:
    """Return what both processes have found."""
    both: list[Any] = [None] * dist.get_world_size()
    dist.all_gather_object(both, found)
    return both


def write(path: Path, found: object) -> None:
    """Let the first process write, as both have the same standard output."""
    if dist.get_rank() == 0:
        path.write_text(json.dumps(found))


def share(folder: Path) -> None:
    """Reset twice with seed 0: the seeds of all worlds, and the number of their layouts."""
    envs = SceneVectorEnv(Reach, 8, scene={**SCENE, "bank": 1}, device="cpu")
    rows = []
    for _ in range(2):
        _, info = envs.reset(seed=0)
        rows.append(envs.randomizer.layouts.qpos.numpy().tolist())
        assert envs.np_random_seed == 0
    assert rows[0] == rows[1]
    found = gathered((info["layout"]["seed"].tolist(), rows[0]))
    seeds = [seed for part, _ in found for seed in part]
    write(folder / "shared.json", [seeds, len({tuple(row) for _, part in found for row in part})])


def configure(self: OnPolicyRunner) -> None:
    """Take part, as rsl-rl does with NCCL."""
    rank = Rank.current()
    self.is_distributed, self.gpu_world_size = True, rank.size
    self.gpu_local_rank, self.gpu_global_rank = rank.local, rank.number
    self.cfg["multi_gpu"] = {"global_rank": rank.number, "local_rank": rank.local, "world_size": rank.size}


def train(folder: Path) -> None:
    """Run the example: weights, seeds, and whether a process writes, at the end of its training."""
    learned = OnPolicyRunner.learn

    def learn(self: OnPolicyRunner, num_learning_iterations: int, init_at_random_ep_len: bool = False) -> None:
        learned(self, num_learning_iterations, init_at_random_ep_len)
        weights = torch.cat([p.flatten() for p in self.alg.actor.parameters()]).double().sum().item()
        seeds = self.env.unwrapped.state.seed.tolist()  # pyrefly: ignore[missing-attribute]
        write(folder / "example.json", gathered((weights, seeds, self.logger.writer is not None)))

    OnPolicyRunner.learn = learn
    example("08_all_gpus").main(num_envs=3, iterations=2, device="cpu", out=str(folder / "example"))
    OnPolicyRunner.learn = learned


if __name__ == "__main__":
    OUT = Path(sys.argv[1])
    dist.init_process_group("gloo")
    end = dist.destroy_process_group
    # pyrefly: ignore[bad-assignment]
    dist.init_process_group = dist.destroy_process_group = lambda *_: None  # one group for all three
    share(OUT)
    OnPolicyRunner._configure_multi_gpu = configure
    train(OUT)
    many_gpus.measure(OUT / "measured", num_envs=4, iterations=1, layouts=600, device="cpu")
    end()
