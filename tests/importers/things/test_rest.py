"""Resting: a box rests on each side and tips over on an edge."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from sceniris_gym.importers.things.importer import import_thing
from sceniris_gym.importers.things.rest import STILL, moved, resting_poses, stands
from tests.importers.things.shapes import box, write


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the asset of a box."""
    folder = tmp_path_factory.mktemp("block")
    import_thing(write(box(), folder / "block.obj"), folder / "out" / "block.xml")
    return folder / "out" / "block.xml"


def test_a_box_rests_on_its_six_sides(block: Path):
    """More often on the wide ones, and hardly moves."""
    rests = resting_poses(block)
    assert len(rests) == 6
    assert all(rest.moved < STILL for rest in rests)
    assert sum(rest.probability for rest in rests) == pytest.approx(1.0)
    assert all(stands(rests, sign * axis) for axis in np.eye(3) for sign in (-1, 1))
    assert not stands(rests, np.array([0.6, 0.8, 0.0]))


def test_a_box_on_its_edge_tips_over(block: Path):
    """A box that is put down on its edge moves more than a centimetre."""
    assert moved(block, np.array([np.cos(0.3), np.sin(0.3), 0.0, 0.0])) > STILL


def test_a_ball_has_corners_and_rests_on_its_facets(tmp_path: Path):
    """As its convex part is a polyhedron: it is held where it is put down."""
    manifest = import_thing(write(trimesh.creation.icosphere(4, 0.05), tmp_path / "ball.stl"), tmp_path / "ball.xml")
    assert manifest["parts"] == 1
    assert manifest["rests"]
    assert all(rest["moved_mm"] < 1000.0 * STILL for rest in manifest["rests"])
