"""Measure a redraw: one of five objects gets a new place in some of many worlds, in the middle of an episode.

    python -m benchmarks.redraws --num-envs 4096 --share 0.02

The worlds are those of `TabletopLift-v0` after random actions. The time is that of `envs.replace` with a mask on the
device, from an idle device until it is idle again, and beside it that of a reset of the same worlds whose layouts are
made in place.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
import tyro
import warp as wp

from benchmarks.timing import wait
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.vector.vector_env import SceneVectorEnv


@dataclass(frozen=True)
class Options:
    """Options of a measurement.

    Attributes:
        num_envs: worlds
        share: share of the worlds in which the object is redrawn
        objects: the object, or several
        rounds: redraws that are timed
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
    """

    num_envs: int = 4096
    share: float = 0.02
    objects: tuple[str, ...] = ("can",)
    rounds: int = 100
    device: str | None = None


def milliseconds(envs: SceneVectorEnv, call: Callable[[torch.Tensor], None], masks: list[torch.Tensor]) -> list[float]:
    """Return the time that a call takes with each mask [ms]; a step with random actions comes before each."""
    found = []
    for mask in masks:
        envs.step(2.0 * torch.rand(envs.action_space.shape or (), device=envs.device) - 1.0)
        wait(envs)
        start = time.perf_counter()
        call(mask)
        wait(envs)
        found.append(1e3 * (time.perf_counter() - start))
    return found


def main(options: Options) -> None:
    """Measure, and print a line of JSON."""
    torch.manual_seed(0)
    envs = SceneVectorEnv(
        "envs.tabletop_lift:TabletopLift", options.num_envs, device=options.device, sim_config={"prefetch": False}
    )
    envs.reset(seed=0)
    random, count = np.random.default_rng(0), max(round(options.share * options.num_envs), 1)
    masks = []
    for _ in range(options.rounds + 3):
        mask = np.zeros(options.num_envs, bool)
        mask[random.choice(options.num_envs, count, replace=False)] = True
        masks.append(torch.from_numpy(mask).to(envs.device))
    redraws = milliseconds(envs, lambda mask: envs.redraw(options.objects, mask), masks)[3:]
    redrawer = envs.randomizer.redrawer
    kept = int(redrawer.kept[0])
    resets = milliseconds(envs, lambda mask: envs.randomizer.launch_reset(wp.from_torch(mask)), masks)[3:]
    answer = {
        "worlds": options.num_envs,
        "redrawn": count,
        "objects": options.objects,
        "kept": kept / (count * len(masks)),
        "valid": int((envs.randomizer.redraw_status.cpu().numpy() == LayoutStatus.VALID).sum()),
        "redraw_ms": [round(float(np.percentile(redraws, q)), 3) for q in (0, 50, 95)],
        "reset_ms": [round(float(np.percentile(resets, q)), 3) for q in (0, 50, 95)],
    }
    print(json.dumps(answer))


if __name__ == "__main__":
    main(tyro.cli(Options))
