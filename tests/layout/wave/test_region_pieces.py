"""Pieces of a region that relations leave: none is lost by a shortcut, or by the number of lanes that share them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import warp as wp
from shapely.geometry.base import BaseGeometry

from sceniris_gym.config.bounds import MAX_CORNERS
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave import region_pieces
from sceniris_gym.layout.wave.region_pieces import launch_cut_regions
from sceniris_gym.layout.wave.search import Search, default_size
from sceniris_gym.layout.wave.sides import Regions, launch_build_sides, support_pose
from sceniris_gym.placement.polygons import area
from sceniris_gym.program.device import Program
from tests.layout.related import Shapes, related, scene

_CORNERS = wp.constant(MAX_CORNERS)


@wp.kernel(enable_backward=False)
def _cut_all(
    program: Program,
    layouts: LayoutsView,
    search: Search,
    regions: Regions,
    obj: int,
    corner: wp.array3d[wp.vec2],
    out_of_reach: wp.array2d[bool],
    left: wp.array3d[float],
):
    c, k = wp.tid()
    row = search.row[c]
    stable = search.stable_draw[c].stable
    frame = support_pose(program, layouts, row, obj)
    t = region_pieces.posed_triangle(program, program.stable_triadr[stable] + k, frame)
    corner[c, k, 0] = t.a
    corner[c, k, 1] = t.b
    corner[c, k, 2] = t.c
    out_of_reach[c, k] = region_pieces._is_out_of_reach(program, regions, c, obj, t)
    polygon = wp.zeros(shape=(_CORNERS,), dtype=wp.vec2)
    for combination in range(program.obj_cutnum[obj]):
        if not region_pieces._is_surely_empty(program, regions, c, obj, combination, t):
            num = region_pieces.cut_triangle(program, regions, c, obj, combination, t, polygon)
            left[c, k, combination] = area(polygon, num)


def _within(shape: BaseGeometry, sides: np.ndarray) -> BaseGeometry:
    """In double precision: what half-planes (normal, origin, offset) leave of a shape."""
    for side in sides:
        normal = side["normal"].astype(float)
        if normal.any():
            size = np.linalg.norm(normal)
            unit = normal / size
            edge = side["origin"] + unit * float(side["offset"]) / size
            along = np.array([-unit[1], unit[0]])
            square = [
                edge + 50 * along,
                edge - 50 * along,
                edge - 50 * along - 50 * unit,
                edge + 50 * along - 50 * unit,
            ]
            shape = shape.intersection(shapely.Polygon(square))
    return shape


RING = {"near": "a", "distance": {"min": 0.1, "max": 0.3}}
WEDGE = {"right_of": "b", "distance": {"min": 0.05, "max": 0.6}, "angle": 50}
LEFT = {
    "ring": [RING],
    "ring and wedge": [RING, WEDGE],
    "open wedge": [{"front_of": "a"}],
    "wide ring": [{"near": "b", "distance": {"max": 0.9}}],
    "between": [{"between": ["a", "b", "c"]}, WEDGE],
    "beside": [{"beside": "a", "side": "left"}],
}


def _generated(name: str, folder: Path) -> LayoutGenerator:
    """60 worlds after one wave, whose candidates stand on a slab with a region of three triangles."""
    shapes = Shapes(folder, airy=True)
    others: dict[str, Any] = {n: {"asset": shapes.odd, "kind": "fixture", "on": "floor"} for n in "abc"}
    others["slab"] = {"asset": shapes.slab, "kind": "fixture", "on": "floor"}
    lies = {"on": "slab", "region": {"polygon": [[-0.5, -0.4], [0.5, -0.4], [0.3, 0.1], [0.5, 0.4], [-0.4, 0.3]]}}
    compiled = scene({**others, "q": related(shapes.cube, *LEFT[name], **lies)}, attempts=1, restarts=0)
    generator = LayoutGenerator(compiled, 60, seed=5)
    generator.generate()
    assert generator._work.search.rows.numpy()[0] == 60
    generator._work.search.candidates.fill_(60)  # which the end of a wave sets to 0
    return generator


@pytest.mark.parametrize("name", LEFT)
def test_nothing_is_dropped_of_what_relations_leave(name: str, tmp_path: Path):
    """Each triangle within each piece of all relations has the area that shapely finds; what is skipped has none."""
    generator = _generated(name, tmp_path)
    compiled = generator.compiled
    search, program, obj = generator._work.search, compiled.program, compiled.placed.index("q")
    num = 60
    triangles, cuts = int(program.stable_trinum.numpy().max()), int(program.obj_cutnum.numpy()[obj])
    corner = wp.zeros((num, triangles, 3), dtype=wp.vec2, device="cpu")
    skipped = wp.zeros((num, triangles), dtype=bool, device="cpu")
    left = wp.zeros((num, triangles, cuts), dtype=float, device="cpu")
    regions: Any = generator._regions
    inputs = [program, generator.layouts.view, search, regions, obj]
    wp.launch(_cut_all, dim=(num, triangles), inputs=inputs, outputs=[corner, skipped, left], device="cpu")

    adr = int(program.obj_reladr.numpy()[obj])
    relations = range(adr, adr + int(program.obj_relnum.numpy()[obj]))
    pieces, side_adr = program.rel_piecenum.numpy(), program.rel_sideadr.numpy()
    sides, resolved = regions.sides.numpy(), regions.relations.numpy()
    expected = np.zeros((num, triangles, cuts))
    for c, k, combination in np.ndindex(*expected.shape):
        rest, shape = combination, shapely.Polygon(corner.numpy()[c, k].astype(float))
        for i, rel in enumerate(relations):
            number = int(resolved[c, i]["hullnum"]) or 4
            first = side_adr[rel] + rest % pieces[rel] * number
            rest //= pieces[rel]
            if not shape.is_empty:
                shape = _within(shape, sides[c, first : first + number])
        expected[c, k, combination] = shape.area
    small = 1e-6 if name == "beside" else 1e-4  # a line is drawn 40 um wide
    assert np.abs(left.numpy() - expected).max() < 0.01 * small
    assert expected[skipped.numpy()].max(initial=0.0) == 0.0
    assert (expected > small).any()
    if name in ("ring", "ring and wedge"):
        assert skipped.numpy().any()


@pytest.mark.parametrize("name", LEFT)
@pytest.mark.parametrize(("lanes", "parts"), [(7, 1), (200, 1), (3, 8), (5000, 8)])
def test_any_number_of_lanes_finds_the_same_pieces(name: str, lanes: int, parts: int, tmp_path: Path):
    """The same pieces with the same areas."""
    generator = _generated(name, tmp_path)
    search, regions = generator._work.search, generator._regions
    assert regions is not None
    found: list[Any] = []
    for size in (default_size("cpu"), replace(default_size("cpu"), lanes=lanes, parts=parts)):
        search.cause.zero_()
        regions.cuts.zero_()
        regions.regions.zero_()
        work = replace(generator._work, size=size)
        for launch in (launch_build_sides, launch_cut_regions):
            launch(work, regions)
        listed = np.sort(regions.cut.numpy()[: regions.cuts.numpy()[0]])
        pieces = [sorted(zip(*_listed(regions, c), strict=True)) for c in listed]
        found.append((listed.tolist(), pieces))
    assert found[0] == found[1]
    assert len(found[0][0]) == 60
    assert any(found[0][1])


def _listed(regions: Regions, candidate: int) -> tuple[list[int], list[float]]:
    """The numbers and areas of a candidate's pieces, in any order."""
    num = regions.pieces.numpy()[candidate]
    return regions.piece.numpy()[candidate, :num].tolist(), regions.piece_area.numpy()[candidate, :num].tolist()
