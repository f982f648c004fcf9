"""The table of systems, and that the page of other measurements has it."""

from __future__ import annotations

from pathlib import Path

from benchmarks.paper.comparison import HEAD, comparison, others
from benchmarks.paper.figures import Experiment
from benchmarks.paper.rows import Row

PAGE = Path(__file__).parents[3] / "benchmarks" / "OTHER_RESULTS.md"


def test_own_rows_come_first_the_largest_at_the_top():
    """Those with a cold start, and the peers that were measured; cells that nobody has say so."""
    rows = [
        *(Row(Experiment.WARM, n, {"seconds": 0.1, "valid_per_s": 10.0 * n}) for n in (4, 1024, 4096, 16384)),
        Row(Experiment.EMPTY, 1024, {"cold_s": 13.4}),
        *(Row(Experiment.KEPT, n, {"cold_s": 2.5}) for n in (4, 1024, 16384)),
        Row(Experiment.JUDGED, 0, {"colliding": 0.0, "judged": 500}),
        Row(Experiment.SYNTHESIZER, 0, {"processes": 1, "cold_s": 1.2, "valid_per_s": 2.02}, level="one process"),
        Row(Experiment.UNIFORM, 1024, {"valid_per_s": 46825.0, "colliding": 0.61, "judged": 100}),
    ]
    lines = comparison(rows, "NVIDIA X").splitlines()
    assert lines[:2] == list(HEAD)
    assert lines[2:] == [
        "| sceniris_gym, `mid_16k` | NVIDIA X | 16,384 | 2.5 s (kernel cache kept) | 163,840 | 0% of 500 |",
        "| sceniris_gym, `mid_16k` | NVIDIA X | 1,024 | 2.5 s (kernel cache kept), 13.4 s (kernel cache empty) "
        "| 10,240 | 0% of 500 |",
        "| Scene Synthesizer, one process, on the meshes of `mid_16k` | CPU of the same host | 1 | 1.2 s | 2.02 "
        "| not reported |",
        "| the same candidates, none checked for collisions | NVIDIA X | 1,024 |  | 46,825 | 61% of 100 |",
        *others(),
    ]


def test_the_page_has_what_others_report():
    """Line by line, below the same head."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    assert set(others()) | set(HEAD) <= set(lines)
