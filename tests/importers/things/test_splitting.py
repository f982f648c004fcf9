"""Splitting: none of a solid is lost, and no more of its slots is filled than is allowed."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from sceniris_gym.errors import MissingExtraError
from sceniris_gym.importers.things.splitting import Excess, hull_of, manifold_of, mesh_of, small_hull, split, union_of
from tests.importers.things.shapes import box

pytest.importorskip("manifold3d", reason="manifold3d is not installed (extra 'import')")
_ALLOWED = 0.002
_BLOCK, _SLOT = (0.1, 0.08, 0.06), (0.012, 0.2, 0.04)


def turned(yaw: float) -> np.ndarray:
    """Return the pose of the slot, open at the top and at both ends, at an angle, as a 4x4 matrix."""
    return trimesh.transformations.rotation_matrix(yaw, [0, 0, 1]) @ trimesh.transformations.translation_matrix(
        [0.01, 0.0, 0.02]
    )


def slotted(yaw: float) -> trimesh.Trimesh:
    """A block with a slot at an angle."""
    return trimesh.boolean.difference([box(_BLOCK), box(_SLOT).apply_transform(turned(yaw))], engine="manifold")


def inside(parts: list[trimesh.Trimesh], points: np.ndarray, margin: float) -> np.ndarray:
    """Return which points (n, 3) are in any of the parts grown by a margin [m], by qhull's planes."""
    planes = [ConvexHull(part.vertices).equations for part in parts]
    return np.any([(points @ p[:, :3].T + p[:, 3]).max(axis=1) <= margin for p in planes], axis=0)


@pytest.mark.parametrize("yaw", [0.0, 0.3, 0.7, 1.2])
def test_a_slot_stays_free_and_nothing_is_lost(yaw: float):
    """Begun with the hull, whatever the angle of the slot."""
    mesh = slotted(yaw)
    parts = split([mesh.convex_hull], Excess(manifold_of(mesh), mesh, _ALLOWED), 50)
    assert 3 <= len(parts) <= 8
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (20_000, 3)) * _BLOCK
    in_slot = trimesh.transform_points(points, np.linalg.inv(turned(yaw)))
    beyond_walls = np.max(np.abs(in_slot) - 0.5 * np.array(_SLOT), axis=1)
    in_block = points[beyond_walls > 0.0]
    assert inside(parts, in_block, 1e-6).all()
    well_in_slot = points[beyond_walls < -1.01 * _ALLOWED]
    assert len(well_in_slot) > 500
    assert not inside(parts, well_in_slot, 0.0).any()


def test_too_many_parts_are_not_made():
    """The rest still sticks out, as it did before."""
    mesh = slotted(0.3)
    excess = Excess(manifold_of(mesh), mesh, _ALLOWED)
    parts = split([mesh.convex_hull], excess, 0)
    assert len(parts) == 2
    assert max(excess.of(part)[0] for part in parts) > _ALLOWED


def test_what_fits_is_not_split():
    """A box within a box sticks out of nothing."""
    parts = [box((0.02, 0.02, 0.02)), box((0.04, 0.06, 0.1009))]
    kept = split(parts, Excess(manifold_of(box()), box(), 0.001), 50)
    assert [id(part) for part in kept] == [id(part) for part in parts]


def test_excess_is_how_far_the_farthest_place_sticks_out():
    """And where that is."""
    high = box((0.04, 0.06, 0.12)).apply_translation([0.0, 0.0, 0.01])
    away, where = Excess(manifold_of(box()), box(), _ALLOWED).of(high)
    assert away == pytest.approx(0.02, rel=1e-3)
    assert where[2] == pytest.approx(0.07, abs=1e-6)


def test_what_another_part_covers_sticks_out_too():
    """It is to be split all the same."""
    high = box((0.04, 0.06, 0.12))
    assert Excess(manifold_of(box()), box(), _ALLOWED).beyond(high, [high]) == pytest.approx(0.01, rel=1e-3)


def test_a_hull_of_nearly_flat_faces_is_a_solid():
    """Though its triangles, needles among them, need not be a manifold."""
    rng = np.random.default_rng(0)
    bumps = np.concatenate(
        [box().vertices, np.stack([*rng.uniform(-0.02, 0.02, (2, 500)), np.full(500, 0.05)], axis=1)]
    )
    bumps[8:, 2] += 1e-9 * rng.random(500)
    hull = small_hull(bumps)
    assert hull_of(hull.vertices).volume() == pytest.approx(float(box().volume), rel=1e-4)


def test_a_union_covers_its_solids_once():
    """Two boxes that overlap by half."""
    both = union_of([manifold_of(box()), manifold_of(box().apply_translation([0.02, 0.0, 0.0]))])
    assert mesh_of(both).volume == pytest.approx(1.5 * box().volume)


def test_an_open_mesh_is_no_solid():
    """An empty one is returned."""
    sheet = trimesh.Trimesh(box().vertices, box().faces[:-2], process=False)
    assert manifold_of(sheet).is_empty()


def test_without_manifold3d_the_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    """As everything that the importer needs beyond the package itself."""
    monkeypatch.setitem(sys.modules, "manifold3d", None)
    with pytest.raises(MissingExtraError, match=r"manifold3d is not installed.*\.\[import\]"):
        manifold_of(box())
