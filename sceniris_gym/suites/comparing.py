"""Shares of success by axis and grade, and paired comparisons of two policies on the same cases."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sceniris_gym.errors import ArgumentError, import_extra
from sceniris_gym.files import replacing
from sceniris_gym.suites.running import read_rows
from sceniris_gym.training.settings import success_interval

Rows = Sequence[Mapping[str, Any]]
_Z95, _Z80 = 1.959963984540054, 0.8416212335729143
"""Quantiles of the normal distribution at 97.5% and 80%."""


def shares(rows: Rows, measure: str = "success") -> list[dict[str, Any]]:
    """Return the share of success with its 95% Wilson interval, for all cases and for each axis and grade.

    `measure` is "success" (at the last step) or "success_once" (at any step). Layouts from the bank do not count.
    """
    return [
        {**part, "cases": len(some), "success": wins / max(1, len(some)), "interval": success_interval(wins, len(some))}
        for part, some in _parts(rows)
        for wins in (sum(row[measure] for row in some),)
    ]


def compare(first: Path, second: Path, measure: str = "success") -> list[dict[str, Any]]:
    """Return the paired difference of two policies, for all cases and for each axis and grade.

    Each result has `cases`, the shares `a` and `b`, and the results of `paired`.

    Raises:
        ArgumentError: A file has another form or lacks rows, or the files have different cases.
    """
    (one, rows), (other, more) = read_rows(first), read_rows(second)
    for path, head, found in ((first, one, rows), (second, other, more)):
        if len(found) != head["rows"]:
            raise ArgumentError(f"{path}: has {len(found)} of {head['rows']} cases. Finish it with 'suite run'.")
    if one.get("of") != other.get("of") or [r["id"] for r in rows] != [r["id"] for r in more]:
        raise ArgumentError(f"{first} and {second}: should have the same cases, got rows of two suites.")
    both = [{**a, "b": b[measure], "fallback": a["fallback"] or b["fallback"]} for a, b in zip(rows, more, strict=True)]
    found = []
    for part, some in _parts(both):
        a, b = (sum(row[key] for row in some) / max(1, len(some)) for key in (measure, "b"))
        only = (sum(row[measure] > row["b"] for row in some), sum(row[measure] < row["b"] for row in some))
        found.append({**part, "cases": len(some), "a": a, "b": b, **paired(*only, len(some))})
    return found


def paired(only_a: int, only_b: int, number: int) -> dict[str, Any]:
    """Return the paired difference b - a of two shares, from the numbers of cases that only one policy solved.

    `interval` is the 95% interval of Bonett and Price (2012), and `p` the two-sided p-value of McNemar's exact test.
    `needed` is the number of cases for a power of 80% at a significance level of 5% (Connor 1987), if shares of cases
    that only one policy solves stay the same. It is None for equal numbers.
    """
    from scipy.stats import binomtest  # takes a second to import

    a, b = (only_a + 1) / (number + 2), (only_b + 1) / (number + 2)
    half = _Z95 * math.sqrt((a + b - (b - a) ** 2) / (number + 2))
    differ, gap, needed = only_a + only_b, (only_b - only_a) / max(1, number), None
    if gap:
        spread = _Z95 * math.sqrt(differ / number) + _Z80 * math.sqrt(differ / number - gap**2)
        needed = math.ceil((spread / gap) ** 2)
    p = float(binomtest(only_a, differ).pvalue) if differ else 1.0
    ends = (max(-1.0, b - a - half), min(1.0, b - a + half))
    return {"only_a": only_a, "only_b": only_b, "difference": gap, "interval": ends, "p": p, "needed": needed}


def plot(found: Mapping[str, Rows], path: Path) -> None:
    """Draw shares of success over grades, one panel per axis and one line per policy, as a PNG.

    `found` has the results of `shares` by the name of the policy.

    Raises:
        MissingExtraError: Matplotlib is not installed.
    """
    figure = import_extra("matplotlib.figure", "plots", "matplotlib").Figure
    axes = list(dict.fromkeys(row["axis"] for one in found.values() for row in one if row["grade"])) or ["nominal"]
    drawn = figure(figsize=(2.2 * len(axes) + 1.0, 3.2), layout="constrained")
    panels = drawn.subplots(1, len(axes), sharey=True, squeeze=False)[0]
    for panel, axis in zip(panels, axes, strict=True):
        for k, (name, one) in enumerate(found.items()):
            some = [row for row in one if row["axis"] in (axis, "nominal") and row["grade"] is not None]
            success, ends = np.array([row["success"] for row in some]), np.array([row["interval"] for row in some]).T
            grades = np.array([row["grade"] for row in some])
            panel.errorbar(grades + 0.15 * k, success, np.abs(ends - success), marker="o", capsize=2.0, label=name)
            panel.set(title=axis, xlabel="grade", ylim=(-0.03, 1.03), xticks=grades)
    panels[0].set_ylabel("success, 95% intervals")
    drawn.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=len(found), frameon=False)
    with replacing(path) as file:
        drawn.savefig(file, format="png")


def _parts(rows: Rows) -> Iterator[tuple[dict[str, Any], Rows]]:
    """Yield all valid rows, then the rows of each axis, and of each of its grades."""
    valid = [row for row in rows if not row["fallback"]]
    yield {"axis": "all", "grade": None}, valid
    for axis in dict.fromkeys(row["axis"] for row in rows):
        grades = sorted({row["grade"] for row in rows if row["axis"] == axis})
        for grade in (None, *grades) if len(grades) > 1 else grades:
            some = [row for row in valid if row["axis"] == axis and grade in (None, row["grade"])]
            yield {"axis": axis, "grade": grade}, some
