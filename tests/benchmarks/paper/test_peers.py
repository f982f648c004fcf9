"""Rows of peers: what placement without checks is worth, and how rates compare."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.paper.extent import Bench, Extent
from benchmarks.paper.figures import Experiment
from benchmarks.paper.peers import ratio_row, uniform_row
from benchmarks.paper.rows import Row
from benchmarks.paper.scenes import PHYSICS, compiled_scene


def test_placement_without_checks_is_fast_and_wrong(tmp_path: Path):
    """About half of the layouts collide; those alone are not counted."""
    bench = Bench("cpu", Extent(True, 64, "", 2, 100, 0.0), compiled_scene(PHYSICS, "cpu"), tmp_path)
    row = uniform_row(bench)
    share = row.measured["colliding"]
    assert 0.3 < share < 0.9
    assert row.measured["judged"] == 100
    assert row.measured["valid_per_s"] == pytest.approx(64 * (1 - share) / row.measured["seconds"])


def test_rates_are_compared_at_the_same_number_of_scenes():
    """With the last row of Scene Synthesizer, which has a process for each core."""
    warm = [Row(Experiment.WARM, n, {"valid_per_s": 10.0 * n}) for n in (4, 16)]
    kept = [Row(Experiment.KEPT, 4, {"valid_per_s": 8.0}), Row(Experiment.KEPT, 16, {"valid_per_s": 24.0})]
    made = [Row(Experiment.SYNTHESIZER, 0, {"valid_per_s": rate}) for rate in (1.0, 2.0)]
    assert ratio_row(16, warm, kept, made).measured == {"valid_ratio_warm": 80.0, "valid_ratio_cold": 12.0}
    assert "--peer" in ratio_row(16, warm, kept, []).missing
    nothing = [Row(Experiment.SYNTHESIZER, 0, {"valid_per_s": 0.0})]
    assert ratio_row(16, warm, kept, nothing).missing
