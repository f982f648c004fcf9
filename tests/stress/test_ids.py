"""Ids come back to the bit, and a bit that differs is found."""

from __future__ import annotations

from collections import Counter

import numpy as np

from tests.stress.id_ways import BACK
from tests.stress.ids import Outcome, differing, report, total


def test_a_bit_that_differs_is_found():
    """By name, whatever else is equal; NaN equals itself, and numbers are compared as the kind that was served."""
    served = {"qpos": np.array([[0.0, np.nan], [1.0, 2.0]], np.float32), "start": np.array([0, 1])}
    found = {name: rows[::-1].copy() for name, rows in served.items()} | {"start": np.array([1, 0], np.int32)}
    assert [differing(served, world, found, 1 - world) for world in (0, 1)] == [[], []]
    found["qpos"][1, 0] = -0.0
    assert differing(served, 0, found, 1) == ["qpos"]


def test_a_report_counts_ids_by_way_and_status():
    """With and without params; the first that differs is told."""
    one = Outcome("1", counts=Counter({"replay valid equal": 3, "replay fallback refused": 1}))
    two = Outcome("2", params=True, counts=Counter({"replay fallback differs": 2}), first={"replay fallback": "an id"})
    lines = [line.split() for line in report([one, two])]
    assert ["replay", "valid", "3", "0", "0"] in lines and ["replay", "fallback", "0", "1", "0"] in lines
    assert ["replay", "fallback", "params", "0", "0", "2"] in lines
    assert ["2:", "replay", "fallback:", "an", "id"] in lines
    assert len(lines) == 1 + 4 * len(BACK) + 2 and sum(total([one, two]).values()) == 6
