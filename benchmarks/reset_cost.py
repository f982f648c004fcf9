"""Measure the cost of fresh layouts: env steps per second, relative to the same layouts from a bank.

    python -m benchmarks.reset_cost --task TabletopReach-v0 --out results/reset_cost.json

Two environments with the same source can differ in speed by 3% in every turn, so one of each cannot show a cost of 1%.
Therefore each round makes a new environment, an instance, of every source, lets the instances take turns, and deletes
them. Every second round makes its instances in reversed order, and so does every second turn step them. All instances
take the same actions with the same staggered resets, and the first episode does not count. The first of the sources is
compared with the others:

- `fresh` makes its layouts ahead, and `in_place` when a reset needs them.
- `replayed` gets the same layouts from a bank, and `fixed` gets one layout again and again.

The result has the mean rate of the instances of each source, and their standard deviation relative to it (`spread`).
For each comparison, it has the ratio of the mean rates, and its standard error over the rounds. If the output file
exists, its result is printed and nothing is measured. A run that was stopped has no file and starts over.
"""

from __future__ import annotations

import gc
import json
import time
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
import tyro

from benchmarks.replays import episodes, replayed
from benchmarks.timing import wait
from sceniris_gym.files import replacing
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.training.layout_sources import valid_rows
from sceniris_gym.training.task_scenes import SEED_SPACING, make_env, scene_of
from sceniris_gym.vector.vector_env import SceneVectorEnv

Source = Literal["fresh", "in_place", "replayed", "fixed"]


@dataclass(frozen=True)
class Options:
    """Options of a measurement.

    Attributes:
        task: id of a task, as `sceniris-gym train` takes it
        num_envs: worlds
        sources: the source to compare, and those that it is compared with
        instances: environments of each source; an even number balances the order in which they are made
        turns: turns of each instance that are counted; an even number balances their order
        steps: control steps of a turn
        episode: control steps of an episode
        out: file for the result
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
    """

    task: str = "TabletopReach-v0"
    num_envs: int = 4096
    sources: tuple[Source, ...] = ("fresh", "replayed")
    instances: int = 8
    turns: int = 4
    steps: int = 50
    episode: int = 200
    out: Path = Path("results/reset_cost.json")
    device: str | None = None


def turn(envs: SceneVectorEnv, actions: torch.Tensor) -> float:
    """Return the time that the steps of an environment take, one for each row of the actions [s]."""
    wait(envs)
    start = time.perf_counter()
    for action in actions:
        envs.step(action)
    wait(envs)
    return time.perf_counter() - start


def spread(rates: np.ndarray) -> float:
    """Return the standard deviation of instances of one source, relative to their mean."""
    return float(rates.std(ddof=1) / rates.mean())


def ratio(rates: np.ndarray, others: np.ndarray) -> tuple[float, float]:
    """Return the ratio of two mean rates, and its standard error.

    The standard error is that of a ratio estimator: the instances of a round are a pair, because they take turns.

    Args:
        rates: rate of the instance of each round
        others: the same of the other source
    """
    of_means = rates.mean() / others.mean()
    rest = rates - of_means * others
    return float(of_means), float(rest.std(ddof=1) / np.sqrt(len(rest)) / others.mean())


def makers(options: Options, compiled: CompiledScene) -> dict[str, Callable[[], SceneVectorEnv]]:
    """Return the function that makes an instance of each source, with episodes that begin at random points."""
    # episodes of a world: the first, and those that resets begin
    per_world = 1 - (options.episode + options.turns * options.steps) // -options.episode
    seeds = [11 * 16 * SEED_SPACING + i * per_world for i in range(options.num_envs)]
    begun = torch.randint(options.episode, (options.num_envs,), generator=torch.Generator().manual_seed(0))
    banks: dict[str, Any] = {}
    if "replayed" in options.sources:
        banks["replayed"] = replayed(episodes(compiled, seeds, per_world))
    if "fixed" in options.sources:
        banks["fixed"] = replayed(valid_rows(compiled, 1, seeds[0]))

    def make(source: str) -> SceneVectorEnv:
        envs = make_env(
            options.task,
            options.num_envs,
            compiled,
            layout_source=banks.get(source),
            sim_config={"prefetch": False if source == "in_place" else None},
            max_episode_steps=options.episode,
        )
        # rows of the bank are found by seed + episode
        envs.reset(seed=[seed - seeds[0] for seed in seeds] if source == "replayed" else seeds)
        envs.state.elapsed.copy_(begun)
        return envs

    return {source: lambda source=source: make(source) for source in options.sources}


