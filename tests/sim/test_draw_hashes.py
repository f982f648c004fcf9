"""Drawn physics, parameters and factors keep their bits from one version to the next."""

from __future__ import annotations

import json

import pytest

from tests.layout.layout_hashes import processor
from tests.sim.draw_hashes import CASES, FILE, draw_hashes
from tests.versions import since_4

KEPT = json.loads(FILE.read_text())


@since_4("its compiler rounds otherwise, and bits are promised per version")
@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
@pytest.mark.parametrize("case", CASES)
def test_what_is_drawn_keeps_its_bits(case: str, device: str):
    """On a CPU and on a GPU. Where a change is meant, write the file anew and say in CHANGELOG.md what changed."""
    if processor() != KEPT["processor"]:
        pytest.skip(f"the hashes were made on '{KEPT['processor']}', and bits differ on '{processor()}'")
    assert draw_hashes(case, device) == KEPT["cases"][case]


def test_every_case_has_its_hashes():
    """A new case gets lines, and one that is gone has none."""
    assert set(KEPT["cases"]) == set(CASES)
