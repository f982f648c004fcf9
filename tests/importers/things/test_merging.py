"""Merging: parts of something convex become one, and a step stays two."""

from __future__ import annotations

from sceniris_gym.importers.things.fit import Measure
from sceniris_gym.importers.things.merging import merge
from tests.importers.things.shapes import box


def test_slices_of_a_box_become_the_box():
    """Their common hull adds nothing."""
    slices = [box((0.04, 0.06, 0.025)).apply_translation([0, 0, -0.0375 + 0.025 * i]) for i in range(4)]
    merged = merge(slices, Measure(box(), 0.002).beyond, 0.002)
    assert len(merged) == 1
    assert abs(merged[0].volume - box().volume) < 1e-9


def test_an_edge_between_two_parts_is_kept():
    """The hull of an L would fill its corner by more than is allowed."""
    upright, foot = box((0.02, 0.06, 0.1)), box((0.08, 0.06, 0.02)).apply_translation([0.05, 0, -0.04])
    whole = upright + foot
    assert len(merge([upright, foot], Measure(whole, 0.002).beyond, 0.002)) == 2
