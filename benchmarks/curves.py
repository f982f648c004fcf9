"""Tables and picture for a folder of training runs, as made by benchmarks/evidence.sh.

    python -m benchmarks.curves results --picture results/training.png

Prints the success on layouts that were not trained on, by the last evaluation of each run: for each kind of run the
mean and the range over the seeds, and the Wilson interval over all layouts of all seeds; when an evaluation first
reached what is asked of the task; and success over density: by the number of other things that are present, and by how
near the nearest of them is to the target, in four parts of about as many layouts. The interval is that of these
policies on any layouts; what another seed of training would give, the range tells. A run that has not been evaluated
yet is left out. Runs of different sources, and comparisons of a task that differ in more than seed and layouts, are
refused.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from benchmarks.intervals import wilson

ASKED = {
    "ClutterExtract-v0": 0.8,
    "ClutterPush-v0": 0.9,
    "DrawerPick-v0": 0.8,
    "TabletopLift-v0": 0.8,
    "TabletopReachEasy-v0": 0.95,
    "TabletopLiftEasy-v0": 0.8,
}
"""Target success on valid layouts."""

COLORS = dict(zip(ASKED, ("tab:red", "tab:green", "tab:orange", "tab:blue", "tab:cyan", "tab:purple"), strict=True))

KINDS = ("bank of 1", "bank of 16", "bank of 256", "bank of 4,096", "bank of 65,536", "fresh", "uniform")
"""Where layouts come from, in the order in which they are shown."""

JUDGED = ("valid", "unfiltered")
"""The layouts on which policies are evaluated."""

SAME = ("num_envs", "million_steps", "reachable", "changes", "layouts")
"""Options in which all comparisons of a task are alike."""


@dataclass(frozen=True)
class Run:
    """A training run: its folder's name, its options, its evaluations in order, and the last one layout by layout."""

    name: str
    options: dict[str, Any]
    evaluations: list[dict[str, Any]]
    judged: dict[str, Any]

    @property
    def task(self) -> str:
        """The task that was trained."""
        return self.options["task"]

    @property
    def kind(self) -> str:
        """Where its layouts came from, one of KINDS."""
        if self.options.get("bank"):
            return f"bank of {self.options['bank']:,}"
        return "uniform" if self.options.get("uniform") else "fresh"

    @property
    def compared(self) -> bool:
        """Whether it is one of the comparisons, which end after a number of steps; others end after some time."""
        return self.options.get("million_steps") is not None

    @property
    def reached(self) -> dict[str, Any] | None:
        """The first evaluation that reached the target, if any."""
        good = (line for line in self.evaluations if line["valid"]["success"] >= ASKED.get(self.task, 1.0))
        return next(good, None)


def read(folder: Path) -> list[Run]:
    """Return the runs in a folder that have been evaluated at least once, by task and kind.

    Raises:
        SystemExit: they are of different sources
    """
    found, sources = [], {}
    for log in sorted(folder.glob("*/log.jsonl")):
        lines = [json.loads(line) for line in log.read_text().splitlines()]
        judged = [line for line in lines if line["kind"] == "eval"]
        if not judged:
            continue
        told = json.loads((log.parent / "config.json").read_text())
        sources.setdefault(told.get("sources", {}).get("hash"), log.parent.name)
        detail = log.parent / "judged.json"
        each = json.loads(detail.read_text()) if detail.is_file() else {}
        found.append(Run(log.parent.name, told["options"], judged, each))
    if len(sources) > 1:
        raise SystemExit(f"{folder}: runs of different sources: {', '.join(sources.values())} begin them.")
    _check_alike([run for run in found if run.compared])
    tasks, kinds = [*ASKED], [str(kind) for kind in KINDS]
    return sorted(
        found,
        key=lambda run: (tasks.index(run.task) if run.task in tasks else len(tasks), kinds.index(run.kind), run.name),
    )


