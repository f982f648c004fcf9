"""The benchmark of arms from outside, on an arm of this package, which stands in for one of a public package."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.stress import arms

ASSETS = Path(__file__).parents[2] / "assets"


@pytest.fixture
def arm(monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the name under which the benchmark knows the shipped arm, by its file."""
    monkeypatch.setitem(arms.ARMS, "own", arms.Arm("ours", "assets/ur5e.xml", "tcp", 0.7))
    return "own"


def test_an_arm_that_hangs_upside_down_is_measured(arm: str):
    """Few poses and layouts: verdicts agree, nothing penetrates, every claim of reach holds."""
    row = arms.measure(arm, ASSETS.parent, "upside down", poses=8, layouts=20, device="cpu")
    assert (row["tier"], row["joints"], row["penetrating"], row["unreached"]) == ("ik", 6, 0, 0)
    assert row["right"] == 1.0


def test_an_arm_whose_map_decides_is_measured(arm: str):
    """By the map of the shipped arm: verdicts are compared with kinematics alone, and layouts are made by it."""
    row = arms.measure(
        arm, ASSETS.parent, "floor", poses=40, layouts=20, device="cpu", map_file=ASSETS / "maps/ur5e.reach"
    )
    assert (row["tier"], row["penetrating"], row["unreached"]) == ("map", 0, 0)
    assert row["right"] >= 0.95
    assert row["reached"] >= 20
