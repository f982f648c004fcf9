"""Cost of resets: control steps that reset 2% of the worlds, less the same steps with an empty mask.

python -m benchmarks.reset_step mid --arm --num-envs 4096 --device cuda:0

Prints a line of JSON for layouts made ahead, made in place, and replayed from a bank: microseconds a control step of
four substeps with resets and without, and their difference in the same round, each as median, least and greatest of
alternating rounds. The first round is not counted. Every step resets other worlds than the 49 before it, and all steps
begin in the same state, so that physics has the same to do.
With --settle they follow each other, and physics has more to do where worlds start anew.
"""

from __future__ import annotations

import argparse
import json
import time
from typing import Any

import numpy as np
import warp as wp

from benchmarks.replays import episodes, replayed
from benchmarks.timing import spread
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.sim.variants import fields_of_variants

_ARM = {"asset": "panda", "base": [-0.6, 0.0, 0.0]}
_STEPS = 100
_EVERY = 50
"""One world in so many is reset in a step, each of them in turn."""
_BANK = 16
"""Episodes of each world that are replayed."""
_WAYS = ("ahead", "in_place", "replayed")

State = list[tuple[wp.array, wp.array]]
"""Arrays of Data, of the Model where variants differ, and their values at the beginning of a step."""


def main() -> None:
    """Measure the three in turns."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--arm", action="store_true", help="put a Panda beside it")
    parser.add_argument("--num-envs", type=int, default=4096)
    parser.add_argument("--settle", action="store_true", help="let steps follow each other")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--ways", nargs="+", choices=_WAYS, default=_WAYS)
    parser.add_argument("--device", default=None)
    words = parser.parse_args()
    wp.config.quiet = True
    overlay = {"robot": _ARM} if words.arm else {}
    compiled = compile_scene({"base": words.scene, **overlay}, words.device)
    n = words.num_envs
    device = wp.get_device(compiled.device)
    turns = [wp.array(np.arange(n) % _EVERY == turn, dtype=wp.bool, device=device) for turn in range(_EVERY)]
    masks = {"with": turns, "without": [wp.zeros(n, dtype=wp.bool, device=device)]}
    ways: dict[str, dict[str, Any]] = {"ahead": {"prefetch": True}, "in_place": {"prefetch": False}, "replayed": {}}
    ways = {name: ways[name] for name in words.ways}
    if "replayed" in ways:
        table = episodes(compiled, list(range(0, n * _BANK, _BANK)), _BANK)
        ways["replayed"] = {"layout_source": replayed(table)(compiled, n)}
    worlds: dict[str, tuple[Batch, ResetRandomizer]] = {}
    starts: dict[str, State] = {}
    for name, arguments in ways.items():
        batch = Batch(compiled.scene, n, compiled.device, substeps=4)
        worlds[name] = batch, ResetRandomizer(compiled, batch.model, batch.data, **arguments)
        worlds[name][1].reset()
        for _ in range(20):
            batch.step()
        state = [getattr(batch.data, field) for field in ResetRandomizer.STATE_FIELDS]
        state += [getattr(batch.model, field) for field in fields_of_variants(batch.full_scene)]
        starts[name] = [(array, wp.clone(array)) for array in state if array.size]
    times: dict[tuple[str, str], list[float]] = {}
    for _ in range(words.rounds + 1):
        for name, (batch, randomizer) in worlds.items():
            for which, given in masks.items():
                start = [] if words.settle else starts[name]
                times.setdefault((name, which), []).append(_time(batch, randomizer, given, start))
    for name in ways:
        both = {which: np.array(times[name, which][1:]) for which in masks}
        both["adds"] = both["with"] - both["without"]
        print(json.dumps({"way": name, "num_envs": n, **{k: spread(v, 1) for k, v in both.items()}}), flush=True)


def _time(batch: Batch, randomizer: ResetRandomizer, masks: list[wp.array], state: State) -> float:
    """Return the mean time of a step and a reset [us], each from this state if it is not empty."""
    wp.synchronize_device(batch.device)
    start = time.perf_counter()
    for step in range(_STEPS):
        for array, values in state:
            wp.copy(array, values)
        batch.step()
        randomizer.reset(masks[step % len(masks)])
    wp.synchronize_device(batch.device)
    return 1e6 * (time.perf_counter() - start) / _STEPS


if __name__ == "__main__":
    main()