def _check_alike(runs: Sequence[Run]) -> None:
    first: dict[str, Run] = {}
    for run in runs:
        other = first.setdefault(run.task, run)
        for name in SAME:
            one, two = other.options.get(name), run.options.get(name)
            if one != two:
                raise SystemExit(
                    f"{other.name} and {run.name} are comparisons of {run.task} with {name} = {one} and {two}. Compare "
                    "runs that differ in their seed and layouts alone."
                )


def grouped(runs: Sequence[Run]) -> dict[tuple[str, str], list[Run]]:
    """Return runs by task and kind, in their order."""
    groups: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        groups.setdefault((run.task, run.kind), []).append(run)
    return groups


def spread(values: list[float], form: str = "{:.1%}") -> str:
    """Return mean and range as text; only the mean if both ends look the same."""
    mean, low, high = (form.format(v) for v in (sum(values) / len(values), min(values), max(values)))
    return mean if low == high else f"{mean} ({low} to {high})"


def pooled(runs: Sequence[Run], judged: str) -> tuple[float, float]:
    """Return the Wilson interval of the share of successes among all layouts of the last evaluations."""
    last = [run.evaluations[-1][judged] for run in runs]
    number = sum(one["layouts"] for one in last)
    return wilson(sum(round(one["success"] * one["layouts"]) for one in last), number)


