"""Half-planes around relations: they are resolved for the right candidates, on level supports, and hold the region."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.wave.search import Workspace, default_size
from sceniris_gym.layout.wave.sides import Regions, launch_build_sides
from sceniris_gym.program.device import Cause
from tests.layout.related import Shapes, near_middle, related, scene
from tests.layout.sizes import made

N = 60
LOW, HIGH = 0.1, 0.3


@pytest.fixture
def generator(tmp_path: Path) -> LayoutGenerator:
    """Worlds after one wave, whose candidates stand on a slab in a ring around an anchor that differs by world."""
    shapes = Shapes(tmp_path, airy=True)
    objects = {"a": near_middle(shapes.cube), "slab": {"asset": shapes.slab, "kind": "fixture", "on": "floor"}}
    ring = {"near": "a", "distance": {"min": LOW, "max": HIGH}}
    compiled = scene({**objects, "q": related(shapes.cube, ring, on="slab")}, attempts=1, restarts=0)
    generator = LayoutGenerator(compiled, N, seed=5, size=replace(default_size("cpu"), candidates=N))
    generator.generate()
    search = generator._work.search
    assert (search.obj.numpy() == compiled.placed.index("q")).all()
    search.candidates.fill_(N)  # the end of a wave sets it to 0
    search.cause.zero_()
    regions = generator._regions
    regions.cuts.zero_()
    regions.regions.zero_()
    return generator


def _with_lanes(generator: LayoutGenerator, lanes: int) -> Workspace:
    """Return the arrays of a generator, for launches of so many lanes."""
    return replace(generator._work, size=replace(generator.size, lanes=lanes))


def _listed(regions: Regions) -> list[int]:
    return sorted(regions.cut.numpy()[: regions.cuts.numpy()[0]].tolist())


@pytest.mark.parametrize("lanes", [1, 7, 1000])
def test_candidates_on_level_supports_are_listed(generator: LayoutGenerator, lanes: int):
    """A support that leans by more than 0.1 degree carries nothing; a candidate that has failed is left alone."""
    search, view, compiled = generator._work.search, generator.layouts.view, generator.compiled
    row = search.row.numpy()
    lean = np.radians(np.tile([0.0, 0.08, 0.12, 1.0], N // 4))
    quats = view.body_quat.numpy()
    quats[row, compiled.mjm.body("slab").id] = np.stack([np.cos(lean / 2), np.sin(lean / 2), 0 * lean, 0 * lean], 1)
    view.body_quat.assign(quats)
    failed = np.arange(N) % 5 == 0
    search.cause.assign(np.where(failed, Cause.COLLISION, Cause.NONE))
    regions: Any = generator._regions
    launch_build_sides(_with_lanes(generator, lanes), regions)
    level = lean < np.radians(0.1)
    assert _listed(regions) == np.flatnonzero(level & ~failed).tolist()
    expected = np.where(failed, Cause.COLLISION, np.where(level, Cause.NONE, Cause.EMPTY))
    assert (search.cause.numpy() == expected).all()
    assert (regions.pieces.numpy()[level & ~failed] == 0).all()


def test_half_planes_hold_the_region_of_each_world(generator: LayoutGenerator):
    """Points in the ring around a world's anchor are in at least one of the pieces, points far outside in none."""
    search, view, compiled = generator._work.search, generator.layouts.view, generator.compiled
    regions: Any = generator._regions
    launch_build_sides(_with_lanes(generator, 3), regions)
    assert _listed(regions) == list(range(N))
    program, obj = compiled.program, compiled.placed.index("q")
    rel = int(program.obj_reladr.numpy()[obj])
    pieces, first = int(program.rel_piecenum.numpy()[rel]), int(program.rel_sideadr.numpy()[rel])
    anchors = view.body_pos.numpy()[search.row.numpy(), compiled.mjm.body("a").id, :2]
    assert np.ptp(anchors, axis=0).min() > 0.03
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (2000, 2))
    for c in range(N):
        sides = regions.sides.numpy()[c, first : first + pieces * regions.side_num.numpy()[c, 0]].reshape(pieces, -1)
        inside = np.zeros(len(points), int)
        for piece in sides:
            along = (points[:, None] - piece["origin"]) * piece["normal"]
            inside += (along.sum(axis=2) <= piece["offset"] + 1e-6).all(axis=1)
        distance = np.linalg.norm(points - anchors[c], axis=1)
        assert (inside[(distance > LOW) & (distance < HIGH)] >= 1).all()
        assert (inside[(distance < 0.8 * LOW) | (distance > 1.2 * HIGH)] == 0).all()


NEAR = {"near": "a", "distance": {"max": HIGH}}
NEAR_BY_BOUNDS = {**NEAR, "measure": "bounds"}
DRAWN = {"joints": {"slide": {"range": [0.0, 0.2]}}}
# a relation of an object, its shape and its other words, and whether candidates of a row share a region
SHARED: dict[str, tuple[dict[str, Any], str, dict[str, Any], bool]] = {
    "near": (NEAR, "bar", {}, True),
    "near by bounds, in stable poses": (NEAR_BY_BOUNDS, "bar", {"orientation": "stable"}, True),
    "near by bounds, in any pose": (NEAR_BY_BOUNDS, "bar", {"orientation": "any"}, False),
    "near by bounds, with a drawer": (NEAR_BY_BOUNDS, "drawer", DRAWN, False),
    "between, as wide as it is, in stable poses": ({"between": ["a", "b"]}, "bar", {"orientation": "stable"}, True),
    "beside": ({"beside": "a", "side": "left"}, "bar", {}, False),
}


@pytest.mark.parametrize("name", SHARED)
def test_candidates_of_a_row_share_only_the_region_that_each_would_have(name: str, tmp_path: Path):
    """Their layouts have the bits of one candidate at a time, for which nothing is shared."""
    relation, shape, words, is_shared = SHARED[name]
    shapes = Shapes(tmp_path)
    own = related(getattr(shapes, shape), relation, **words)
    compiled = scene({"a": near_middle(shapes.cube), "b": near_middle(shapes.bar, 0.3), "q": own}, attempts=20)
    size = replace(default_size("cpu"), candidates=20 * N, busy=20 * N)
    by_region = []

    def launch(work: Workspace, regions: Regions) -> None:
        launch_build_sides(work, regions)
        by_region.append(len(_listed(regions)) / max(int(regions.regions.numpy()[0]), 1))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sceniris_gym.layout.wave.points.launch_build_sides", launch)
        together = made(compiled, size, N)
    assert (max(by_region) > 3) == is_shared
    assert together == made(compiled, None, N)
