"""DrawerOpenPick-v0 trained with and without other starts, judged from the start pose on layouts not seen.

    python -m benchmarks.starts_training results/starts --million-steps 100 --seeds 0 1 2

Trains DrawerOpenPick-v0 with each of `STARTS`, and as it is, for equal numbers of control steps with the same settings.
All are judged in the first episodes of the layouts of DrawerOpenPick-v0 in the split "eval", which all begin in the
arm's start pose. Runs that are interrupted go on where they were at the next call; `--minutes` ends a call earlier. The
result is in `starts.json` of the folder.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import gymnasium

from sceniris_gym.files import as_json, replacing
from sceniris_gym.registration import ENTRY_POINTS
from sceniris_gym.training.settings import Options, evaluations
from sceniris_gym.training.train import Run

TASK = "DrawerOpenPick-v0"
OPEN = {"cabinet/upper": {"fraction": [0.9, 1.0]}}
HANDLE = {"of": "cabinet", "grasp": "upper_handle*"}
PULLING = {"weight": 2, "robot": "grasp", **HANDLE, "joints": {"cabinet/upper": {"fraction": [0.1, 0.85]}}}
LIFTED = {"weight": 1, "robot": "grasp", "of": "banana", "lift": [0.02, 0.25], "joints": OPEN}
STARTS = {
    "DrawerOpenPickStarts-v0": [
        {"weight": 4, "robot": "home"},
        {"weight": 1, "robot": "grasp", **HANDLE},
        PULLING,
        {"weight": 1, "robot": "home", "joints": OPEN},
        {"weight": 1, "robot": "pregrasp", "of": "banana", "joints": OPEN},
        {"weight": 1, "robot": "grasp", "of": "banana", "joints": OPEN},
        LIFTED,
    ],
    "DrawerOpenPickPaths-v0": [
        {"weight": 4, "robot": "home"},
        {"weight": 2, "robot": "path", **HANDLE, "share": [0.0, 1.0]},
        PULLING,
        {"weight": 3, "robot": "path", "of": "banana", "share": [0.0, 1.0], "joints": OPEN},
        LIFTED,
    ],
}
"""For each task, its kinds of start: at grasps and pre-grasps, or on paths to the handle and to the banana."""
CHANGES = ("gamma=0.985", "entropy=0.005", "steps=32")
"""The settings of DrawerPick-v0, fixed before the first run."""

_known = gymnasium.spec(f"sceniris_gym/{TASK}")
for _id, _kinds in STARTS.items():
    if _id not in gymnasium.registry:
        _words = {**_known.kwargs, "overrides": {"start": _kinds}}
        gymnasium.register(id=_id, **ENTRY_POINTS, max_episode_steps=_known.max_episode_steps, kwargs=_words)


def train(task: str, seed: int, words: argparse.Namespace, minutes: float) -> None:
    """Train a task further, for some minutes at most."""
    out = words.folder / f"{task}-{seed}"
    options = Options(
        f"benchmarks.starts_training:{task}" if task in STARTS else task,
        seed=seed,
        num_envs=words.num_envs,
        minutes=_seconds_of(out) / 60.0 + minutes,
        million_steps=words.million_steps,
        out=out,
        resume=True,
        device=words.device,
        judged=TASK,
        changes=CHANGES,
        layouts=words.layouts,
        evaluate_every=words.evaluate_every,
    )
    Run(options, lambda line: print(line[:160], flush=True)).go()


def _seconds_of(out: Path) -> float:
    """Return the seconds of training that a run has behind it."""
    told = evaluations(out) if (out / "log.jsonl").exists() else []
    return told[-1]["seconds"] if told else 0.0


def found(words: argparse.Namespace) -> dict[str, Any]:
    """Return the last evaluation of all runs that there are, and whether they took all steps."""
    runs = []
    for task in (TASK, *STARTS):
        for seed in words.seeds:
            told = evaluations(words.folder / f"{task}-{seed}") if (words.folder / f"{task}-{seed}").is_dir() else []
            if told:
                curve = [(line["env_steps"], line["valid"]["success"]) for line in told]
                done = told[-1]["env_steps"] >= 1e6 * words.million_steps
                runs.append({"task": task, "seed": seed, "done": done, "valid": told[-1]["valid"], "curve": curve})
    return {"million_steps": words.million_steps, "changes": CHANGES, "starts": STARTS, "runs": runs}


def main() -> None:
    """Train what is left of all runs, one after the other, and write down what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--million-steps", type=float, default=100.0)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--tasks", nargs="+", choices=(TASK, *STARTS), default=[TASK, *STARTS])
    parser.add_argument("--minutes", type=float, default=600.0, help="of this call, compiling left out")
    parser.add_argument("--num-envs", type=int, default=4096)
    parser.add_argument("--layouts", type=int, default=4096)
    parser.add_argument("--evaluate-every", type=float, default=60.0)
    parser.add_argument("--device", default=None)
    words = parser.parse_args()
    left = 60.0 * words.minutes
    for seed in words.seeds:
        for task in words.tasks:
            begun = time.monotonic()
            if left > 0.0:
                train(task, seed, words, left / 60.0)
            left -= time.monotonic() - begun
    with replacing(words.folder / "starts.json") as file:
        file.write_text(as_json(found(words), indent=1))
    print(json.dumps([{k: run[k] for k in ("task", "seed", "done")} for run in found(words)["runs"]]))


if __name__ == "__main__":
    main()
