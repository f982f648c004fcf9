"""The page of results: made of the latest runs, each beside the one before."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import results
from benchmarks.figures import Run

ABOUT = {
    "commit": "abc1234",
    "date": "2026-01-02 03:04",
    "device": "cuda:0",
    "processor": "P",
    "cores": 4,
    "python": "3.12.1",
    "versions": {"mujoco": "4.0.0"},
    "card": "NVIDIA H100",
    "driver": "1.2",
}
RATE = {"scene": "mid", "num_envs": 4096, "valid_per_s": 5000, "ms": 0.25, "ms_of_2_percent": 0.125}


def run(name: str, **values: object) -> Run:
    """Return a run with a rate of its own."""
    return Run({"about": [ABOUT | values], "rates": [RATE | values]}, name)


def test_the_page_is_that_of_the_kept_runs():
    """`python -m benchmarks.results` was run after the last change."""
    kept = results.runs(results.HERE / "runs")
    assert results.PAGE.read_text(encoding="utf-8") == results.page(kept)


def test_a_figure_stands_beside_that_of_the_run_before():
    """In brackets, where it differs; sections without a figure are left out, and so are the older runs."""
    text = results.page([run("c"), run("b", valid_per_s=4000), run("a", valid_per_s=3000)])
    assert "5,000; 0.25 ms; 0.125 ms (4,000; 0.25 ms; 0.125 ms)" in text
    assert "The run before: b." in text
    assert "3,000" not in text
    assert "## Reach" not in text
    assert "(" not in results.page([run("b"), run("a")]).partition("## Layouts")[2]


def test_a_run_on_a_cpu_has_a_column_of_its_own():
    """Beside that of the GPU, and without a card."""
    text = results.page([run("b"), run("a", device="cpu", valid_per_s=70)])
    assert "| figure | target | H100 | CPU | command |" in text
    assert "| 5,000; 0.25 ms; 0.125 ms | 70; 0.25 ms; 0.125 ms |" in text


def test_figures_of_what_was_not_measured_are_left_out():
    """Of an arm, a peer or a rate that the run lacks, while those of others are there."""
    panda = {"arm": "panda", "lookups_per_s": 2e9, "map_bytes": 3e6, "file_bytes": 4e6}
    alone = {"valid_per_s": 1.5, "colliding": 0.0, "judged": 60}
    rows = [
        {"experiment": "Scene Synthesizer, Mid", "level": "one process", "measured": alone},
        {"experiment": "Scene Synthesizer, Mid", "level": "one a core", "measured": None},
    ]
    tier = {"arm": "panda", "set": "A", "tier": "map", "accuracy": 0.5, "false_positives": 0.25}
    measured = {"about": [ABOUT], "reach": [panda, tier], "paper": [{"rows": rows}]}
    text = results.page([Run(measured, "a")])
    assert "| panda: lookups in its map; map in memory; file | 1e9/s; 16 MB; 8 MB | 2e+09/s; 3.0 MB; 4.0 MB |" in text
    assert "| panda, set A, `map`: right; false positives |  | 50.00%; 25.000% |" in text
    assert "one process: valid scenes/s; those in which FCL finds a collision |  | 1.5; 0.0% of 60 |" in text
    assert "ur5e" not in text
    assert "a core" not in text
    assert "## Layouts" not in text


def test_ratios_have_their_standard_errors_where_the_run_has_them():
    """Earlier runs had one environment of each source, so they have medians without errors."""
    ratios = {"fresh / replayed": 0.9937, "fresh / fixed": 0.9}
    line = {"task": "DrawerPick-v0", "steps_per_second": {"fresh": 164395}}
    before = Run({"about": [ABOUT], "steps_DrawerPick-v0": [line | {"ratio_median": ratios}]}, "a")
    errors = {"ratio": ratios, "standard_error": dict.fromkeys(ratios, 0.0061)}
    after = Run({"about": [ABOUT], "steps_DrawerPick-v0": [line | errors]}, "b")
    text = results.page([after, before])
    assert "| 164,395; 0.994 ± 0.006; 0.900 ± 0.006 (164,395; 0.994; 0.900) |" in text


def test_what_run_sh_left_is_kept_as_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """By date, card and commit; lines that are not JSON are not taken."""
    monkeypatch.setattr(results, "HERE", tmp_path)
    (tmp_path / "runs").mkdir()
    (tmp_path / "about.jsonl").write_text(json.dumps(ABOUT))
    (tmp_path / "rates.jsonl").write_text("Warp says hello\n" + json.dumps(RATE))
    file = results.keep(tmp_path)
    assert file.name == "2026-01-02_nvidia_h100_abc1234.json"
    (kept,) = results.runs(file.parent)
    assert kept.line("rates", scene="mid") == RATE


def test_runs_of_one_day_are_ordered_by_their_times(tmp_path: Path):
    """Whatever their commits are called."""
    for commit, time in (("bbb", "03:04"), ("aaa", "15:16")):
        about = ABOUT | {"commit": commit, "date": f"2026-01-02 {time}"}
        (tmp_path / f"2026-01-02_{commit}.json").write_text(json.dumps({"about": [about]}))
    assert [found.about["commit"] for found in results.runs(tmp_path)] == ["aaa", "bbb"]


@pytest.mark.parametrize(("commit", "told"), [("", "has no about.jsonl"), ("abc1234-dirty", "are in no commit")])
def test_a_folder_that_is_no_run_is_refused(commit: str, told: str, tmp_path: Path):
    """Without its first measurement, or of sources that nobody else has."""
    if commit:
        (tmp_path / "about.jsonl").write_text(json.dumps(ABOUT | {"commit": commit}))
    with pytest.raises(SystemExit, match=told):
        results.keep(tmp_path)
