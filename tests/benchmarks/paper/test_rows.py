"""Rows as words, and as tables."""

from __future__ import annotations

import json

import pytest

from benchmarks.paper.figures import Experiment, reported
from benchmarks.paper.rows import Row, as_markdown, share_words, time_words, told


@pytest.mark.parametrize(
    ("seconds", "words"), [(769.67, "770 s"), (1.0, "1 s"), (0.0595, "59.5 ms"), (2.87e-4, "287 us"), (0.0, "0 us")]
)
def test_times_have_the_unit_that_suits_them(seconds: float, words: str):
    """Seconds, milliseconds or microseconds, three digits."""
    assert time_words(seconds) == words


def test_figures_are_told_in_order():
    """Known ones with their unit, others as shares of time."""
    words = told({"seconds": 2.5, "valid_per_s": 6553.6, "valid": 0.999, "collision": 0.125})
    assert words == "2.5 s, 6,554 valid/s, 99.9% valid, collision 12.5%"
    assert share_words(0.0) == "0%"


def test_a_table_has_what_was_measured_and_what_was_not():
    """With the paper's figures and where they stand; those of another number of scenes say so."""
    rows = [
        Row(Experiment.WARM, 16384, {"seconds": 0.01}, reported=reported(Experiment.WARM, 16384)),
        Row(Experiment.WARM, 524288, missing="left to a GPU", reported=reported(Experiment.WARM, 524288)),
        Row(Experiment.MEMORY, 64, {"peak_bytes": 5e8}, reported=reported(Experiment.MEMORY), note="of a process"),
    ]
    lines = as_markdown(rows).splitlines()
    (first,) = (line for line in lines if line.startswith("| 16,384 |"))
    assert first.split(" | ")[1] == "10 ms"
    assert first.split(" | ")[2] == "2.52 s (section Batched Scene Generation)"
    assert "1.74 to 2.35 s" in first.split(" | ")[3]
    assert any("not measured: left to a GPU" in line and "5,279.84 valid/s" in line for line in lines)
    assert as_markdown([Row(Experiment.WARM, 4, {"seconds": 1.0})]).count("drawn, without a number") == 1
    assert any("0.5 GB (of a process) | 20 GB for 524,288" in line for line in lines)
    assert sum(line.startswith("**") for line in lines) == 2


def test_a_row_is_json():
    """All of it, with the words of the paper."""
    row = Row(Experiment.MEMORY, 64, {"peak_bytes": 5e8}, reported=reported(Experiment.MEMORY))
    found = json.loads(json.dumps(row.as_json()))
    assert found["experiment"] == "Mid, memory"
    assert "20GB VRAM" in found["reported"][0]["quote"]
