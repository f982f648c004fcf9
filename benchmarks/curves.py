"""Draw tables and a picture for folders of training runs, as benchmarks/evidence.sh makes them.

    python -m benchmarks.curves results --picture results/training.png

The first table shows, for runs that trained for some time, the success of each run's last evaluation on layouts that it
was not trained on, with its 95% Wilson interval, and when an evaluation first reached what is asked of the task. The
second shows the same for comparisons, which end after a number of steps. The third shows their success over density,
all seeds together: by the number of other things that are present, and by the distance of the nearest one from the
target, in four ranges of about equally many layouts. An interval covers these policies on any layouts; how far seeds
differ shows what another training may give.

Runs without an evaluation are left out. Runs of different sources are refused, and so are comparisons of one task and
number of steps that differ in more than seed and layouts, or in nothing.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from sceniris_gym.training.settings import evaluations, share, success_interval

ASKED = {
    "ClutterExtract-v0": 0.8,
    "ClutterPush-v0": 0.9,
    "DrawerPick-v0": 0.8,
    "TabletopLift-v0": 0.8,
    "TabletopReachEasy-v0": 0.95,
    "TabletopLiftEasy-v0": 0.8,
}
"""Success on valid layouts that is asked of each task."""

COLORS = dict(zip(ASKED, ("tab:red", "tab:green", "tab:orange", "tab:blue", "tab:cyan", "tab:purple"), strict=True))

JUDGED = {"valid": "valid layouts", "unfiltered": "layouts placed without checks"}
"""The kinds of layouts that policies are evaluated on, and their names in the picture."""

SAME = ("num_envs", "reachable", "changes", "layouts")
"""Options that all comparisons of a task after the same number of steps share."""


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
        """Source of its layouts: a bank of so many, "fresh" or "uniform"."""
        if self.options.get("bank"):
            return f"bank of {self.options['bank']:,}"
        return "uniform" if self.options.get("uniform") else "fresh"

    @property
    def million_steps(self) -> float | None:
        """Million steps after which it was to end, and did; None if it ended otherwise, and counts by its time."""
        limit = self.options.get("million_steps")
        return limit if limit is not None and self.evaluations[-1]["env_steps"] >= 1e6 * limit else None

    @property
    def comparison(self) -> tuple[str, float | None]:
        """Key of its comparison: its task and `million_steps`."""
        return self.task, self.million_steps

    @property
    def reached(self) -> dict[str, Any] | None:
        """The first evaluation that reached what is asked of the task, if any."""
        good = (line for line in self.evaluations if line["valid"]["success"] >= ASKED.get(self.task, 1.0))
        return next(good, None)


def read(*folders: Path) -> list[Run]:
    """Return the evaluated runs in folders, by task, steps and kind.

    Raises:
        SystemExit: a folder is missing, the runs are of different sources, or comparisons are not alike
    """
    for folder in folders:
        if not folder.is_dir():
            raise SystemExit(f"{folder}: there is no such folder. Give folders of training runs.")
    found, sources = [], {}
    for log in sorted(path for folder in folders for path in folder.glob("*/log.jsonl")):
        judged = evaluations(log.parent)
        if not judged:
            continue
        told = json.loads((log.parent / "config.json").read_text())
        sources.setdefault(told.get("sources", {}).get("hash"), log.parent.name)
        detail = log.parent / "judged.json"
        each = json.loads(detail.read_text()) if detail.is_file() else {}
        found.append(Run(log.parent.name, told["options"], judged, each))
    if len(sources) > 1:
        where = ", ".join(str(folder) for folder in folders)
        raise SystemExit(f"{where}: runs of different sources: {', '.join(sources.values())} begin them.")
    _check_alike([run for run in found if run.million_steps])
    tasks = [*ASKED]

    def place(run: Run) -> tuple[int, float, bool, float, str]:
        task = tasks.index(run.task) if run.task in tasks else len(tasks)
        return task, run.million_steps or 0.0, run.kind == "uniform", run.options.get("bank") or math.inf, run.name

    return sorted(found, key=place)


def _check_alike(runs: Sequence[Run]) -> None:
    first: dict[tuple[str, float | None], Run] = {}
    seeds: dict[tuple[Any, ...], Run] = {}
    for run in runs:
        other = first.setdefault(run.comparison, run)
        for name in SAME:
            one, two = other.options.get(name), run.options.get(name)
            if one != two:
                raise SystemExit(
                    f"{other.name} and {run.name} are comparisons of {run.task} with {name} = {one} and {two}. Compare "
                    "runs that differ in their seed and layouts alone."
                )
        seed = run.options["seed"]
        twin = seeds.setdefault((run.comparison, run.kind, seed), run)
        if twin is not run:
            raise SystemExit(
                f"{twin.name} and {run.name} are both {run.task}, {run.kind}, seed {seed}. Give one of them."
            )


def grouped(runs: Sequence[Run]) -> list[list[Run]]:
    """Return the runs of each task, number of steps and kind, in their order."""
    groups: dict[tuple[Any, ...], list[Run]] = {}
    for run in runs:
        groups.setdefault((run.comparison, run.kind), []).append(run)
    return list(groups.values())


def steps_of(runs: Sequence[Run]) -> str:
    """Return the numbers of steps after which runs were last evaluated, as text."""
    return spread([run.evaluations[-1]["env_steps"] / 1e6 for run in runs], "{:.1f} M")


def spread(values: list[float], form: str = "{:.1%}") -> str:
    """Return mean and range as text; only the mean if both ends look the same."""
    mean, low, high = (form.format(v) for v in (sum(values) / len(values), min(values), max(values)))
    return mean if low == high else f"{mean} ({low} to {high})"


def by_seed(runs: Sequence[Run], judged: str) -> str:
    """Return the share of successes of each run's last evaluation with its 95% Wilson interval, as text."""
    return "; ".join(share(run.evaluations[-1][judged]) for run in runs)


