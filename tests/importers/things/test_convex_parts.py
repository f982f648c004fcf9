"""Convex parts: hulls where they do, CoACD where they do not, and a cup that keeps its hole."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from sceniris_gym.errors import PartsError
from sceniris_gym.importers.things.convex_parts import convex_parts, small_hull
from sceniris_gym.importers.things.fit import tolerance_of
from sceniris_gym.importers.things.repair import repair
from tests.importers.things.shapes import box, cup, surface


def test_something_convex_is_one_part():
    """Without CoACD."""
    parts = convex_parts(repair([surface(box())], "box"), "box")
    assert len(parts.meshes) == 1
    assert parts.fit.error < 1e-6
    assert parts.tolerance == 0.002


def test_pieces_that_are_convex_are_a_part_each():
    """Two boxes far apart."""
    far = box().apply_translation([0.5, 0, 0])
    parts = convex_parts(repair([surface(box()), surface(far)], "pair"), "pair")
    assert len(parts.meshes) == 2
    assert parts.method == "2 x hull"


def test_a_cup_keeps_its_hole():
    """No point well inside of its hollow is in any part, and the error keeps what is promised."""
    pytest.importorskip("coacd", reason="coacd is not installed (extra 'import')")
    mesh = cup()
    parts = convex_parts(repair([surface(mesh)], "cup"), "cup")
    assert parts.fit.error <= parts.tolerance == tolerance_of(mesh)
    angles = np.radians(np.arange(0, 360, 60))
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(6)], axis=1)
    hollow = np.concatenate([r * ring + [0, 0, z] for r in (0.0, 0.015, 0.028) for z in (0.02, 0.05, 0.085)])
    for part in parts.meshes:
        planes = ConvexHull(part.vertices).equations
        assert (hollow @ planes[:, :3].T + planes[:, 3]).max(axis=1).min() > 0.0


def test_where_nothing_fits_the_best_is_told(monkeypatch: pytest.MonkeyPatch):
    """With how far it is off."""
    monkeypatch.setattr("sceniris_gym.importers.things.convex_parts._cut", lambda *arguments: [])
    with pytest.raises(PartsError, match=r"cup: its best convex parts, 1 by 1 x hull, are 3\d mm off.*--tolerance"):
        convex_parts(repair([surface(cup())], "cup"), "cup")


def test_a_hull_of_many_vertices_is_thinned():
    """And stays inside of the ball, near to it."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    hull = small_hull(ball.vertices)
    assert len(hull.vertices) <= 200
    assert 0.95 < hull.volume / ball.volume <= 1.0
