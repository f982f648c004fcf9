"""Cost of randomised model fields: resets of 2% of the worlds with and without them, physics, and memory.

    python -m benchmarks.fields --num-envs 4096 --device cuda:0

The scene is `tabletop_lift` with draws of twenty fields: of its things, arm, gravity, light, camera and material.
Prints lines of JSON for the scene without draws, with a row of the same fields for each world, and with draws. These
have microseconds of a step of four substeps, of the same step with an empty reset and with one of 2% of the worlds, and
what that adds to an empty one, each as median, least and greatest of alternating rounds, and then what of it is more
than in the first way, and ratios of rates to its rates.
Steps begin in the same state every time; the first round is not counted. A batch iterates its solver as long as any
world needs it: `iterations` are mean and greatest of the last step. Then bytes of a world by field.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from typing import Any

import numpy as np
import warp as wp

from benchmarks.timing import spread
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.draws import drawn_fields
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer

_THING = {
    "mass": {"scale": [0.5, 2.0], "distribution": "log_uniform"},
    "friction": {"scale": [0.7, 1.3]},
    "rgba": {"abs": [[0.1] * 3, [0.9] * 3]},
    "solref": {"scale": [[0.9, 1.0], [1.1, 1.0]]},
}
_ARM = {
    "damping": {"scale": [0.5, 2.0], "each": True},
    "armature": {"scale": [0.8, 1.2]},
    "gains": {"scale": [0.8, 1.2]},
    "forcerange": {"scale": [0.9, 1.1]},
}
_SCENE = {
    "gravity": {"add": [[-0.05, -0.05, -0.1], [0.05, 0.05, 0.1]]},
    "lights": {
        "lamp": {
            "dir": {"add": [-0.3, 0.3]},
            "diffuse": {"scale": [0.3, 1.3]},
            "specular": {"scale": [0.3, 1.3]},
            "pos": {"add": [-0.2, 0.2]},
        }
    },
    "cameras": {
        "overview": {
            "pos": {"add": [-0.05, 0.05]},
            "quat": {"add": [[-4.0] * 3, [4.0] * 3]},
            "fovy": {"scale": [0.9, 1.1]},
        }
    },
    "materials": {
        "table/wood": {"rgba": {"scale": [[0.4] * 3, [1.1] * 3]}, "shininess": {"abs": [0.0, 1.0]}},
    },
}
DRAWS = {
    "objects": {name: {"randomize": _THING} for name in ("can", "lemon", "block")},
    "robot": {"randomize": _ARM},
    "randomize": _SCENE,
}
_WAYS = ("without", "rows", "drawn")
_STEPS = 100
_EVERY = 50
"""One world in so many is reset in a step, each of them in turn."""


def main() -> None:
    """Measure all in turns."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num-envs", type=int, default=4096)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=_STEPS)
    parser.add_argument("--device", default=None)
    parser.add_argument("--settle", type=int, default=20, help="steps before the state that all begin in")
    parser.add_argument("--ways", nargs="+", default=_WAYS, choices=_WAYS)
    words = parser.parse_args()
    wp.config.quiet = True
    n, worlds, starts = words.num_envs, {}, {}
    fields = drawn_fields(build_model({"base": "tabletop_lift", **DRAWS}).draws)
    for name in words.ways:
        draws = DRAWS if name == "drawn" else {}
        compiled = compile_scene({"base": "tabletop_lift", **draws}, words.device)
        batch = Batch(compiled.scene, n, compiled.device, substeps=4)
        for field in fields if name == "rows" else ():
            batch.fields.wide(field)
        randomizer = ResetRandomizer.of_batch(batch, compiled, prefetch=True)
        randomizer.reset()
        for _ in range(words.settle):
            batch.step()
        worlds[name] = batch, randomizer
        starts[name] = {field: wp.clone(getattr(batch.data, field)) for field in ResetRandomizer.STATE_FIELDS}
        print(f"{name} is ready", file=sys.stderr, flush=True)
    device = worlds[words.ways[0]][0].device
    turns = [wp.array(np.arange(n) % _EVERY == turn, dtype=wp.bool, device=device) for turn in range(_EVERY)]
    masks = {"step": [], "empty": [wp.zeros(n, dtype=wp.bool, device=device)], "reset": turns}
    times: dict[tuple[str, str], list[float]] = {}
    for _ in range(words.rounds + 1):
        for name, (batch, randomizer) in worlds.items():
            for which, given in masks.items():
                mean = measured(batch, randomizer, given, starts[name], words.steps)
                times.setdefault((name, which), []).append(mean)
    of_plain = {which: float(np.median(times[words.ways[0], which][1:])) for which in masks}
    for name in worlds:
        each = {which: np.array(times[name, which][1:]) for which in masks}
        each["reset_adds"] = each["reset"] - each["empty"]
        line: dict[str, Any] = {"way": name, "num_envs": n, **{which: spread(v, 1) for which, v in each.items()}}
        more = np.median(each["reset_adds"]) - (of_plain["reset"] - of_plain["empty"])
        line |= {"reset_more_us": round(float(more), 1)}
        line |= {f"{which}s_per_s_ratio": round(of_plain[which] / float(np.median(each[which])), 3) for which in masks}
        counts = worlds[name][0].data.solver_niter.numpy()
        print(json.dumps(line | {"iterations": [round(float(counts.mean()), 3), int(counts.max())]}), flush=True)
    sizes = {field: array.strides[0] for field, array in worlds[words.ways[-1]][0].fields.rows.items()}
    print(json.dumps({"fields": fields}))
    print(json.dumps({"bytes_a_world": sizes, "sum": sum(sizes.values())}))


def measured(
    batch: Batch, randomizer: ResetRandomizer, masks: list[wp.array], state: dict[str, wp.array], steps: int
) -> float:
    """Return the mean time [us] of a step from this state, and of a reset if there are masks."""
    wp.synchronize_device(batch.device)
    start = time.perf_counter()
    for step in range(steps):
        for field, values in state.items():
            wp.copy(getattr(batch.data, field), values)
        batch.step()
        if masks:
            randomizer.reset(masks[step % len(masks)])
    wp.synchronize_device(batch.device)
    return 1e6 * (time.perf_counter() - start) / steps


if __name__ == "__main__":
    main()
