"""Comparisons: intervals and tests against references, by axis and grade, and files that do not belong together."""

from __future__ import annotations

import json
from math import comb
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.stats import binomtest, norm

from sceniris_gym.errors import ArgumentError, MissingExtraError
from sceniris_gym.suites import comparing
from sceniris_gym.suites.comparing import compare, paired, plot, shares


def write(path: Path, outcomes: list[int], **head: object) -> Path:
    """Write rows: two nominal cases, then cases of two grades of an axis."""
    axes = [("nominal", 0)] * 2 + [("shift", 1 + i % 2) for i in range(len(outcomes) - 2)]
    rows = [
        {"case": i, "id": f"h:eval:{i}:0", "axis": axis, "grade": grade, "fallback": i == 3}
        | {"success": bool(won), "success_once": True}
        for i, (won, (axis, grade)) in enumerate(zip(outcomes, axes, strict=True))
    ]
    path.write_text("\n".join(map(json.dumps, ({"rows": len(rows), "of": "a", **head}, *reversed(rows)))))
    return path


def test_differences_are_those_of_pairs(tmp_path: Path):
    """In any order of the rows, without layouts from the bank."""
    a = write(tmp_path / "a.jsonl", [1, 0, 1, 1, 0, 0, 1, 0])
    b = write(tmp_path / "b.jsonl", [1, 1, 1, 0, 1, 1, 0, 0])
    found = {(one["axis"], one["grade"]): one for one in compare(a, b)}
    assert list(found) == [("all", None), ("nominal", 0), ("shift", None), ("shift", 1), ("shift", 2)]
    counts = {key: (one["cases"], one["only_a"], one["only_b"]) for key, one in found.items()}
    assert counts == {
        ("all", None): (7, 1, 3),
        ("nominal", 0): (2, 0, 1),
        ("shift", None): (5, 1, 2),
        ("shift", 1): (3, 1, 1),
        ("shift", 2): (2, 0, 1),
    }
    assert found["shift", 1]["difference"] == 0.0
    assert found["all", None]["a"] == pytest.approx(3 / 7)
    assert compare(a, b, "success_once")[0]["difference"] == 0.0


def test_the_exact_test_and_the_number_of_cases_are_those_of_references():
    """McNemar's p-value by sums of binomial coefficients, and the power at the number of cases by simulation."""
    for only_a, only_b in ((0, 0), (0, 5), (3, 9), (7, 7), (40, 61)):
        n, least = only_a + only_b, min(only_a, only_b)
        tail = 2 * sum(comb(n, k) for k in range(least + 1)) / 2**n
        assert paired(only_a, only_b, 200)["p"] == pytest.approx(min(1.0, tail) if n else 1.0)
    assert paired(5, 5, 50)["needed"] is None
    found = paired(10, 25, 200)
    random = np.random.default_rng(0)
    draws = random.multinomial(found["needed"], [10 / 200, 25 / 200, 165 / 200], 4000)
    z = (draws[:, 1] - draws[:, 0]) / np.sqrt(draws[:, :2].sum(1))
    assert (z > norm.ppf(0.975)).mean() == pytest.approx(0.8, abs=0.03)


def test_intervals_cover_the_difference():
    """In 93% to 98% of simulated comparisons of 60 cases."""
    random = np.random.default_rng(1)
    for only_a, only_b in ((0.05, 0.2), (0.1, 0.1), (0.02, 0.3)):
        draws = random.multinomial(60, [only_a, only_b, 1.0 - only_a - only_b], 500)
        ends = np.array([paired(int(a), int(b), 60)["interval"] for a, b, _ in draws])
        covered = (ends[:, 0] <= only_b - only_a) & (ends[:, 1] >= only_b - only_a)
        assert 0.93 <= covered.mean() <= 0.985


def test_shares_have_wilson_intervals():
    """As scipy has them."""
    row = {"axis": "mass", "grade": 1, "fallback": False, "success_once": 1}
    found = shares([{**row, "success": i < 3} for i in range(10)])
    wilson = binomtest(3, 10).proportion_ci(0.95, "wilson")
    assert [one["success"] for one in found] == [0.3, 0.3]
    assert found[0]["interval"] == pytest.approx((wilson.low, wilson.high), abs=1e-5)


def test_files_that_do_not_belong_together_are_refused(tmp_path: Path):
    """Rows of another suite, and a run that has not ended."""
    a = write(tmp_path / "a.jsonl", [1, 0, 1])
    with pytest.raises(ArgumentError, match="should have the same cases"):
        compare(a, write(tmp_path / "b.jsonl", [1, 0, 1], of="b"))
    with pytest.raises(ArgumentError, match=r"has 3 of 9 cases. Finish it"):
        compare(a, write(tmp_path / "b.jsonl", [1, 0, 1], rows=9))


def test_a_plot_has_a_panel_for_each_axis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """And a line for each policy. Without Matplotlib, the extra is named."""
    pytest.importorskip("matplotlib", reason="needs the extra 'plots'")
    rows = [{"axis": "mass", "grade": g, "success": 0.5, "interval": (0.2, 0.8)} for g in (1, 2)]
    plot({"a": rows, "b": rows}, tmp_path / "one.png")
    rows += [{**row, "axis": "shift"} for row in rows]
    plot({"a": rows, "b": rows}, tmp_path / "two.png")
    widths = [Image.open(tmp_path / name).width for name in ("one.png", "two.png")]
    assert widths[0] < widths[1]
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtraError, match=r"\[plots\]"):
        comparing.plot({"a": rows}, tmp_path / "three.png")
