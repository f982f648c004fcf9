"""Figures that others report of the experiments: the Sceniris paper's, and measurements of the programs themselves.

A figure of the paper has the words in which it stands there (arXiv:2512.16896, LaTeX source). Its curves have no
numbers in the text, and none is read off a picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Experiment(StrEnum):
    """The experiments, in the order in which they are told."""

    WARM = "Mid, warm"
    EMPTY = "Mid, cold, kernel cache empty"
    KEPT = "Mid, cold, kernel cache kept"
    FIRST_PASS = "Mid, 10 attempts, no restarts"
    MEMORY = "Mid, memory"
    JUDGED = "Mid, valid ones that FCL finds in collision"
    PHYSICS = "Mid by its colliding shapes, warm"
    SHARES = "Mid, share of the time by kind of kernel"
    REACH = "Mid, reachability of apple and cabinet"
    HARDER = "Hard and Hard+, warm"
    HARDER_EMPTY = "Hard and Hard+, cold, kernel cache empty"
    HARDER_KEPT = "Hard and Hard+, cold, kernel cache kept"
    SYNTHESIZER = "Scene Synthesizer, Mid"
    UNIFORM = "Placement without checks, Mid"
    RATIO = "Layouts/s relative to Scene Synthesizer"
    PICTURES = "Kitchen and table top, pictures"
    ORIGINAL = "Sceniris itself, in this run"


PAPER = "the paper, on one L4 and 16 CPU threads"
ORIGINAL = "Sceniris (commit 1338213, cuRobo 0.7.7), one H200 and 16 cores"
SYNTHESIZER = "Scene Synthesizer 1.15, one process on the host of that H200"


DRAWN = (Experiment.WARM, Experiment.EMPTY, Experiment.KEPT, Experiment.SHARES)
"""Experiments of which the paper has a picture, with numbers for few of its points."""


@dataclass(frozen=True)
class Reported:
    """A figure that others report.

    Attributes:
        experiment: What it belongs to.
        worlds: Number of scenes made at once; 0 where the source does not say.
        value: The figure, or the lower end of its range.
        high: The upper end of its range; None for a single figure.
        unit: Its unit.
        source: PAPER, or what was measured and where.
        place: Section or figure of the paper; how it was measured otherwise.
        quote: The words of the paper in which the figure stands; empty for measurements.
        level: "Hard", "Hard+" or empty.
    """

    experiment: Experiment
    worlds: int
    value: float
    unit: str
    source: str
    place: str
    quote: str = ""
    high: float | None = None
    level: str = ""

    def __str__(self) -> str:
        return f"{self.number} {self.unit}"

    @property
    def number(self) -> str:
        """The figure or its range, without a unit."""
        return _number(self.value) if self.high is None else f"{_number(self.value)} to {_number(self.high)}"


def _number(value: float) -> str:
    return f"{value:,.10g}"


_BATCH = "section Batched Scene Generation"
_BREAKDOWN = "section Component Breakdown"
_PRESSURE = "section Pressure Test"
_LEVELS = "section Scaling up with Complex Spatial Relationships; its batch is not named"
_CURVES = "figure of section Batched Scene Generation, caption"
_HARDER = "Hard and Hard+ increase about 20-30s execution time over its previous level in the cold start case"


def _paper(
    experiment: Experiment, worlds: int, value: float, unit: str, place: str, quote: str, **more: float | str
) -> Reported:
    return Reported(experiment, worlds, value, unit, PAPER, place, quote, **more)  # pyrefly: ignore[bad-argument-type]


_COLD = {
    1024: [(10.17, "s", _BREAKDOWN, r"Sceniris spends 10.17s on generating \textbf{1,024} scenes")],
    16384: [
        (32, "s", _BATCH, "Sceniris can finish the operation on 16,384 scenes in 32s"),
        (
            408.77,
            "valid/s",
            f"{_PRESSURE}; its batch is not named, the largest of that figure is 16,384",
            "This is higher than 408.77 valid scenes/s in Figure",
        ),
    ],
    524288: [
        (769.67, "s", _PRESSURE, "It takes 769.67s to finish for the cold start case"),
        (533.30, "valid/s", _PRESSURE, "resulting in 533.30 valid scenes/s"),
    ],
}
"""The paper's cold starts by number of scenes; it does not say what was in any cache."""

