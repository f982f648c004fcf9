"""Physics steps and resets of three objects with eight variants each, beside those of scenes of three fixed things.

    python -m benchmarks.variants --num-envs 4096 --device cuda:0

There is a scene of fixed things for each variant, which has it and the next two, so that all of them together have
every thing as often as the worlds with variants do. Each of them is measured in a process of its own, in turns with the
scene with variants; the first round is not counted. Its line of JSON has for both scenes physics steps/s of all worlds,
the microseconds that a reset of 2% of them takes on the device (layouts made ahead), the number of geoms and of their
pairs, and the room for contacts and rows. A round resets every world once, 2% after a step of all, each scene in its
turn, and its figure is the median of these resets. `ratio` is that of steps with variants over steps without, and
`reset_adds_us` by how much longer their reset takes, each as median, least and greatest of the rounds. The last line
has median, least and greatest of the pairs' medians.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import tyro
import warp as wp

from benchmarks.resets_table import HERE, measured
from benchmarks.timing import spread
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer

THINGS = ("apple", "bottle", "bowl", "brick", "can", "cereal_box", "mug", "tin")
_SUBSTEPS = 4
_EVERY = 50
"""One world in so many is reset in a step, each of them in turn."""


@dataclass(frozen=True)
class Options:
    """Options of the measurement.

    Attributes:
        num_envs: number of worlds
        things: assets of the variants
        pair: measure this scene of fixed things alone, beside that with variants; by default all of them
        rounds: turns that are counted
        steps: control steps of a turn
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
    """

    num_envs: int = 4096
    things: tuple[str, ...] = THINGS
    pair: int | None = None
    rounds: int = 5
    steps: int = 100
    device: str | None = None


def scene_of(things: list[Any]) -> dict[str, Any]:
    """Return a scene of things on a table; of a list of assets they are variants."""
    placed = {f"thing_{i}": {"asset": thing, "on": "table"} for i, thing in enumerate(things)}
    return {"bank": 64, "objects": {"table": {"asset": "table", "kind": "static"}, **placed}}


class Worlds:
    """Worlds of one scene that are stepped and reset."""

    def __init__(self, things: list[Any], options: Options) -> None:
        compiled = compile_scene(scene_of(things), options.device)
        self.batch = Batch(compiled.scene, options.num_envs, compiled.device, substeps=_SUBSTEPS)
        self.randomizer = ResetRandomizer.of_batch(self.batch, compiled, prefetch=True)
        numbers, device = np.arange(options.num_envs) % _EVERY, self.batch.device
        self._masks = [wp.array(numbers == turn, dtype=wp.bool, device=device) for turn in range(_EVERY)]
        m, d = self.batch.model, self.batch.data
        self.about = {"geoms": m.ngeom, "pairs": len(m.nxn_geom_pair_filtered)}
        self.about |= {"nconmax": d.naconmax // d.nworld, "njmax": d.njmax}
        self.randomizer.reset()
        for _ in range(20):
            self.batch.step()
        self.randomizer.check_budget()

    def rate(self, steps: int) -> float:
        """Return physics steps/s of all worlds."""
        wp.synchronize_device(self.batch.device)
        start = time.perf_counter()
        for _ in range(steps):
            self.batch.step()
        wp.synchronize_device(self.batch.device)
        return self.batch.nworld * _SUBSTEPS * steps / (time.perf_counter() - start)

    def reset(self, turn: int) -> Callable[[], float]:
        """Step, and reset 2% of the worlds; return a function that waits, and returns how long the reset took [us]."""
        self.batch.step()  # on a GPU the host is far ahead by then, and the reset follows without a gap
        stream = self.batch.device.stream if self.batch.device.is_cuda else None
        began = _mark(stream)
        self.randomizer.launch_reset(self._masks[turn])
        ended = _mark(stream)
        if stream is None:
            return lambda: 1e6 * (ended - began)
        return lambda: 1e3 * wp.get_event_elapsed_time(began, ended)


def _mark(stream: wp.Stream | None) -> Any:
    """Return the time [s], or of a stream an event."""
    return time.perf_counter() if stream is None else stream.record_event(wp.Event(stream.device, enable_timing=True))


def measure(options: Options, pair: int) -> dict[str, Any]:
    """Let the scene with variants and one of fixed things take turns."""
    wp.config.quiet = True
    things = options.things
    mixed = [things[(pair + i) % len(things)] for i in range(3)]
    worlds = {"variants": Worlds([list(things)] * 3, options), "fixed": Worlds(list(mixed), options)}
    both, steps, resets = worlds.values(), [], []
    for _ in range(options.rounds + 1):
        steps.append([one.rate(options.steps) for one in both])
        took = [[one.reset(turn) for one in both] for turn in range(_EVERY)]
        resets.append(np.median([[each() for each in turn] for turn in took], axis=0))
    steps, resets = np.array(steps[1:]), np.array(resets[1:])
    line: dict[str, Any] = {"pair": pair, "things": mixed, "ratio": spread(steps[:, 0] / steps[:, 1])}
    line["reset_adds_us"] = spread(resets[:, 0] - resets[:, 1], 1)
    for i, (name, one) in enumerate(worlds.items()):
        told = {"steps_per_s": spread(steps[:, i], 0), "reset_us": spread(resets[:, i], 1)}
        line[name] = {**one.about, **told}
    return line


def main(options: Options) -> None:
    """Measure one pair or all of them, and print a line for each, and one for all."""
    if options.pair is not None:
        print(json.dumps(measure(options, options.pair)), flush=True)
        return
    words = ["--num-envs", str(options.num_envs), "--rounds", str(options.rounds), "--steps", str(options.steps)]
    words += ["--things", *options.things, *(["--device", options.device] if options.device else [])]
    lines = []
    for pair in range(len(options.things)):
        lines += measured(HERE, "variants", *words, "--pair", str(pair))
        print(json.dumps(lines[-1]), flush=True)
    medians = {name: spread([line[name]["median"] for line in lines]) for name in ("ratio", "reset_adds_us")}
    print(json.dumps({**medians, "num_envs": options.num_envs, "rounds": options.rounds}), flush=True)


if __name__ == "__main__":
    main(tyro.cli(Options))