def table(runs: Sequence[Run]) -> str:
    """Return a Markdown table with a row for each task and kind of layouts."""
    rows = [
        "| task | layouts in training | seeds | steps | valid | 95%, these policies | unfiltered | first as asked |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for (task, kind), members in grouped(runs).items():
        last = [run.evaluations[-1] for run in members]
        reached = [line["seconds"] for line in (run.reached for run in members) if line is not None]
        when = spread(reached, "{:.0f} s") if reached else "-"
        if 0 < len(reached) < len(members):
            when += f", {len(reached)} of {len(members)} seeds"
        valid, unfiltered = (spread([line[name]["success"] for line in last]) for name in JUDGED)
        steps = spread([line["env_steps"] / 1e6 for line in last], "{:.1f} M")
        low, high = pooled(members, "valid")
        interval = f"{low:.1%} to {high:.1%}"
        rows.append(f"| {task} | {kind} | {len(members)} | {steps} | {valid} | {interval} | {unfiltered} | {when} |")
    return "\n".join(rows)


def by_density(runs: Sequence[Run]) -> str:
    """Return a Markdown table of success on valid layouts over density, for tasks that have some of it."""
    rows = [
        "| task | layouts in training | which layouts | successes | share | 95% interval |",
        "|---|---|---|---|---|---|",
    ]
    runs = [run for run in runs if run.judged]
    for (task, kind), members in grouped(runs).items():
        each = [run.judged["valid"]["each"] for run in members]
        success, things, nearest = (
            [value for one in each for value in one[key]] for key in ("success", "things", "nearest")
        )
        counts = sorted(set(things))
        parts = [(f"{count} other things", [n == count for n in things]) for count in counts if len(counts) > 1]
        parts += [
            (f"nearest at {low} to {high} mm", [d is not None and low <= d < high for d in nearest])
            for low, high in _quarters([run for run in runs if run.task == task])
        ]
        for label, chosen in parts:
            hits, number = sum(s for s, c in zip(success, chosen, strict=True) if c), sum(chosen)
            low, high = wilson(hits, number)
            share = f"{hits / number:.1%} | {low:.1%} to {high:.1%}"
            rows.append(f"| {task} | {kind} | {label} | {hits:,} of {number:,} | {share} |")
    return "\n".join(rows)


def _quarters(runs: Sequence[Run]) -> list[tuple[int, int]]:
    """Return four ranges of how near the nearest thing is [mm], in each of which are about as many layouts."""
    far = sorted(d for run in runs for d in run.judged["valid"]["each"]["nearest"] if d is not None)
    if not far:
        return []
    edges = sorted({far[0], *(far[len(far) * part // 4] for part in (1, 2, 3)), far[-1] + 1})
    return list(itertools.pairwise(edges))


def draw(runs: Sequence[Run], picture: Path) -> None:
    """Draw success over time where it was trained for some time, and by the source of layouts where it was compared."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import PercentFormatter

    plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    compared = [run for run in runs if run.compared]
    tasks = list(dict.fromkeys(run.task for run in compared))
    widths = [1.0, *(0.4 + 0.22 * len({run.kind for run in compared if run.task == task}) for task in tasks)]
    figure, axes = plt.subplots(
        1, len(widths), figsize=(12.0, 3.6), sharey=True, layout="constrained", squeeze=False,
        gridspec_kw={"width_ratios": widths},
    )  # fmt: skip
    draw_curves(axes[0, 0], [run for run in runs if not run.compared])
    for panel, task in zip(axes[0, 1:], tasks, strict=True):
        draw_comparison(panel, task, [run for run in compared if run.task == task])
    axes[0, 0].set(ylabel="success on unseen layouts", ylim=(0.0, 1.03))
    axes[0, 0].yaxis.set_major_formatter(PercentFormatter(1.0))
    for panel in axes[0]:
        panel.grid(axis="y", alpha=0.3)
        panel.set_axisbelow(True)
    figure.savefig(picture, dpi=130)
    plt.close(figure)


def draw_curves(panel: Any, runs: Sequence[Run]) -> None:
    """Draw success on valid layouts over training time, a line for each run, and a dashed one at what is asked."""
    panel.set(xlabel="training [min]", title="fresh layouts")
    for run in runs:
        color = COLORS.get(run.task, "tab:gray")
        x = [0.0, *(line["seconds"] / 60.0 for line in run.evaluations)]
        panel.plot(x, [0.0, *(line["valid"]["success"] for line in run.evaluations)], color=color, label=run.task)
        panel.axhline(ASKED.get(run.task, 1.0), color=color, linewidth=0.8, linestyle=(0, (4, 3)))
    if runs:
        panel.legend(loc="lower right", frameon=False, fontsize=7)


def draw_comparison(panel: Any, task: str, runs: Sequence[Run]) -> None:
    """Draw the mean success of every kind as bars, with a point for each seed."""
    groups = grouped(runs)
    for name, color, shift in zip(JUDGED, ("tab:blue", "tab:gray"), (-0.2, 0.2), strict=True):
        for i, members in enumerate(groups.values()):
            shares = [run.evaluations[-1][name]["success"] for run in members]
            mean, label = sum(shares) / len(shares), f"judged on {name} layouts"
            panel.bar(i + shift, mean, width=0.38, color=color, alpha=0.55, label=None if i else label)
            panel.scatter([i + shift] * len(shares), shares, color=color, s=9, zorder=3)
            panel.annotate(f"{mean:.0%}", (i + shift, max(shares) + 0.02), ha="center", fontsize=7, color="0.25")
    labels = [kind.removeprefix("bank of ") for _, kind in groups]
    panel.set_xticks(range(len(labels)), labels, rotation=30)
    panel.set_title(f"{task}, {runs[0].evaluations[-1]['env_steps'] / 1e6:.0f} M steps", fontsize=9)
    panel.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=1, frameon=False, fontsize=7)


def main(folder: Annotated[Path, tyro.conf.Positional], picture: Path | None = None) -> None:
    """Print the tables, and draw the picture if asked."""
    runs = read(folder)
    print("Trained for some time:\n", table([run for run in runs if not run.compared]), sep="\n")
    compared = [run for run in runs if run.compared]
    print("\nCompared after the same number of steps:\n", table(compared), sep="\n")
    print("\nThe same over density:\n", by_density(compared), sep="\n")
    if picture is not None:
        draw(runs, picture)


if __name__ == "__main__":
    tyro.cli(main)
