"""The picture of the suite: time and rate over the number of scenes made at once, here and as others report them."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.paper.figures import ORIGINAL, PAPER, Experiment
from benchmarks.paper.rows import Row
from sceniris_gym.errors import MissingExtraError
from sceniris_gym.files import replacing

_LINES = {
    Experiment.WARM: ("warm", "tab:green"),
    Experiment.KEPT: ("cold, kernel cache kept", "tab:blue"),
    Experiment.EMPTY: ("cold, kernel cache empty", "tab:purple"),
}
_SOURCES = {PAPER: ("the paper, one L4", "x"), ORIGINAL: ("the original, one H200", "D")}
_TIMES, _RATES = ("seconds", "cold_s"), ("valid_per_s",)


def check_installed() -> None:
    """Make sure that the library that draws is there, before anything is measured.

    Raises:
        MissingExtraError: It is not.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise MissingExtraError("matplotlib", "plots")


def draw(rows: Sequence[Row], where: str, path: Path) -> None:
    """Draw the rows.

    Args:
        rows: The rows of the suite.
        where: On what they were measured.
        path: PNG to write.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 5.2), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    _panel(left, rows, _TIMES, "s")
    _panel(right, rows, _RATES, "valid/s")
    left.set_ylabel("time until the layouts are there [s]")
    right.set_ylabel("valid layouts a second")
    for axes in (left, right):
        axes.set(xscale="log", yscale="log", xlabel="scenes at once")
        axes.set_xscale("log", base=4)
        axes.xaxis.set_major_formatter(lambda x, _: f"{x:,.0f}")
        axes.grid(visible=True, which="major", alpha=0.3)
    peers = [row for row in rows if row.experiment is Experiment.SYNTHESIZER and row.measured]
    for row, style in zip(peers, ("--", ":"), strict=False):
        rate = row.measured["valid_per_s"]
        right.axhline(rate, color="tab:orange", ls=style, label=f"Scene Synthesizer here, {row.level}")
    named = dict(zip(*reversed(right.get_legend_handles_labels()), strict=True))
    named |= dict(zip(*reversed(left.get_legend_handles_labels()), strict=True))
    figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=4, fontsize=8)
    figure.suptitle(f"Scene Mid; lines: sceniris_gym on {where}; crosses and diamonds: the original, as reported")
    with replacing(path) as temporary:
        figure.savefig(temporary, format="png", dpi=110)


def _panel(axes: Any, rows: Sequence[Row], names: Sequence[str], unit: str) -> None:
    """Draw lines of what was measured, and points of what others report in the same unit."""
    for experiment, (label, color) in _LINES.items():
        own = [row for row in rows if row.experiment is experiment]
        points = [(row.worlds, _first(row.measured, names)) for row in own if row.measured]
        if points:
            axes.plot(*zip(*points, strict=True), "o-", color=color, ms=4, label=f"here, {label}")
        if experiment is Experiment.EMPTY:  # others do not tell the two kinds of cold starts apart
            continue
        for source, (name, marker) in _SOURCES.items():
            told = [f for row in own for f in row.reported if f.source == source and f.unit == unit]
            if told:
                middle = [(f.value * (f.high or f.value)) ** 0.5 for f in told]
                kind = "warm" if experiment is Experiment.WARM else "cold"
                axes.plot([f.worlds for f in told], middle, marker, color=color, label=f"{name}, {kind}")


def _first(measured: Mapping[str, float], names: Sequence[str]) -> float:
    return next(measured[name] for name in names if name in measured)
