"""Physics steps and resets of three objects with eight variants each, beside those of scenes of three fixed things.

    python -m benchmarks.variants --num-envs 4096 --device cuda:0

There is a scene of fixed things for each variant, which has it and the next two, so that all of them together have
every thing as often as the worlds with variants do. The scenes take turns; the first round is not counted. A line of
JSON for each scene has physics steps/s of all worlds, what a reset of 2% of them in a control step of four physics
steps adds to it (layouts made ahead), the number of geoms and of their pairs, and the room for contacts and rows. The
last line compares: `steps` of the scene with variants over those of the mean of the others, and the microseconds that
its resets add beyond theirs, each as median, least and greatest of the rounds.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import tyro
import warp as wp

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
        fixed: number of scenes of fixed things
        rounds: turns that are counted
        steps: control steps of a turn, a multiple of 50
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
    """

    num_envs: int = 4096
    things: tuple[str, ...] = THINGS
    fixed: int = len(THINGS)
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
        self.about = {"things": things, "geoms": m.ngeom, "pairs": len(m.nxn_geom_pair_filtered)}
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


def main(options: Options) -> None:
    """Let all scenes take turns, and print a line for each, and one that compares."""
    wp.config.quiet = True
    things = options.things
    mixed: list[list[Any]] = [[things[(k + i) % len(things)] for i in range(3)] for k in range(options.fixed)]
    ours = Worlds([list(things)] * 3, options)
    worlds = [ours, *(Worlds(chosen, options) for chosen in mixed)]
    found = np.array([[one.turn(options.steps) for one in worlds] for _ in range(options.rounds + 1)])[1:]
    for i, one in enumerate(worlds):
        told = {"steps_per_s": spread(found[:, i, 0], 0), "reset_adds_us": spread(found[:, i, 1], 1)}
        print(json.dumps(one.about | told), flush=True)
    steps = found[:, 0, 0] * (1.0 / found[:, 1:, 0]).mean(axis=1)
    resets = found[:, 0, 1] - found[:, 1:, 1].mean(axis=1)
    about = {"num_envs": options.num_envs, "device": str(ours.batch.device), "rounds": options.rounds}
    print(json.dumps({"steps": spread(steps), "reset_adds_us": spread(resets, 1), **about}), flush=True)


if __name__ == "__main__":
    main(tyro.cli(Options))
