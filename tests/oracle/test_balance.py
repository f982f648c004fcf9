"""Statics of layouts by hand: levers, legs over an edge, and what rolls; MuJoCo C agrees with each of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from tests.audit.stacks import BALL, GAP, TOP, Things, auditor, cubes, post, stool, table, table_at_an_edge
from tests.oracle.balance import Balance


def judged(things: Things, geometry: str = "physics", **words: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """Return what falls by statics, and what moves by MuJoCo C."""
    judge, rows = auditor(things, geometry, **words), table(things)
    moved = judge.judge(rows, settled=1).moved
    return [name for _, name in Balance(judge).falling(rows)], [name for name, n in moved.items() if n]


def test_a_tower_stands_as_long_as_every_level_does():
    """Each cube may be over the one below, and all of them together too far out."""
    assert judged(cubes(0.0, 0.005, 0.01)) == ([], [])
    falls, moved = judged(cubes(0.0, 0.02, 0.04, 0.06))  # each by less than half of its width
    assert falls == ["a", "b", "c"]
    assert {"b", "c", "d"} <= set(moved)


@pytest.mark.parametrize(("x", "falls"), [(0.0, []), (0.02, []), (0.09, ["stool"])])
def test_a_load_on_an_overhang_tips_what_carries_it(x: float, falls: list[str]):
    """The stool falls, not the brick, which has all of its foot on the seat."""
    found, moved = judged(stool(x))
    assert found == falls
    assert bool(moved) == bool(falls)


@pytest.mark.parametrize(("x", "falls"), [(0.12, []), (0.145, []), (0.17, ["table"])])
def test_legs_over_an_edge_carry_nothing(x: float, falls: list[str]):
    """Two of four legs are on a slab that ends at 0.2 m, partly on it, or beyond it."""
    assert judged(table_at_an_edge(x)) == (falls, falls)


@pytest.mark.parametrize(("lean", "falls"), [(0.0, []), (0.03, ["post"])])
def test_what_carries_may_end_above_what_is_seen(lean: float, falls: list[str]):
    """A post stands on a collider that ends 1.5 mm above its mesh, below its centre of mass or beside it."""
    assert judged(post(lean), "visual") == (falls, falls)


def test_drawn_masses_are_left_to_the_test_of_standing():
    """A brick that tips the stool by the masses of the model may not do so by those of its episode."""
    assert judged(stool(0.09), brick={"randomize": {"mass": {"scale": [0.1, 1.0]}}})[0] == []
    assert judged(stool(0.09), brick={"randomize": {"friction": {"scale": [0.1, 1.0]}}})[0] == ["stool"]


def test_what_rolls_stands_and_what_stands_on_its_tip_too():
    """Neutral or not, the centre of mass is over the patch; MuJoCo C has the last word."""
    assert judged({"ball": (BALL, "floor", (0.0, 0.0, GAP))}) == ([], [])
    assert judged({"top": (TOP, "floor", (0.0, 0.0, GAP))})[0] == []


def test_what_need_not_stand_is_not_judged():
    """By `stands: false` and in any orientation; what it carries is judged for itself."""
    tower = cubes(0.0, 0.02, 0.04, 0.06)
    for words in ({"stands": False}, {"orientation": "any"}):
        assert judged(tower, b=words)[0] == ["c"]
