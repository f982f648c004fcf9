"""Hostile models are placed without a conflict, or refused by an error that names an element of them."""

from __future__ import annotations

from functools import cache

import pytest

from tests.generators.hostile_features import FEATURES
from tests.generators.hostile_models import make
from tests.stress.hostile import try_model
from tests.versions import OLD

CANDIDATES = 200
"""Seeds from which the sample is taken."""


@cache
def sample(size: int) -> tuple[int, ...]:
    """The seeds that have the most features between them, each next one by what it adds."""
    features = {seed: make(seed).features for seed in range(CANDIDATES)}
    found: list[int] = []
    for _ in range(size):
        had = {feature for seed in found for feature in features[seed]}
        found.append(max((s for s in features if s not in found), key=lambda s: (len(features[s] - had), -s)))
    return tuple(found)


def test_the_sample_has_most_features():
    """All that the models have between them, but for what is rare."""
    had = {feature for seed in sample(12) for feature in make(seed).features}
    assert len(had) > 0.8 * len(FEATURES)


@pytest.mark.parametrize("number", range(12))
def test_hostile_models_are_placed_or_refused_by_name(number: int):
    """Sixteen layouts each, judged by MuJoCo C; `python -m tests.stress.hostile --show SEED` writes one to a folder."""
    outcome = try_model(sample(12)[number], 16)
    if OLD and "with MULTICCD enabled" in str(outcome):
        pytest.skip("MuJoCo before 4.0: mujoco_warp takes no margins with MULTICCD")
    assert outcome.verdict in ("placed", "refused"), outcome
    assert outcome.conflicts == {}, outcome