def play(options: Options, instances: Mapping[str, SceneVectorEnv]) -> dict[str, float]:
    """Let the instances of a round take turns, and return the steps per second of each."""
    names, one = list(instances), next(iter(instances.values()))
    counted = options.turns * options.steps
    shape = (options.episode + counted, *one.action_space.shape)  # pyrefly: ignore[not-iterable]
    random = torch.rand(shape, generator=torch.Generator().manual_seed(1))
    actions = (2.0 * random - 1.0).to(one.device)
    for envs in instances.values():
        turn(envs, actions[: options.episode])
    seconds = dict.fromkeys(names, 0.0)
    for number, part in enumerate(actions[options.episode :].split(options.steps)):
        for name in names if number % 2 == 0 else reversed(names):
            seconds[name] += turn(instances[name], part)
    return {name: options.num_envs * counted / taken for name, taken in seconds.items()}


def delete(instances: dict[str, SceneVectorEnv]) -> None:
    """Free the instances of a round, so that later rounds need no more memory.

    Raises:
        RuntimeError: something still refers to an instance
    """
    left = {name: weakref.ref(envs) for name, envs in instances.items()}
    instances.clear()
    gc.collect()
    if kept := [name for name, envs in left.items() if envs() is not None]:
        raise RuntimeError(f"Instances of {', '.join(kept)} should be free after their round, but are still in use.")


def measure(options: Options) -> dict[str, np.ndarray]:
    """Return the steps per second of all instances by source, shape (instances,)."""
    make = makers(options, compile_scene(scene_of(options.task, reachable=True), options.device))
    rounds = []
    for number in range(options.instances):
        instances = {name: make[name]() for name in (make if number % 2 == 0 else reversed(make))}
        rounds.append(play(options, instances))
        delete(instances)
    return {name: np.array([rates[name] for rates in rounds]) for name in make}


def main(options: Options) -> None:
    """Measure, and write a line of JSON, unless the file exists already.

    Raises:
        SystemExit: fewer than two instances, or the file has a result for other options
    """
    if options.instances < 2:
        raise SystemExit(f"--instances should be at least 2, for a standard error, got {options.instances}.")
    names = ("task", "num_envs", "sources", "instances", "turns", "steps", "episode")
    asked = {**{name: getattr(options, name) for name in names}, "sources": list(options.sources)}
    if options.out.exists():
        answer = json.loads(options.out.read_text())
        if not asked.items() <= answer.items():
            raise SystemExit(f"{options.out} is about other options than {asked}. Remove it, or give another --out.")
        print(json.dumps(answer))
        return
    rates = measure(options)
    first, *others = rates
    ratios = {f"{first} / {other}": ratio(rates[first], rates[other]) for other in others}
    answer = {
        **asked,
        "steps_per_second": {name: round(float(rate.mean())) for name, rate in rates.items()},
        "spread": {name: round(spread(rate), 4) for name, rate in rates.items()},
        "ratio": {name: round(of_means, 4) for name, (of_means, _) in ratios.items()},
        "standard_error": {name: round(error, 4) for name, (_, error) in ratios.items()},
    }
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(options.out) as temporary:
        temporary.write_text(json.dumps(answer) + "\n")
    print(json.dumps(answer))


if __name__ == "__main__":
    main(tyro.cli(Options))
