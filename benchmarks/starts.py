"""Rates of layouts with kinds of starts, and things held in the hand in mujoco_warp.

    python -m benchmarks.starts --num-envs 4096 --device cuda:0

`tabletop_lift` with mixed starts of its block is compared with the scene as it is shipped, whose arm's map decides
reach, with the same and the marker that one of the starts needs, and with one in which all targets are `clear` to
reach; rounds alternate between the scenes. Prints a line of JSON for each figure: valid layouts a second, resets to
stored layouts a second, the share of things that move by less than 2 mm in the hand in half a second, and the
probability that kinds as frequent as their weights differ from these by as much as they do.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from typing import Any

import mujoco_warp as mjw
import numpy as np
import warp as wp
from scipy import stats

from benchmarks.generator_rates import median
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.fit import make_worlds
from sceniris_gym.sim.randomizer import ResetRandomizer

MIXED = [
    {"weight": 5, "robot": "home"},
    {"weight": 3, "robot": "pregrasp", "of": "block"},
    {"weight": 2, "robot": "grasp", "of": "block"},
    {"weight": 2, "robot": "grasp", "of": "block", "lift": [0.02, 0.2]},
    {"weight": 1, "robot": "grasp", "of": "block", "robot_joints": {"joint*": {"fraction": [0.3, 0.7]}}},
    {"weight": 1, "place": {"block": "goal"}},
]
GOAL = {"kind": "marker", "on": "table", "region": {"box": [[-0.24, -0.01], [0.24, 0.24]]}}
SCENES: dict[str, dict[str, Any]] = {
    "shipped": {},
    "marker": {"objects": {"goal": GOAL}},
    "clear": {"objects": {name: {"reachable": "clear"} for name in ("can", "lemon", "block")}},
    "starts": {"objects": {"goal": GOAL}, "start": MIXED},
}
SECONDS, STILL, ROUNDS = 0.5, 2e-3, 5


def makers(compiled: CompiledScene, nworld: int) -> tuple[LayoutGenerator, ResetRandomizer]:
    """Return a generator of layouts, and a randomizer that resets to those that it made first."""
    generator = LayoutGenerator(compiled, nworld)
    generator.generate()
    model, data = make_worlds(compiled, nworld)
    source = StoredLayouts(compiled, generator.table(), nworld)
    randomizer = ResetRandomizer(compiled, model, data, layout_source=source)
    randomizer.reset()
    return generator, randomizer


def rates(scenes: Mapping[str, CompiledScene], nworld: int) -> dict[str, dict[str, float]]:
    """Return valid fresh layouts a second, and resets to stored layouts a second: medians of alternating rounds."""
    made = {name: makers(compiled, nworld) for name, compiled in scenes.items()}
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in scenes}
    for _ in range(ROUNDS):
        for name, (generator, randomizer) in made.items():
            device = scenes[name].device
            times[name].append((median(generator.generate, device), median(randomizer.reset, device)))
    found = {}
    for name, (generator, _) in made.items():
        fresh, stored = np.median(times[name], axis=0).tolist()
        valid = int((generator.layouts.status.cpu().numpy() == LayoutStatus.VALID).sum())
        found[name] = {"valid_per_s": valid / fresh, "ms": 1e3 * fresh, "stored_per_s": nworld / stored}
    return found


def held(compiled: CompiledScene, nworld: int) -> Iterator[dict[str, Any]]:
    """Yield for each kind that holds something the share of worlds in which it stays in the hand."""
    model, data = make_worlds(compiled, nworld)
    randomizer = ResetRandomizer(compiled, model, data)
    randomizer.reset()
    before = _in_hand(compiled, model, data)

    def step() -> None:
        mjw.step(model, data)

    step_all = step
    if wp.get_device(compiled.device).is_cuda:
        with wp.ScopedDevice(compiled.device), wp.ScopedCapture() as capture:
            step()
        step_all = lambda: wp.capture_launch(capture.graph)  # noqa: E731
        randomizer.write(randomizer.layouts, np.arange(nworld))
    for _ in range(round(SECONDS / compiled.mjm.opt.timestep)):
        step_all()
    drift = np.linalg.norm(_in_hand(compiled, model, data) - before, axis=1)
    kinds = randomizer.layouts.start.cpu().numpy()
    for number, kind in enumerate(compiled.config.start):
        of_kind = drift[kinds == number]
        if kind.robot == "grasp" and len(of_kind):
            yield {
                "kind": number,
                "worlds": len(of_kind),
                "held": float((of_kind < STILL).mean()),
                "drift_mm": {"median": 1e3 * float(np.median(of_kind)), "max": 1e3 * float(of_kind.max())},
            }


def shares(compiled: CompiledScene, nworld: int, layouts: int) -> dict[str, Any]:
    """Return how often each kind of start is served, those of the bank included, and the p-value of chi-square."""
    generator, weights = LayoutGenerator(compiled, nworld), np.array([kind.weight for kind in compiled.config.start])
    found = np.zeros(len(weights), int)
    for _ in range(-(-layouts // nworld)):
        generator.generate()
        found += np.bincount(generator.layouts.start.cpu().numpy(), minlength=len(weights))
    p = stats.chisquare(found, found.sum() * weights / weights.sum()).pvalue
    return {"layouts": int(found.sum()), "of_kinds": found.tolist(), "chi_square_p": float(p)}


def _in_hand(compiled: CompiledScene, model: mjw.Model, data: mjw.Data) -> np.ndarray:
    """Return the position of the block in the frame of the TCP [m], shape (nworld, 3)."""
    mjw.kinematics(model, data)
    site = compiled.mjm.site(compiled.scene.tcps["robot"]).id
    away = data.xpos.numpy()[:, compiled.scene.bodies["block"]] - data.site_xpos.numpy()[:, site]
    return np.einsum("nji,nj->ni", data.site_xmat.numpy()[:, site].reshape(-1, 3, 3), away)


def main() -> None:
    """Print the lines."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num-envs", type=int, default=4096)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--layouts", type=int, default=1_000_000, help="layouts whose kinds are counted")
    words = parser.parse_args()
    wp.config.quiet = True
    scenes = {n: compile_scene({"base": "tabletop_lift", **s}, words.device) for n, s in SCENES.items()}
    found = rates(scenes, words.num_envs)
    for name in scenes:
        print(json.dumps({"scene": name, "num_envs": words.num_envs, **found[name]}), flush=True)
    for other in ("clear", "marker", "shipped"):
        ratio = {key: found["starts"][key] / found[other][key] for key in ("valid_per_s", "stored_per_s")}
        print(json.dumps({"starts_over": other, **ratio}), flush=True)
    for line in held(scenes["starts"], words.num_envs):
        print(json.dumps(line), flush=True)
    print(json.dumps(shares(scenes["starts"], words.num_envs, words.layouts)))


if __name__ == "__main__":
    main()
