"""Possible results of a run of the suite, with two rows only."""

from __future__ import annotations

from benchmarks.paper.figures import Experiment, reported
from benchmarks.paper.rows import Row

FOUND = {
    "date": "2026-11-22",
    "device": "cpu",
    "cores": 2,
    "python": "3.11",
    "versions": {"warp-lang": "1.19.0"},
    "faces": {"apple": 17856},
    "seconds": 61.0,
    "rows": [
        Row(Experiment.WARM, 1024, {"seconds": 0.05, "valid_per_s": 2e4}, reported=reported(Experiment.WARM, 1024)),
        Row(Experiment.JUDGED, 0, {"colliding": 0.0, "judged": 100}),
    ],
}
