"""Rates and resets of one tree beside those of another, in alternating rounds: a line for each row and tree.

    python -m benchmarks.resets_table results/resets --before ../earlier --device cuda:0

Rows are layouts of all worlds and of 2% of them by scene, and steps with fresh layouts over steps with replayed ones by
task, in episodes of 200 and of 20 steps. Every measurement is a process of its own, with the sources of its tree. Its
lines are kept in the folder, so a run that was stopped goes on. The last lines are medians over the rounds.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from sceniris_gym.registration import ENVS

SCENES = (
    *("clutter_extract:4096", "kitchen:4096", "clutter:4096", "tabletop_lift:4096", "tabletop_reach:4096"),
    *("mid:4096", "drawer_pick:4096", "drawer_open_pick:4096", "hard_plus:16384"),
)
TASKS = tuple(name.split("/")[1] for name in ENVS if "Easy" not in name)
HERE = Path(__file__).parents[1]


@dataclass(frozen=True)
class Options:
    """Options of a comparison.

    Attributes:
        folder: folder for the lines of every measurement
        before: root of an earlier tree; without it this one alone is measured
        scenes: scenes and numbers of worlds
        tasks: ids without their namespace
        episodes: control steps of an episode
        rounds: measurements of each row and tree
        num_envs: worlds of a task
        device: "cpu" or "cuda:0"
    """

    folder: Annotated[Path, tyro.conf.Positional] = Path("results/resets")
    before: Path | None = None
    scenes: tuple[str, ...] = SCENES
    tasks: tuple[str, ...] = TASKS
    episodes: tuple[int, ...] = (200, 20)
    rounds: int = 2
    num_envs: int = 4096
    device: str = "cuda:0"


def measured(tree: Path, module: str, *words: str) -> list[dict[str, Any]]:
    """Return the lines of JSON that a module of a tree prints.

    Raises:
        subprocess.CalledProcessError: it failed; what it said is on stderr
    """
    paths = [str(tree), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    command = [sys.executable, "-m", f"benchmarks.{module}", *words]
    done = subprocess.run(command, cwd=tree, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def rows_of(options: Options, tree: Path, folder: Path) -> dict[str, float]:
    """Measure all rows of a tree once, those that the folder has already excepted."""
    found = {}
    for scene in options.scenes:
        file = folder / f"{scene.replace(':', '_')}.json"
        if not file.exists():
            (line,) = measured(tree, "generator_rates", scene, "--device", options.device)
            file.write_text(json.dumps(line))
        line = json.loads(file.read_text())
        found |= {f"{scene} valid/s": line["valid_per_s"], f"{scene} 2% ms": line["ms_of_2_percent"]}
    for task in options.tasks:
        for episode in options.episodes:
            file = (folder / f"{task}_{episode}.json").absolute()
            words = ["--task", task, "--episode", str(episode), "--num-envs", str(options.num_envs)]
            words += ["--device", options.device, "--out", str(file)]
            (line,) = measured(tree, "reset_cost", *words)
            ratios = line.get("ratio") or line["ratio_median"]  # earlier trees have one environment of each source
            found[f"{task} {episode} steps fresh / replayed"] = ratios["fresh / replayed"]
    return found


def main(options: Options) -> None:
    """Measure what the folder lacks, and print a line of JSON for each row."""
    trees = {"after": HERE} if options.before is None else {"before": options.before.absolute(), "after": HERE}
    rounds: dict[str, list[dict[str, float]]] = {name: [] for name in trees}
    for number in range(options.rounds):
        for name, tree in trees.items():
            folder = options.folder / f"{name}_{number}"
            folder.mkdir(parents=True, exist_ok=True)
            rounds[name].append(rows_of(options, tree, folder))
    for row in rounds["after"][0]:
        medians = {name: statistics.median(one[row] for one in of_tree) for name, of_tree in rounds.items()}
        print(json.dumps({"row": row, **medians}), flush=True)


if __name__ == "__main__":
    main(tyro.cli(Options))
