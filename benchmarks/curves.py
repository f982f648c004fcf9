"""The table and the picture of a folder of trainings, as benchmarks/evidence.sh makes it.

    python -m benchmarks.curves results --picture demo/training.png

Prints what is reached on layouts that were not trained on: for every kind of run the mean and the range over its seeds,
from the last evaluation of each; and when an evaluation first reached 95% (Reach) or 80% (Lift).
"""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

ASKED = {"TabletopReach-v0": 0.95, "TabletopLift-v0": 0.8}
"""Success on valid layouts that is asked for."""


@dataclass(frozen=True)
class Run:
    """A training: its folder's name without the seed, its options, and its evaluations in order."""

    kind: str
    options: dict[str, Any]
    evaluations: list[dict[str, Any]]

    @property
    def task(self) -> str:
        """What was trained."""
        return self.options["task"]

    @property
    def reached(self) -> dict[str, Any] | None:
        """The first evaluation with what is asked for, if there is one."""
        good = (line for line in self.evaluations if line["valid"]["success"] >= ASKED.get(self.task, 1.0))
        return next(good, None)


def read(folder: Path) -> list[Run]:
    """Return the runs in a folder that have been judged at least once."""
    runs = []
    for log in sorted(folder.glob("*/log.jsonl")):
        lines = [json.loads(line) for line in log.read_text().splitlines()]
        options = json.loads((log.parent / "config.json").read_text())["options"]
        judged = [line for line in lines if line["kind"] == "eval"]
        if judged:
            runs.append(Run(log.parent.name.rpartition("_")[0], options, judged))
    return runs


def spread(values: list[float], form: str = "{:.1%}") -> str:
    """Return mean and range in words."""
    mean, low, high = (form.format(v) for v in (sum(values) / len(values), min(values), max(values)))
    return mean if len(values) == 1 else f"{mean} ({low} to {high})"


def table(runs: list[Run]) -> str:
    """Return a Markdown table with a row for each kind of run."""
    kinds: dict[str, list[Run]] = defaultdict(list)
    for run in runs:
        kinds[run.kind].append(run)
    rows = ["| run | seeds | steps | valid | unfiltered | first as asked |", "|---|---|---|---|---|---|"]
    for kind, members in kinds.items():
        last = [run.evaluations[-1] for run in members]
        reached = [run.reached for run in members]
        when = spread([line["seconds"] for line in reached if line], "{:.0f} s") if all(reached) else "not all"
        valid, unfiltered = (spread([line[name]["success"] for line in last]) for name in ("valid", "unfiltered"))
        steps = spread([line["env_steps"] / 1e6 for line in last], "{:.0f} M")
        rows.append(f"| {kind} | {len(members)} | {steps} | {valid} | {unfiltered} | {when} |")
    return "\n".join(rows)


def draw(runs: list[Run], picture: Path) -> None:
    """Draw success against wall-clock and against steps for the runs on fresh layouts, and the banks beside."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    colors = {"TabletopReach-v0": "tab:blue", "TabletopLift-v0": "tab:orange"}
    figure, (by_time, by_steps, by_bank) = plt.subplots(1, 3, figsize=(12, 3.4), sharey=True, layout="constrained")
    named = set()
    for run in (r for r in runs if r.kind in ("reach", "lift")):
        success = [0.0, *(line["valid"]["success"] for line in run.evaluations)]
        label = None if run.task in named else run.task
        named.add(run.task)
        for axes, key, scale in ((by_time, "seconds", 1.0), (by_steps, "env_steps", 1e-6)):
            x = [0.0, *(scale * line[key] for line in run.evaluations)]
            axes.plot(x, success, color=colors[run.task], marker=".", label=label)
    by_time.set(xlabel="training [s]", ylabel="success on unseen layouts", ylim=(0.0, 1.02))
    by_steps.set(xlabel="control steps [millions]")
    by_time.legend(loc="lower right")
    order = ["bank_1", "bank_16", "bank_256", "bank_4096", "fresh", "uniform", "unreachable"]
    for i, kind in enumerate(order):
        for name, color, shift in (("valid", "tab:blue", -0.1), ("unfiltered", "tab:gray", 0.1)):
            shares = [run.evaluations[-1][name]["success"] for run in runs if run.kind == kind]
            by_bank.scatter([i + shift] * len(shares), shares, color=color, s=14, label=None if i else name)
    by_bank.set_xticks(range(len(order)), [kind.replace("bank_", "") for kind in order], rotation=30)
    by_bank.set_xlabel("layouts trained on")
    by_bank.legend(loc="lower right")
    for axes in (by_time, by_steps, by_bank):
        axes.grid(alpha=0.3)
    figure.savefig(picture, dpi=130)


def main(folder: Annotated[Path, tyro.conf.Positional], picture: Path | None = None) -> None:
    """Print the table, and draw the picture where one is wanted."""
    runs = read(folder)
    print(table(runs))
    if picture is not None:
        draw(runs, picture)


if __name__ == "__main__":
    tyro.cli(main)