def table(runs: Sequence[Run]) -> str:
    """Return a Markdown table with a row for each task, number of steps and kind of layouts."""
    rows = [
        "| task | layouts in training | seeds | steps | valid, by seed | unfiltered, by seed | first as asked |",
        "|---|---|---|---|---|---|---|",
    ]
    for members in grouped(runs):
        # comparisons are evaluated at their end alone
        reached = [run.reached["seconds"] for run in members if run.reached and not run.million_steps]
        when = spread(reached, "{:.0f} s") if reached else "-"
        if 0 < len(reached) < len(members):
            when += f", {len(reached)} of {len(members)} seeds"
        which = f"{members[0].task} | {members[0].kind} | {len(members)} | {steps_of(members)}"
        shares = " | ".join(by_seed(members, judged) for judged in JUDGED)
        rows.append(f"| {which} | {shares} | {when} |")
    return "\n".join(rows)


def by_density(runs: Sequence[Run]) -> str:
    """Return a Markdown table of success on valid layouts over density."""
    rows = [
        "| task | layouts in training | steps | which layouts | successes | share | 95% interval |",
        "|---|---|---|---|---|---|---|",
    ]
    runs = [run for run in runs if run.judged]
    for members in grouped(runs):
        task, kind = members[0].task, members[0].kind
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
            low, high = success_interval(hits, number)
            told = f"{hits:,} of {number:,} | {hits / number:.1%} | {low:.1%} to {high:.1%}"
            rows.append(f"| {task} | {kind} | {steps_of(members)} | {label} | {told} |")
    return "\n".join(rows)