REPORTED: tuple[Reported, ...] = (
    _paper(Experiment.WARM, 16384, 2.52, "s", _BATCH, "The warm started Sceniris finishes 16,384 scenes in 2.52s"),
    _paper(
        Experiment.WARM,
        524288,
        5279.84,
        "valid/s",
        _PRESSURE,
        "For the warm start performance, it achieves 5,279.84 valid scenes/s",
    ),
    *(
        _paper(experiment, worlds, *figure)
        for experiment in (Experiment.KEPT, Experiment.EMPTY)
        for worlds, figures in _COLD.items()
        for figure in figures
    ),
    _paper(Experiment.FIRST_PASS, 524288, 113820, "invalid", _PRESSURE, "has 113,820 invalid scenes"),
    _paper(Experiment.MEMORY, 524288, 20, "GB", _PRESSURE, "fits in an L4 GPU, taking about 20GB VRAM"),
    _paper(Experiment.REACH, 0, 0.0001, "s a query", _BREAKDOWN, r"only takes a constant $\sim$0.0001s per query"),
    _paper(Experiment.REACH, 0, 1 / 20, "of a collision check", _BREAKDOWN, "at most 1/20 of the collision check cost"),
    *(
        _paper(experiment, 0, 20, "s more than the level before", _LEVELS, _HARDER, high=30, level=level)
        for experiment in (Experiment.HARDER_KEPT, Experiment.HARDER_EMPTY)
        for level in ("Hard", "Hard+")
    ),
    *(
        _paper(
            Experiment.HARDER,
            0,
            20,
            "s more than the level before",
            _LEVELS,
            "and about 20s in the warm start case",
            level=level,
        )
        for level in ("Hard", "Hard+")
    ),
    *(
        _paper(
            experiment,
            0,
            249,
            "valid/s",
            _LEVELS,
            "Sceniris still achieves about 249 valid scenes/s in Hard+ (cold start)",
            level="Hard+",
        )
        for experiment in (Experiment.HARDER_KEPT, Experiment.HARDER_EMPTY)
    ),
    _paper(
        Experiment.SYNTHESIZER,
        1,
        2.99,
        "s, one process",
        _BREAKDOWN,
        r"Scene Synthesizer takes 2.99s for \textbf{1} scene",
    ),
    _paper(
        Experiment.SYNTHESIZER,
        64,
        39,
        "s, ten processes",
        _BATCH,
        "while Scene Synthesizer can finish 64 scenes in 39s",
    ),
    _paper(
        Experiment.RATIO,
        16384,
        311,
        "times as many scenes/s, cold",
        _CURVES,
        "Sceniris handles 311 and 6,321 times more environments per second",
    ),
    _paper(
        Experiment.RATIO,
        16384,
        6321,
        "times as many scenes/s, warm",
        _CURVES,
        "Sceniris handles 311 and 6,321 times more environments per second",
    ),
    _paper(
        Experiment.RATIO,
        16384,
        234,
        "times as many valid scenes/s, cold",
        _BATCH,
        "Sceniris generates about 234 times more valid scenes than Scene Synthesizer in the cold start case",
    ),
    _paper(
        Experiment.RATIO,
        16384,
        2936,
        "times as many valid scenes/s, warm",
        _BATCH,
        "and about 2,936 times more in the warm start case",
    ),
    *(
        Reported(experiment, worlds, low, unit, ORIGINAL, place, high=high)
        for experiment, worlds, low, high, unit, place in (
            (Experiment.WARM, 1024, 1.05, 1.15, "s", "range of medians of five"),
            (Experiment.WARM, 1024, 768, 837, "valid/s", "range of medians of five"),
            (Experiment.WARM, 16384, 1.74, 2.35, "s", "range of medians of five"),
            (Experiment.WARM, 16384, 5553, 8773, "valid/s", "range of medians of five"),
            (Experiment.KEPT, 1024, 5.7, 6.5, "s", "range"),
            (Experiment.KEPT, 16384, 17.0, 18.3, "s", "range"),
            (Experiment.JUDGED, 1024, 4.4, 4.6, "% of 500", "FCL on its own meshes"),
            (Experiment.JUDGED, 16384, 4.6, 5.2, "% of 500", "FCL on its own meshes"),
        )
    ),
    Reported(Experiment.SYNTHESIZER, 1, 1.30, "s, cold", SYNTHESIZER, "the meshes of the original"),
    Reported(Experiment.SYNTHESIZER, 1, 1.2, "s, assets reused", SYNTHESIZER, "the meshes of the original"),
    Reported(Experiment.SYNTHESIZER, 1, 0.62, "valid/s, assets reused", SYNTHESIZER, "the meshes of the original"),
    Reported(Experiment.SYNTHESIZER, 1, 0, "of 8 in collision", SYNTHESIZER, "FCL on the meshes of the original"),
)


def reported(experiment: Experiment, worlds: int | None = None, level: str = "") -> tuple[Reported, ...]:
    """Return what others report of an experiment, of one number of scenes or, with None, of all."""
    found = (f for f in REPORTED if f.experiment is experiment and f.level == level)
    return tuple(f for f in found if worlds is None or f.worlds == worlds)
