"""Tables and picture of training runs."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import curves
from tests.benchmarks.runs import write_run


def test_tables_and_picture_are_made_of_the_seeds_that_are_there(tmp_path: Path):
    """Unjudged runs are left out, a time to success says of how many seeds, and the order is that of the sources."""
    write_run(tmp_path, "fresh_0", 0.95, million_steps=3.0)
    write_run(tmp_path, "fresh_1", 0.5, million_steps=3.0, seed=1)
    write_run(tmp_path, "bank_0", 0.25, million_steps=3.0, bank=4096)
    write_run(tmp_path, "bank_1", None, million_steps=3.0, bank=4096, seed=1)
    write_run(tmp_path, "uniform_0", 0.75, million_steps=3.0, uniform=True)
    write_run(tmp_path, "long", 0.85, million_steps=None)
    runs = curves.read(tmp_path)
    _, _, *rows = curves.table([run for run in runs if run.million_steps]).splitlines()
    both = "95.0% (83.5% to 98.6%); 50.0% (35.2% to 64.8%)"
    assert rows == [
        f"| ClutterExtract-v0 | {kind} | 3.0 M | {shares} | {shares} | - |"
        for kind, shares in (
            ("bank of 4,096 | 1", "25.0% (14.2% to 40.2%)"),
            ("fresh | 2", both),
            ("uniform | 1", "75.0% (59.8% to 85.8%)"),
        )
    ]
    write_run(tmp_path, "longer", 0.5, seed=1)
    *_, last = curves.table([run for run in curves.read(tmp_path) if not run.million_steps]).splitlines()
    assert last.endswith("| 9 s, 1 of 2 seeds |")
    assert [run.name for run in runs if not run.million_steps] == ["long"]
    dense = curves.by_density([run for run in runs if run.kind == "uniform"])
    assert "| uniform | 3.0 M | 5 other things | 15 of 20 | 75.0% | 53.1% to 88.8% |" in dense
    for part in ("50 to 60 mm | 8 of 8", "60 to 70 mm | 8 of 8", "70 to 81 mm | 14 of 14"):
        assert f"| uniform | 3.0 M | nearest at {part} | 100.0% |" in dense
    curves.draw(runs, tmp_path / "all.png")
    curves.draw([], tmp_path / "none.png")
    assert (tmp_path / "all.png").stat().st_size > (tmp_path / "none.png").stat().st_size > 0


def test_comparisons_of_other_lengths_have_rows_of_their_own(tmp_path: Path):
    """Also from another folder; a run that has not come to its end counts by its time."""
    first, second = tmp_path / "first", tmp_path / "second"
    for folder in (first, second):
        folder.mkdir()
    write_run(first, "fresh_0", 0.5, million_steps=2.5)
    write_run(second, "fresh_0", 0.75, million_steps=3.0)
    write_run(second, "fresh_1", 1.0, million_steps=4.0)
    runs = curves.read(second, first)
    assert [run.million_steps for run in runs] == [None, 2.5, 3.0]
    _, _, *rows = curves.table(runs[1:]).splitlines()
    assert [row.split(" | ")[4][:5] for row in rows] == ["50.0%", "75.0%"]


def test_no_run_counts_twice(tmp_path: Path):
    """Neither by a folder that is given again, nor by a copy."""
    write_run(tmp_path, "fresh_0", 0.5, million_steps=3.0)
    with pytest.raises(SystemExit, match="fresh_0 and fresh_0 are both ClutterExtract-v0, fresh, seed 0"):
        curves.read(tmp_path, tmp_path)


def test_kinds_are_in_order_whatever_the_size_of_a_bank(tmp_path: Path):
    """Small banks first, then fresh layouts, uniform placement last; a folder that is not there is told of."""
    for name, bank, uniform in (("a", None, True), ("b", None, False), ("c", 4096, False), ("d", 8, False)):
        write_run(tmp_path, name, 0.5, million_steps=3.0, bank=bank, uniform=uniform)
    assert [run.kind for run in curves.read(tmp_path)] == ["bank of 8", "bank of 4,096", "fresh", "uniform"]
    with pytest.raises(SystemExit, match="none: there is no such folder"):
        curves.read(tmp_path, tmp_path / "none")


def test_comparisons_of_other_numbers_of_worlds_are_not_mixed(tmp_path: Path):
    """Runs with the same number of steps have the same number of worlds; other runs may differ."""
    write_run(tmp_path, "first", 0.5, million_steps=3.0, num_envs=4096)
    write_run(tmp_path, "second", 0.5, million_steps=None, num_envs=64)
    write_run(tmp_path, "third", 0.5, million_steps=2.0, num_envs=64)
    assert len(curves.read(tmp_path)) == 3
    write_run(tmp_path, "fourth", 0.5, million_steps=3.0, num_envs=64)
    with pytest.raises(SystemExit, match="first and fourth are comparisons of ClutterExtract-v0 with num_envs"):
        curves.read(tmp_path)


def test_runs_of_different_sources_are_not_mixed(tmp_path: Path):
    """The error names the runs that begin each of them."""
    write_run(tmp_path, "first", 0.5)
    write_run(tmp_path, "second", 0.5, sources="b")
    with pytest.raises(SystemExit, match="different sources: first, second"):
        curves.read(tmp_path)
