"""Table and picture for a folder of training runs, as made by benchmarks/evidence.sh.

    python -m benchmarks.curves results --picture demo/training.png

Prints the success on layouts that were not trained on: for each kind of run the mean and the range over the available
seeds, from the last evaluation of each; and when an evaluation first reached 95% (Reach) or 80% (Lift), over the seeds
that did. A run that has not been evaluated yet is left out.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

ASKED = {"TabletopReach-v0": 0.95, "TabletopLift-v0": 0.8}
"""Target success on valid layouts."""

COLORS = {"TabletopReach-v0": "tab:blue", "TabletopLift-v0": "tab:orange"}

COMPARED = {
    "bank_1": "1",
    "bank_16": "16",
    "bank_256": "256",
    "bank_4096": "4,096",
    "fresh": "fresh",
    "uniform": "fresh,\nno\nchecks",
    "unreachable": "fresh,\nno\nreach",
}
"""Kinds of runs that are compared, and their labels in the picture."""

KINDS = ("reach", "lift", *COMPARED)

JUDGED = ("valid", "unfiltered")
"""The layouts on which policies are evaluated."""


@dataclass(frozen=True)
class Run:
    """A training run: its folder's name without the seed, its options, and its evaluations in order."""

    kind: str
    options: dict[str, Any]
    evaluations: list[dict[str, Any]]

    @property
    def task(self) -> str:
        """The task that was trained."""
        return self.options["task"]

    @property
    def reached(self) -> dict[str, Any] | None:
        """The first evaluation that reached the target, if any."""
        good = (line for line in self.evaluations if line["valid"]["success"] >= ASKED.get(self.task, 1.0))
        return next(good, None)


def read(folder: Path) -> dict[str, list[Run]]:
    """Return the runs in a folder that have been evaluated at least once, by kind: known kinds first, in order."""
    kinds: dict[str, list[Run]] = {}
    for log in sorted(folder.glob("*/log.jsonl")):
        lines = [json.loads(line) for line in log.read_text().splitlines()]
        judged = [line for line in lines if line["kind"] == "eval"]
        if judged:
            options = json.loads((log.parent / "config.json").read_text())["options"]
            kind = log.parent.name.removesuffix(f"_{options['seed']}")
            kinds.setdefault(kind, []).append(Run(kind, options, judged))
    known = [kind for kind in KINDS if kind in kinds]
    return {kind: kinds[kind] for kind in (*known, *(kind for kind in kinds if kind not in KINDS))}


def spread(values: list[float], form: str = "{:.1%}") -> str:
    """Return mean and range as text; only the mean if both ends look the same."""
    mean, low, high = (form.format(v) for v in (sum(values) / len(values), min(values), max(values)))
    return mean if low == high else f"{mean} ({low} to {high})"


def table(kinds: dict[str, list[Run]]) -> str:
    """Return a Markdown table with a row for each kind of run."""
    rows = ["| run | seeds | steps | valid | unfiltered | first as asked |", "|---|---|---|---|---|---|"]
    for kind, runs in kinds.items():
        last = [run.evaluations[-1] for run in runs]
        reached = [line["seconds"] for line in (run.reached for run in runs) if line is not None]
        when = spread(reached, "{:.0f} s") if reached else "-"
        if 0 < len(reached) < len(runs):
            when += f", {len(reached)} of {len(runs)} seeds"
        valid, unfiltered = (spread([line[name]["success"] for line in last]) for name in JUDGED)
        steps = spread([line["env_steps"] / 1e6 for line in last], "{:.0f} M")
        rows.append(f"| {kind} | {len(runs)} | {steps} | {valid} | {unfiltered} | {when} |")
    return "\n".join(rows)


def draw(kinds: dict[str, list[Run]], picture: Path) -> None:
    """Draw success against wall-clock time and steps for `reach` and `lift`, and the results of the other runs."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import PercentFormatter

    plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    width = {"width_ratios": [1, 1, 1.45]}
    figure, axes = plt.subplots(1, 3, figsize=(11.5, 3.5), sharey=True, layout="constrained", gridspec_kw=width)
    for panel, key, scale in ((axes[0], "seconds", 1.0), (axes[1], "env_steps", 1e-6)):
        for kind in ("reach", "lift"):
            draw_curves(panel, kinds.get(kind, []), key, scale)
    axes[0].set(xlabel="training [s]", ylabel="success on unseen layouts", ylim=(0.0, 1.03))
    axes[1].set(xlabel="control steps [millions]")
    if axes[0].lines:
        axes[0].legend(loc="lower right", frameon=False)
    draw_comparison(axes[2], {kind: kinds[kind] for kind in COMPARED if kind in kinds})
    axes[0].yaxis.set_major_formatter(PercentFormatter(1.0))
    for panel in axes:
        panel.grid(axis="y", alpha=0.3)
        panel.set_axisbelow(True)
    figure.savefig(picture, dpi=130)
    plt.close(figure)


def draw_curves(panel: Any, runs: list[Run], key: str, scale: float) -> None:
    """Draw success on valid layouts, a thin line for each seed, and a dashed line at the target."""
    for i, run in enumerate(runs):
        color = COLORS.get(run.task, "tab:gray")
        x = [0.0, *(scale * line[key] for line in run.evaluations)]
        success = [0.0, *(line["valid"]["success"] for line in run.evaluations)]
        seeds = f"{len(runs)} seeds" if len(runs) > 1 else "1 seed"
        label = None if i else f"{run.task}, {seeds}"
        panel.plot(x, success, color=color, marker=".", markersize=4, linewidth=1.2, alpha=0.8, label=label)
        if i == 0 and run.task in ASKED:
            panel.axhline(ASKED[run.task], color=color, linewidth=0.8, linestyle=(0, (4, 3)))


def draw_comparison(panel: Any, kinds: dict[str, list[Run]]) -> None:
    """Draw the mean success of every kind as bars, with a point for each seed."""
    for name, color, shift in zip(JUDGED, ("tab:blue", "tab:gray"), (-0.2, 0.2), strict=True):
        for i, runs in enumerate(kinds.values()):
            shares = [run.evaluations[-1][name]["success"] for run in runs]
            mean, label = sum(shares) / len(shares), f"judged on {name} layouts"
            panel.bar(i + shift, mean, width=0.38, color=color, alpha=0.55, label=None if i else label)
            panel.scatter([i + shift] * len(shares), shares, color=color, s=9, zorder=3)
            panel.annotate(f"{mean:.0%}", (i + shift, max(shares) + 0.02), ha="center", fontsize=7, color="0.25")
    panel.set_xticks(range(len(kinds)), [COMPARED[kind] for kind in kinds])
    panel.set_xlabel("Reach: layouts in the bank trained on, or fresh ones")
    if kinds:
        panel.legend(loc="upper center", bbox_to_anchor=(0.5, 1.17), ncols=2, frameon=False)


def main(folder: Annotated[Path, tyro.conf.Positional], picture: Path | None = None) -> None:
    """Print the table, and draw the picture if asked."""
    kinds = read(folder)
    print(table(kinds))
    if picture is not None:
        draw(kinds, picture)


if __name__ == "__main__":
    tyro.cli(main)