def _quarters(runs: Sequence[Run]) -> list[tuple[int, int]]:
    """Return four ranges of the distance of the nearest thing [mm], each with about as many layouts."""
    far = sorted(d for run in runs for d in run.judged["valid"]["each"]["nearest"] if d is not None)
    if not far:
        return []
    edges = sorted({far[0], *(far[len(far) * part // 4] for part in (1, 2, 3)), far[-1] + 1})
    return list(itertools.pairwise(edges))


def draw(runs: Sequence[Run], picture: Path) -> None:
    """Draw success over time for runs that trained for some time, and by the source of layouts for comparisons."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import PercentFormatter

    plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    timed = [run for run in runs if not run.million_steps]
    compared = [run for run in runs if run.million_steps]
    comparisons = [list(one) for _, one in itertools.groupby(compared, lambda run: run.comparison)]
    widths = [1.0] * bool(timed) + [0.4 + 0.22 * len({run.kind for run in one}) for one in comparisons]
    figure, axes = plt.subplots(
        1, max(1, len(widths)), figsize=(2.0 + 1.7 * sum(widths), 3.6), sharey=True, layout="constrained",
        squeeze=False, gridspec_kw={"width_ratios": widths or None},
    )  # fmt: skip
    panels = list(axes[0])
    panels[0].set(ylabel="success on unseen layouts", ylim=(-0.02, 1.02), yticks=[0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
    panels[0].yaxis.set_major_formatter(PercentFormatter(1.0))
    for panel in panels:
        panel.grid(axis="y", alpha=0.3)
        panel.set_axisbelow(True)
    if timed:
        draw_curves(panels.pop(0), timed)
    for panel, one in zip(panels, comparisons, strict=False):
        draw_comparison(panel, one)
    if comparisons:
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower right", ncols=2, frameon=False, fontsize=8)
    figure.savefig(picture, dpi=130)
    plt.close(figure)


def draw_curves(panel: Any, runs: Sequence[Run]) -> None:
    """Draw success on valid layouts over training time as a line for each run, and what is asked as a dashed line."""
    panel.set(xlabel="training [min]")
    panel.set_title("over time,\na line for each run", fontsize=9)
    for task, of_task in itertools.groupby(runs, lambda run: run.task):
        color = COLORS.get(task, "tab:gray")
        for kind, one in itertools.groupby(of_task, lambda run: run.kind):
            label = f"{task},\ntrained on {kind}"
            for run in one:
                x = [line["seconds"] / 60.0 for line in run.evaluations]
                y = [line["valid"]["success"] for line in run.evaluations]
                panel.plot(x, y, color=color, marker=".", label=label)
                label = None
        panel.axhline(ASKED.get(task, 1.0), color=color, linewidth=0.8, linestyle=(0, (4, 3)))
    panel.set_xlim(left=0.0)
    panel.legend(loc="lower right", frameon=False, fontsize=7)


def draw_comparison(panel: Any, runs: Sequence[Run]) -> None:
    """Draw the success of each seed as a point, and the range of each kind as a line."""
    groups = grouped(runs)
    for name, color, shift in zip(JUDGED, ("tab:blue", "tab:gray"), (-0.15, 0.15), strict=True):
        for i, members in enumerate(groups):
            shares = [run.evaluations[-1][name]["success"] for run in members]
            panel.vlines(i + shift, min(shares), max(shares), color=color, alpha=0.4, linewidth=4.0)
            label = None if i else f"on {JUDGED[name]}, a point for each seed"
            panel.scatter([i + shift] * len(shares), shares, color=color, s=14, zorder=3, label=label)
    panel.set_xticks(range(len(groups)), [members[0].kind for members in groups], rotation=30, ha="right")
    panel.set_xlim(-0.5, len(groups) - 0.5)
    panel.set_title(f"{runs[0].task}\n{steps_of(runs)} steps", fontsize=9)


def main(folders: Annotated[list[Path], tyro.conf.Positional], picture: Path | None = None) -> None:
    """Print the tables, and draw the picture if there is a path for it."""
    runs = read(*folders)
    print("Trained for some time:\n", table([run for run in runs if not run.million_steps]), sep="\n")
    compared = [run for run in runs if run.million_steps]
    print("\nCompared after the same number of steps:\n", table(compared), sep="\n")
    print("\nThe same over density:\n", by_density(compared), sep="\n")
    if picture is not None:
        draw(runs, picture)


if __name__ == "__main__":
    tyro.cli(main)
