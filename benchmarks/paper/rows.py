"""`Row`: a row of the table, and the table as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import groupby

from benchmarks.paper.figures import DRAWN, ORIGINAL, PAPER, SYNTHESIZER, Experiment, Reported

_HEAD = ("| scenes at once | here | the paper, on an L4 | itself, measured elsewhere |", "|---|---|---|---|")


@dataclass(frozen=True)
class Row:
    """Figures measured here, beside those that others report of the same.

    Attributes:
        experiment: What it belongs to.
        worlds: Number of scenes made at once; 0 where it does not apply.
        measured: Figures by name, as in `_WORDS`; empty if there are none.
        missing: Why there are none.
        level: What else tells the row from others of its experiment, or empty.
        reported: What others report.
        note: What the figures mean, where that is not plain.
    """

    experiment: Experiment
    worlds: int = 0
    measured: Mapping[str, float] = field(default_factory=dict)
    missing: str = ""
    level: str = ""
    reported: tuple[Reported, ...] = ()
    note: str = ""

    def as_json(self) -> dict:
        """Return the row as JSON has it."""
        return asdict(self)


def time_words(value: float) -> str:
    """Return a time [s] in the unit that suits it."""
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 1e-6:.3g} us"


def share_words(value: float) -> str:
    """Return a share as a percentage."""
    return f"{100 * value:.3g}%"


def _count(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


_WORDS: Mapping[str, Callable[[float], str]] = {
    "seconds": time_words,
    "valid_per_s": lambda v: f"{_count(v)} valid/s",
    "valid": lambda v: f"{share_words(v)} valid",
    "ns_per_candidate": lambda v: f"{_count(v)} ns a candidate",
    "relative": lambda v: f"{v:.3f} of the time a candidate without",
    "cold_s": lambda v: f"{time_words(v)} cold",
    "imports_s": lambda v: f"imports {time_words(v)}",
    "compile_s": lambda v: f"scene and its kernels {time_words(v)}",
    "generate_s": lambda v: f"layouts {time_words(v)}",
    "peak_bytes": lambda v: f"{v / 1e9:.3g} GB",
    "judged": lambda v: f"of {_count(v)}",
    "colliding": lambda v: f"{share_words(v)} collide",
    "processes": lambda v: f"{_count(v)} processes" if v > 1 else "one process",
    "scene_s": lambda v: f"{time_words(v)} a scene",
    "made": lambda v: f"{_count(v)} made",
    "valid_ratio_cold": lambda v: f"{_count(v)} times as many valid scenes/s, cold",
    "valid_ratio_warm": lambda v: f"{_count(v)} times as many valid scenes/s, warm",
}
"""How figures are told. Those of other names are shares of time."""


def told(measured: Mapping[str, float]) -> str:
    """Return figures as words."""
    return ", ".join(_WORDS[n](v) if n in _WORDS else f"{n} {share_words(v)}" for n, v in measured.items())


def as_markdown(rows: Sequence[Row]) -> str:
    """Return the rows as a table for each experiment."""
    lines = []
    for experiment, some in groupby(rows, lambda row: row.experiment):
        lines += [f"**{experiment}**", "", *_HEAD]
        for row in some:
            what = ", ".join(part for part in (row.level, f"{row.worlds:,}" if row.worlds else "") if part)
            here = told(row.measured) or f"not measured: {row.missing}"
            paper = [_with_place(f, row) for f in row.reported if f.source == PAPER]
            if not paper and experiment in DRAWN:
                paper = ["drawn, without a number"]
            elsewhere = (_with_place(f, row) for f in row.reported if f.source != PAPER)
            note = f" ({row.note})" if row.note else ""
            lines.append(f"| {what} | {here}{note} | {'; '.join(paper)} | {'; '.join(elsewhere)} |")
        lines.append("")
    lines += [f"Sources: {PAPER}; {ORIGINAL}; {SYNTHESIZER}."]
    return "\n".join(lines).rstrip()


def _with_place(figure: Reported, row: Row) -> str:
    """Return a figure with the number of scenes that it is for, unless that is the row's, and where it stands."""
    other = figure.worlds not in (0, row.worlds)
    return f"{figure}{f' for {figure.worlds:,}' if other else ''} ({figure.place})"
