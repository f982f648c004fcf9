"""Measure the cost of fresh layouts: env steps per second, beside the same layouts from a bank and one fixed layout.

    python -m benchmarks.reset_cost --task TabletopReach-v0 --out results/reset_cost.json

Four environments take the same actions with the same staggered resets, in episodes of 200 control steps that start at
random points. `fresh` makes its layouts ahead, `in_place` when a reset needs them, `replayed` gets the same ones from a
bank, and `fixed` gets one layout again and again. They take turns as long as an episode, of which the first does not
count. If the output file exists, its result is printed and nothing is measured; a run that was stopped has no file and
starts over.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro

from benchmarks.replays import episodes, replayed
from benchmarks.timing import wait
from sceniris_gym.files import replacing
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.training.layout_sources import valid_rows
from sceniris_gym.training.task_scenes import SEED_SPACING, make_env, scene_of
from sceniris_gym.vector.vector_env import SceneVectorEnv


@dataclass(frozen=True)
class Options:
    """Options of a measurement.

    Attributes:
        task: id of a task, as `sceniris-gym train` takes it
        num_envs: worlds
        rounds: turns of each environment that are counted
        episode: control steps of an episode, and of a turn
        out: file for the result
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
    """

    task: str = "TabletopReach-v0"
    num_envs: int = 4096
    rounds: int = 10
    episode: int = 200
    out: Path = Path("results/reset_cost.json")
    device: str | None = None


def turn(envs: SceneVectorEnv, actions: torch.Tensor, steps: int) -> float:
    """Return the time that steps of an environment take [s]."""
    wait(envs)
    start = time.perf_counter()
    for step in range(steps):
        envs.step(actions[step])
    wait(envs)
    return time.perf_counter() - start


def main(options: Options) -> None:
    """Measure, and write a line of JSON, unless the file exists already.

    Raises:
        SystemExit: the file has a result for other options
    """
    asked = {name: getattr(options, name) for name in ("task", "num_envs", "rounds", "episode")}
    if options.out.exists():
        answer = json.loads(options.out.read_text())
        if not asked.items() <= answer.items():
            raise SystemExit(f"{options.out} is about other options than {asked}. Remove it, or give another --out.")
        print(json.dumps(answer))
        return
    compiled = compile_scene(scene_of(options.task, reachable=True), options.device)
    per_world = options.rounds + 3  # episodes: the first, one for each turn, and the one that the last begins
    seeds = [11 * 16 * SEED_SPACING + i * per_world for i in range(options.num_envs)]
    sources: dict[str, Any] = {
        "fresh": None,
        "in_place": None,
        "replayed": replayed(episodes(compiled, seeds, per_world)),
        "fixed": replayed(valid_rows(compiled, 1, seeds[0])),
    }
    environments = {
        name: make_env(
            options.task,
            options.num_envs,
            compiled,
            layout_source=source,
            sim_config={"prefetch": False if name == "in_place" else None},
            max_episode_steps=options.episode,
        )
        for name, source in sources.items()
    }
    random = torch.Generator().manual_seed(0)
    begun = torch.randint(options.episode, (options.num_envs,), generator=random)
    shape = (options.episode, *environments["fresh"].action_space.shape)  # type: ignore[misc]
    actions = (2.0 * torch.rand(shape, generator=random) - 1.0).to(environments["fresh"].device)
    for envs in environments.values():
        # rows of the bank are found by seed + episode
        envs.reset(seed=[seed - seeds[0] for seed in seeds] if envs is environments["replayed"] else seeds)
        envs.state.elapsed.copy_(begun)
    seconds: dict[str, list[float]] = {name: [] for name in environments}
    for _ in range(options.rounds + 1):
        for name, envs in environments.items():
            seconds[name].append(turn(envs, actions, options.episode))
    total = options.num_envs * options.episode
    rates = {name: total / np.array(times[1:]) for name, times in seconds.items()}
    ratios = {f"fresh / {name}": rates["fresh"] / rates[name] for name in ("in_place", "replayed", "fixed")}
    ranges = {name: [round(float(r), 4) for r in (ratio.min(), ratio.max())] for name, ratio in ratios.items()}
    answer = {
        **asked,
        "steps_per_second": {name: round(float(np.median(rate))) for name, rate in rates.items()},
        "ratio_median": {name: round(float(np.median(ratio)), 4) for name, ratio in ratios.items()},
        "ratio_range": ranges,
    }
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(options.out) as temporary:
        temporary.write_text(json.dumps(answer) + "\n")
    print(json.dumps(answer))


if __name__ == "__main__":
    main(tyro.cli(Options))
