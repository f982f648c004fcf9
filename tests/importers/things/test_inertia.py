"""Mass and inertia: those of a box by formula, and of overlapping pieces without counting anything twice."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.importers.things.convex_parts import convex_parts
from sceniris_gym.importers.things.inertia import inertia_of
from sceniris_gym.importers.things.repair import repair
from tests.importers.things.shapes import box, surface


def test_a_box_has_the_inertia_of_a_box():
    """M (b^2 + c^2) / 12 about each axis."""
    solid = repair([surface(box((0.1, 0.2, 0.3)))], "box")
    found = inertia_of(solid, convex_parts(solid, "box"), 1000.0, "box")
    assert found.mass == pytest.approx(6.0)
    np.testing.assert_allclose(found.matrix.diagonal(), 0.5 * np.array([0.13, 0.10, 0.05]), rtol=1e-6)
    np.testing.assert_allclose(found.center, 0.0, atol=1e-9)


def test_what_overlaps_counts_once():
    """Two boxes that share half of their volume weigh one and a half."""
    other = box((0.1, 0.1, 0.1)).apply_translation([0.05, 0, 0])
    solid = repair([surface(box((0.1, 0.1, 0.1))), surface(other)], "pair")
    found = inertia_of(solid, convex_parts(solid, "pair"), 1000.0, "pair")
    assert found.mass == pytest.approx(1.5, rel=1e-6)
    np.testing.assert_allclose(found.center, [0.025, 0, 0], atol=1e-7)
