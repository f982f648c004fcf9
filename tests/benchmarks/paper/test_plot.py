"""The picture of the suite."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from benchmarks.paper import plot
from benchmarks.paper.figures import Experiment, reported
from benchmarks.paper.rows import Row
from sceniris_gym.errors import MissingExtraError


def test_rows_are_drawn_with_what_others_report(tmp_path: Path):
    """Other rows, and rows without figures, change nothing."""
    rows = [
        Row(Experiment.WARM, n, {"seconds": n * 1e-6, "valid_per_s": 1e6}, reported=reported(Experiment.WARM, n))
        for n in (4, 1024, 16384)
    ]
    rows += [Row(Experiment.SYNTHESIZER, 0, {"valid_per_s": 2.0}, level="one process")]
    plot.draw(rows, "cpu", tmp_path / "a.png")
    more = [Row(Experiment.KEPT, 4, missing="why"), Row(Experiment.SHARES, 4, {"collision": 1.0})]
    plot.draw([*rows, *more], "cpu", tmp_path / "b.png")
    assert Image.open(tmp_path / "a.png").size[0] > 1000
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    plot.draw(rows[:1], "cpu", tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() != (tmp_path / "b.png").read_bytes()


def test_without_matplotlib_its_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    """Before anything is measured."""
    monkeypatch.setattr(plot.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(MissingExtraError, match=r"\[plots\]"):
        plot.check_installed()
