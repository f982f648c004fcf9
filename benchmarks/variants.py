"""Physics steps and resets of three objects with eight variants each, beside those of scenes of three fixed things.

    python -m benchmarks.variants --num-envs 4096 --device cuda:0

There is a scene of fixed things for each variant, which has it and the next two, so that all of them together have
every thing as often as the worlds with variants do. Each of them is measured in a process of its own, in turns with the
scene with variants; the first round is not counted. Its line of JSON has for both scenes physics steps/s of all worlds,
the microseconds that a reset of 2% of them adds to a control step of four physics steps (layouts made ahead), the
number of geoms and of their pairs, and the room for contacts and rows. `ratio` is that of steps with variants over
steps without, and `reset_adds_us` by how much more their reset adds, each as median, least and greatest of the rounds.
The last line has median, least and greatest of the pairs' medians.
"""

from __future__ import annotations

import json
import time
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
        steps: control steps of a turn, a multiple of 50
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
        fields = self.batch.fields
        self.randomizer = ResetRandomizer(compiled, self.batch.model, self.batch.data, fields=fields, prefetch=True)
        numbers, device = np.arange(options.num_envs) % _EVERY, self.batch.device
        self._masks = [wp.array(numbers == turn, dtype=wp.bool, device=device) for turn in range(_EVERY)]
        self._nobody = wp.zeros(options.num_envs, dtype=wp.bool, device=device)
        m, d = self.batch.model, self.batch.data
        self.about = {"geoms": m.ngeom, "pairs": len(m.nxn_geom_pair_filtered)}
        self.about |= {"nconmax": d.naconmax // d.nworld, "njmax": d.njmax}
        self.randomizer.reset()
        for _ in range(20):
            self.batch.step()
        self.batch.check_budget()

    def turn(self, steps: int) -> tuple[float, float]:
        """Return physics steps/s of all worlds, and the microseconds that a reset of 2% of them adds to a step."""
        alone = self._time(steps, None)
        with_nobody, with_some = (self._time(steps, masks) for masks in ([self._nobody], self._masks))
        return self.batch.nworld * _SUBSTEPS / alone, 1e6 * (with_some - with_nobody)

    def _time(self, steps: int, masks: list[wp.array] | None) -> float:
        """Return the mean time of a control step [s], with a reset of the masked worlds after it if there are masks."""
        wp.synchronize_device(self.batch.device)
        start = time.perf_counter()
        for step in range(steps):
            self.batch.step()
            if masks is not None:
                self.randomizer.reset(masks[step % len(masks)])
        wp.synchronize_device(self.batch.device)
        return (time.perf_counter() - start) / steps


def measure(options: Options, pair: int) -> dict[str, Any]:
    """Let the scene with variants and one of fixed things take turns."""
    wp.config.quiet = True
    things = options.things
    mixed = [things[(pair + i) % len(things)] for i in range(3)]
    worlds = {"variants": Worlds([list(things)] * 3, options), "fixed": Worlds(list(mixed), options)}
    turns = [[one.turn(options.steps) for one in worlds.values()] for _ in range(options.rounds + 1)]
    steps, resets = np.moveaxis(np.array(turns[1:]), 2, 0)
    line: dict[str, Any] = {"pair": pair, "things": mixed, "ratio": spread(steps[:, 0] / steps[:, 1])}
    line["reset_adds_us"] = spread(resets[:, 0] - resets[:, 1], 1)
    for i, (name, one) in enumerate(worlds.items()):
        told = {"steps_per_s": spread(steps[:, i], 0), "reset_adds_us": spread(resets[:, i], 1)}
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
