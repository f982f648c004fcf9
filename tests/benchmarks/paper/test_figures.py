"""Figures that others report: those of the paper stand in the words quoted, and the words in the paper."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from benchmarks.paper.figures import ORIGINAL, PAPER, REPORTED, SYNTHESIZER, Experiment, Reported, reported

SOURCE = "SCENIRIS_PAPER"
"""Environment variable that names the LaTeX source of arXiv:2512.16896."""

PAPERS = [f for f in REPORTED if f.source == PAPER]


def numbers(words: str) -> list[float]:
    """Return the numbers in LaTeX, a fraction as one of them."""
    found = [float(a) / float(b) for a, b in re.findall(r"(\d+)/(\d+)", words)]
    return found + [float(n.replace(",", "")) for n in re.findall(r"\d[\d,]*(?:\.\d+)?", words)]


@pytest.mark.parametrize("figure", PAPERS, ids=lambda f: f"{f.experiment}-{f.worlds}-{f.value:g}")
def test_a_figure_of_the_paper_stands_in_its_quote(figure: Reported):
    """The value, the end of its range, and the number of scenes if the words have one."""
    found = numbers(figure.quote)
    assert figure.value in found
    assert figure.high is None or figure.high in found
    assert figure.place


def test_quotes_stand_in_the_paper():
    """Word by word, but for line breaks."""
    path = os.environ.get(SOURCE)
    if path is None:
        pytest.skip(f"{SOURCE} names no LaTeX source of arXiv:2512.16896")
    text = " ".join(Path(path).read_text(encoding="utf-8").split())
    assert [f.quote for f in PAPERS if " ".join(f.quote.split()) not in text] == []


def test_the_figures_of_the_pressure_test_agree_with_each_other():
    """Valid scenes a second follow from their number, the invalid ones and the time."""
    cold = {f.unit: f.value for f in reported(Experiment.KEPT, 524288)}
    (invalid,) = reported(Experiment.FIRST_PASS, 524288)
    assert (524288 - invalid.value) / cold["s"] == pytest.approx(cold["valid/s"], abs=0.005)


def test_a_measurement_says_of_what_and_where():
    """Whatever is not from the paper names program, version and hardware, and quotes nothing."""
    others = [f for f in REPORTED if f.source != PAPER]
    assert {f.source for f in others} == {ORIGINAL, SYNTHESIZER}
    assert all("H200" in f.source and not f.quote and f.place for f in others)


def test_ranges_are_told_with_both_ends():
    """Without trailing zeros, and with all digits."""
    told = {str(f) for f in reported(Experiment.WARM)}
    assert {"5,279.84 valid/s", "1.74 to 2.35 s", "5,553 to 8,773 valid/s"} <= told
