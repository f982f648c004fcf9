"""The table that compares systems, a row each: what a run of the suite found, and what others report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from benchmarks.paper.figures import ORIGINAL, PAPER, SYNTHESIZER, Experiment, reported
from benchmarks.paper.rows import Row, share_words, time_words

HEAD = (
    "| system | hardware | scenes at once | cold | valid scenes/s, warm | marked valid, but FCL finds a collision |",
    "|---|---|---|---|---|---|",
)
_UNKNOWN = "not reported"
_FEWEST = 1024  # scenes of a row
_ARENA = (
    "Isaac Lab Arena, pooled placer, as reported by its authors, another scene of 3 objects",
    "RTX 6000 Ada",
    "128",
    _UNKNOWN,
    "66.7 (boxes), 36.3 (meshes)",
    _UNKNOWN,
)


def comparison(rows: Sequence[Row], device: str) -> str:
    """Return the table as Markdown.

    Args:
        rows: The rows of the suite.
        device: On what they were measured.
    """
    cells = (*_own(rows, device), *_peers(rows, device))
    return "\n".join((*HEAD, *(_line(*row) for row in cells), *others()))


def others() -> list[str]:
    """Return the rows of what others report."""
    original, paper = "Sceniris (commit 1338213, cuRobo 0.7.7)", "Sceniris, as reported in its paper"
    in_collision = "% of 500"
    rows = [
        (
            original,
            "H200",
            f"{worlds:,}",
            _told(Experiment.KEPT, ORIGINAL, worlds, "s"),
            _told(Experiment.WARM, ORIGINAL, worlds, "valid/s", False),
            _told(Experiment.JUDGED, ORIGINAL, worlds, in_collision),
        )
        for worlds in (16384, 1024)
    ]
    rows += [
        (
            paper,
            "L4",
            "524,288",
            _told(Experiment.KEPT, PAPER, 524288, "s"),
            _told(Experiment.WARM, PAPER, 524288, "valid/s", False),
            _UNKNOWN,
        ),
        (
            paper,
            "L4",
            "16,384",
            _told(Experiment.KEPT, PAPER, 16384, "s"),
            f"all 16,384, valid or not, in {_told(Experiment.WARM, PAPER, 16384, 's')}",
            _UNKNOWN,
        ),
        (
            "Scene Synthesizer 1.15, one process",
            "CPU of the host of that H200",
            "1",
            _told(Experiment.SYNTHESIZER, SYNTHESIZER, 1, "s, cold"),
            _told(Experiment.SYNTHESIZER, SYNTHESIZER, 1, "valid/s, assets reused", False),
            _told(Experiment.SYNTHESIZER, SYNTHESIZER, 1, "of 8 in collision").removesuffix(" in collision"),
        ),
        (
            "Scene Synthesizer, ten processes, as reported in the paper of Sceniris",
            "16 CPU threads",
            "64 in all",
            _told(Experiment.SYNTHESIZER, PAPER, 64, "s, ten processes"),
            _UNKNOWN,
            _UNKNOWN,
        ),
        _ARENA,
    ]
    return [_line(*row) for row in rows]


def _told(experiment: Experiment, source: str, worlds: int, unit: str, with_unit: bool = True) -> str:
    """Return the one figure of an experiment that a source reports in a unit."""
    (found,) = (f for f in reported(experiment, worlds) if f.source == source and f.unit == unit)
    return f"{found.number}{'' if unit[0] == '%' else ' '}{unit.split(',')[0]}" if with_unit else found.number


def _own(rows: Sequence[Row], device: str) -> Iterator[tuple[str, ...]]:
    """Yield what was measured of this package, the largest numbers of scenes first."""
    judged = next(row for row in rows if row.experiment is Experiment.JUDGED)
    fault = f"{share_words(judged.measured['colliding'])} of {judged.measured['judged']:,}"
    started = {r.worlds for r in rows if r.experiment in (Experiment.KEPT, Experiment.EMPTY) and r.measured}
    for row in reversed(rows):
        if row.experiment is not Experiment.WARM or row.worlds < _FEWEST or row.worlds not in started:
            continue
        starts = (
            f"{time_words(other.measured['cold_s'])} (kernel cache {word})"
            for word, experiment in (("kept", Experiment.KEPT), ("empty", Experiment.EMPTY))
            for other in rows
            if other.experiment is experiment and other.worlds == row.worlds and other.measured
        )
        rate = f"{row.measured['valid_per_s']:,.0f}"
        yield "sceniris_gym, `mid_16k`", device, f"{row.worlds:,}", ", ".join(starts), rate, fault


def _peers(rows: Sequence[Row], device: str) -> Iterator[tuple[str, ...]]:
    """Yield what was measured of others in the same run."""
    for row in rows:
        if not row.measured or row.experiment not in (Experiment.SYNTHESIZER, Experiment.UNIFORM):
            continue
        found = row.measured
        fault = f"{share_words(found['colliding'])} of {found['judged']:,}" if "colliding" in found else _UNKNOWN
        rate = f"{found['valid_per_s']:,.3g}" if found["valid_per_s"] < 100 else f"{found['valid_per_s']:,.0f}"
        if row.experiment is Experiment.UNIFORM:
            yield "the same candidates, none checked for collisions", device, f"{row.worlds:,}", "", rate, fault
        else:
            name = f"Scene Synthesizer, {row.level}, on the meshes of `mid_16k`"
            yield name, "CPU of the same host", f"{found['processes']:.0f}", time_words(found["cold_s"]), rate, fault


def _line(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"
