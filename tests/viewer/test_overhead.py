"""Overhead over supports, judged by rays of MuJoCo C that go straight up."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import shapely
from shapely.geometry import Point

from sceniris_gym.program.device import Cover
from sceniris_gym.viewer.overhead import cover_over, is_covered_rightly
from sceniris_gym.viewer.regions import regions_left
from sceniris_gym.viewer.shown import ShownWorld
from tests.viewer.worlds_on_show import world_of

_UP = np.array([0.0, 0.0, 1.0])


def is_covered(world: ShownWorld, bodies: list[int], at: np.ndarray) -> bool:
    """Return whether a ray up from a point meets something of some bodies that collides."""
    mjm, data = world.compiled.mjm, world.data
    solid = np.flatnonzero(np.isin(mjm.geom_bodyid, bodies) & ((mjm.geom_contype | mjm.geom_conaffinity) > 0))
    distances = [
        mujoco.mj_rayMesh(mjm, data, g, at, _UP, np.zeros(3))
        if mjm.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH
        else mujoco.mju_rayGeom(
            data.geom_xpos[g], data.geom_xmat[g], mjm.geom_size[g], at, _UP, mjm.geom_type[g], np.zeros(3)
        )
        for g in solid
    ]
    return max(distances, default=-1.0) >= 0.0


@pytest.mark.parametrize("scene", ["mid", "kitchen"])
def test_a_roof_is_where_a_ray_up_meets_something(scene: str):
    """At random points over the supports of all objects that ask for cover, or for none, away from its rims."""
    rng, judged = np.random.default_rng(0), [0, 0]
    world = world_of(scene, 1)
    for name in world.placed_names:
        placed = world.placed(name)
        if placed.cover == Cover.EITHER:
            continue
        assert placed.support is not None
        assert placed.support.owner is not None
        parent = world.compiled.scene.subtree(placed.support.owner)
        for surface in placed.surfaces[0]:
            mat, pos = world.data.xmat[surface.body].reshape(3, 3), world.data.xpos[surface.body]
            x0, y0, x1, y1 = surface.outline.bounds
            for x, y in rng.uniform((x0, y0), (x1, y1), (60, 2)):
                at = mat @ [x, y, surface.height] + pos
                cover = cover_over(world, placed, float(at[2]))
                if shapely.distance(cover.boundary, Point(at[:2])) > 1e-3:
                    covered = cover.contains(Point(at[:2]))
                    assert covered == is_covered(world, parent, at + [0.0, 0.0, 2e-4]), f"{name} at {at}"
                    judged[covered] += 1
    assert min(judged) >= 10


def test_a_region_is_cut_as_the_word_asks():
    """The inside of the cabinet's drawer is covered; an object that stands in the open part has the rest."""
    world = world_of("mid", 1)
    banana = world.placed("banana")
    assert banana.cover != Cover.EITHER
    ((_, left, height),) = [found for found in regions_left(world, "banana") if not found[1].is_empty]
    around = left.envelope.buffer(0.1)
    cover = cover_over(world, banana, height)
    kept = is_covered_rightly(world, banana, around, height)
    other = around.difference(cover) if banana.cover == Cover.OPEN else around.intersection(cover)
    assert shapely.symmetric_difference(kept, other).area < 1e-9
    assert 0.0 < kept.area < around.area
