"""The command that judges layouts of variants in scenes of their own."""

from __future__ import annotations

from tests.stress.variants import SCENES, faults, judged


def test_every_choice_of_variants_is_judged_in_a_scene_of_its_own():
    """Two objects with two and three variants, and relations to both: no fault in a hundred layouts."""
    found = dict(judged(SCENES["related"], 100, 0))
    assert len(found) == 6
    assert sum(report.layouts for report in found.values()) == 100
    assert not any(sum(faults(report).values()) for report in found.values())
    assert all(report.kept for report in found.values())
