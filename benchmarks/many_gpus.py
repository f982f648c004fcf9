"""Training on all GPUs of a host: steps/s, time of updates and of exchanges in them, layouts that processes share.

torchrun --standalone --nproc-per-node 4 -m benchmarks.many_gpus measure --folder FOLDER
python -m benchmarks.many_gpus report --folder FOLDER    # ratios of all numbers of GPUs there, and a plot of them
"""

from __future__ import annotations

import json
import os
import runpy
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import torch
import torch.distributed as dist
import tyro
import warp as wp
from rsl_rl.runners import OnPolicyRunner
from torch import Tensor

from sceniris_gym import LayoutGenerator, compile_scene
from sceniris_gym.adapters.rsl_rl import RslRlVecEnvWrapper
from sceniris_gym.vector.ranks import Rank

_EXAMPLE = Path(__file__).parents[1] / "examples/08_all_gpus.py"
_WARM_UP = 5
_AT_ONCE = 65_536


class _OnProcessors(OnPolicyRunner):
    """A runner whose processes exchange gradients by gloo, as there is no NCCL without GPUs."""

    def _configure_multi_gpu(self) -> None:
        rank = Rank.current()
        self.is_distributed, self.gpu_world_size = rank.size > 1, rank.size
        self.gpu_local_rank, self.gpu_global_rank = rank.local, rank.number
        sizes = {"global_rank": rank.number, "local_rank": rank.local, "world_size": rank.size}
        self.cfg["multi_gpu"] = sizes if rank.size > 1 else None
        if rank.size > 1:
            dist.init_process_group("gloo")


class _Stopwatch:
    """Adds up the time that a function takes on the device [s], without waiting for it in between."""

    def __init__(self, function: Callable[..., Any], device: torch.device) -> None:
        self._function, self._cuda = function, device.type == "cuda"
        self._spans: list[tuple[Any, Any]] = []

    def __call__(self, *args: Any, **words: Any) -> Any:
        start = self._now()
        found = self._function(*args, **words)
        self._spans.append((start, self._now()))
        return found

    def _now(self) -> Any:
        if not self._cuda:
            return time.perf_counter()
        event = torch.cuda.Event(enable_timing=True)
        event.record()
        return event

    def seconds(self) -> float:
        """Return the sum so far, and begin anew. Waits for the device."""
        if self._cuda:
            torch.cuda.synchronize()
        total = sum(a.elapsed_time(b) / 1e3 if self._cuda else b - a for a, b in self._spans)
        self._spans.clear()
        return total


def measure(
    folder: Path,
    num_envs: int = 4096,
    iterations: int = 60,
    layouts: int = 10_000_000,
    device: str | None = None,
) -> None:
    """Train in this process and its sisters, and let the first one write FOLDER/trained_N.json.

    Args:
        folder: folder of the figures.
        num_envs: number of worlds of each process.
        iterations: updates of the policy that are timed; five more come before.
        layouts: number of layouts, of all processes together, that are compared.
        device: "cpu" or "cuda:0"; by default each process takes its own GPU.
    """
    example = runpy.run_path(str(_EXAMPLE))
    config = example["CONFIG"]
    envs = RslRlVecEnvWrapper(gym.make_vec(example["ENV_ID"], num_envs=num_envs, device=device), seed=0)
    rank, place = envs.unwrapped.rank, envs.unwrapped.device
    torch.manual_seed(rank.number)
    kind = _OnProcessors if place.type == "cpu" else OnPolicyRunner
    runner = kind(envs, {**config, "seed": 0}, log_dir=None, device=str(place))
    update = runner.alg.update = _Stopwatch(runner.alg.update, place)
    # of gradients, and of the learning rate that depends on what all of them have seen
    exchanges = dist.all_reduce, dist.broadcast = [_Stopwatch(f, place) for f in (dist.all_reduce, dist.broadcast)]
    runner.learn(_WARM_UP, init_at_random_ep_len=True)
    for watch in (update, *exchanges):
        watch.seconds()  # begins anew
    _wait(rank)
    start = time.perf_counter()
    runner.learn(iterations)
    updated, exchanged = update.seconds(), sum(exchange.seconds() for exchange in exchanges)
    rollout = time.perf_counter() - start - updated
    _wait(rank)
    seconds = time.perf_counter() - start
    steps = rank.size * num_envs * iterations * config["num_steps_per_env"]
    networks = (*runner.alg.actor.parameters(), *runner.alg.critic.parameters())
    weights = _gathered(torch.cat([p.detach().flatten() for p in networks]), rank)
    made, shared = shared_layouts(layouts // rank.size, rank, str(place))
    found = {
        "processes": rank.size,
        "device": torch.cuda.get_device_name() if place.type == "cuda" else "cpu",
        "worlds_each": num_envs,
        "iterations": iterations,
        "steps_per_second": round(steps / seconds),
        "rollout_seconds": [round(float(own), 3) for own in _gathered(torch.tensor(rollout, device=place), rank)],
        "update_share": round(updated / seconds, 4),
        "exchange_share": round(exchanged / seconds, 4),
        "success": round(float(envs.unwrapped.statistics.read()["success"]), 4),
        "weights_differ_by": max(float((other - weights[0]).abs().max()) for other in weights),
        "layouts": made,
        "layouts_shared": shared,
    }
    if rank.number == 0:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"trained_{rank.size}.json").write_text(json.dumps(found, indent=1))
        print(json.dumps(found))
    if rank.size > 1:
        dist.destroy_process_group()


