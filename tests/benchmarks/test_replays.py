"""Layouts that are made before a measurement: they are those that would be made in it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.replays import episodes, replayed
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.training.layout_sources import valid_rows
from tests.training.scenes import reach_scene


@pytest.fixture
def compiled() -> CompiledScene:
    """Return the CompiledScene of TabletopReach-v0."""
    return reach_scene()


def test_valid_layouts_are_replayed_in_turn(compiled: CompiledScene):
    """World with seed s gets row s + episode; two rows of one bank are two layouts."""
    rows = valid_rows(compiled, 3, seed=100)
    assert rows.qpos.shape == (3, compiled.mjm.nq)
    assert len(np.unique(rows.qpos, axis=0)) == 3
    generator = replayed(rows)(compiled, 2)
    generator.reseed(seed=[1, 2])
    for episode in range(4):
        generator.generate()
        expected = rows.qpos[[(1 + episode) % 3, (2 + episode) % 3]]
        np.testing.assert_array_equal(generator.layouts.qpos.numpy(), expected)


def test_replayed_episodes_are_those_that_would_be_made(compiled: CompiledScene):
    """Row i * number + e is episode e of seed i, to the bit."""
    rows = episodes(compiled, [5, 90], 3)
    generator = LayoutGenerator(compiled, 2, seed=[5, 90])
    for episode in range(3):
        generator.generate()
        np.testing.assert_array_equal(generator.layouts.qpos.numpy(), rows.qpos[[episode, 3 + episode]])