def shared_layouts(count: int, rank: Rank, device: str) -> tuple[int, int]:
    """Make layouts of `mid` in every process by the seeds that it has for itself, and count those made twice.

    A layout is told by 64 bits of its joint positions and mocap poses.

    Returns:
        The number of layouts of all processes together, and that of those which equal an earlier one.
    """
    compiled = compile_scene("mid", device)
    nworld = min(count, _AT_ONCE)
    generator = LayoutGenerator(compiled, nworld, seed=rank.own_seed(0))
    layouts = generator.layouts
    parts = layouts.qpos, layouts.mocap_pos, layouts.mocap_quat
    draws = torch.Generator().manual_seed(0)
    factors = [torch.randint(-(2**62), 2**62, (part[0].numel(),), generator=draws).to(part.device) for part in parts]
    found = []
    for _ in range(-(-count // nworld)):
        generator.generate()
        wp.synchronize_device(compiled.device)
        # odd multiples of the bits of each number, added up modulo 2^64
        bits = (part.flatten(1).contiguous().view(torch.int32).long() for part in parts)
        found.append(sum((b * (2 * f + 1)).sum(dim=1) for b, f in zip(bits, factors, strict=True)))
    own = torch.cat([part for part in found if isinstance(part, Tensor)])
    together = torch.cat(_gathered(own, rank))
    return len(together), len(together) - len(together.unique())


def report(folder: Path) -> None:
    """Write FOLDER/many_gpus.json and a plot of it from all figures in FOLDER."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    rows = [json.loads(path.read_text()) for path in folder.glob("trained_*.json")]
    rows.sort(key=lambda row: row["processes"])
    one = rows[0]["steps_per_second"] / rows[0]["processes"]
    for row in rows:
        row["ratio"] = round(row["steps_per_second"] / one, 3)
    generated = {path.stem: json.loads(path.read_text()) for path in sorted(folder.glob("generated_*.json"))}
    (folder / "many_gpus.json").write_text(json.dumps({"training": rows, "generate": generated}, indent=1))
    numbers = [row["processes"] for row in rows]
    figure, axes = plt.subplots(figsize=(5, 3.5), layout="constrained")
    axes.plot(numbers, numbers, color="0.7", label="as many times the steps as GPUs")
    axes.plot(numbers, [row["ratio"] for row in rows], "o-", label="measured")
    axes.set(xlabel="GPUs", ylabel="steps/s of training over those of one GPU", xticks=numbers)
    axes.legend(frameon=False)
    figure.savefig(folder / "many_gpus.png", dpi=150)
    print(json.dumps(rows))


def _wait(rank: Rank) -> None:
    """Wait for the device, and for the other processes."""
    if torch.cuda.is_available():
        torch.cuda.synchronize()
    if rank.size > 1:
        dist.barrier()


def _gathered(own: Tensor, rank: Rank) -> list[Tensor]:
    """Return the tensors of all processes, which have the shape of this one's."""
    if rank.size == 1:
        return [own]
    every = [torch.empty_like(own) for _ in range(rank.size)]
    dist.all_gather(every, own)
    return every


def same_parts(one: Path, other: Path, count: Annotated[int, tyro.conf.Positional] = 10) -> None:
    """Compare the checksums of random parts of two data sets of the same layouts, made by one and by many processes.

    Raises:
        SystemExit: They differ.
    """
    import numpy as np

    sums = [
        [part["sha256"] for part in json.loads((path / "dataset.json").read_text())["parts"]] for path in (one, other)
    ]
    chosen = np.random.default_rng(0).choice(len(sums[0]), min(count, len(sums[0])), replace=False)
    if len(sums[0]) != len(sums[1]) or any(sums[0][i] != sums[1][i] for i in chosen):
        raise SystemExit(f"{one} and {other}: the rows differ.")
    print(f"{len(chosen)} parts of {len(sums[0])} are the same")


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    tyro.extras.subcommand_cli_from_dict({"measure": measure, "report": report, "same-parts": same_parts})
