"""What relations leave of a region, and the race in which a piece of it is chosen: by area, also for a 0."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import warp as wp
from shapely.geometry.base import BaseGeometry

from sceniris_gym.config.limits import MAX_CORNERS
from sceniris_gym.layout import points
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.points import race_time
from sceniris_gym.layout.polygons import area
from sceniris_gym.layout.search import Search
from sceniris_gym.program.device import Program
from tests.layout.related import Shapes, related, scene

_CORNERS = wp.constant(MAX_CORNERS)
STEP = 2.0**-24  # of a uniform number


@wp.kernel(enable_backward=False)
def _race(u: wp.array(dtype=float), size: wp.array(dtype=float), time_out: wp.array(dtype=float)):
    i = wp.tid()
    time_out[i] = race_time(u[i], size[i])


@wp.kernel(enable_backward=False)
def _plain(u: wp.array(dtype=float), size: wp.array(dtype=float), time_out: wp.array(dtype=float)):
    i = wp.tid()
    time_out[i] = -wp.log(1.0 - u[i]) / size[i]


def _times(kernel: wp.Kernel, u: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Times at which pieces finish, compared as the race does: by their bits."""
    inputs = [wp.array(a, dtype=float, device="cpu") for a in (u, size)]
    out = wp.zeros(len(u), dtype=float, device="cpu")
    wp.launch(kernel, dim=len(u), inputs=inputs, outputs=[out], device="cpu")
    return out.numpy().view(np.uint32)


def test_zero_is_judged_by_area_like_its_neighbours():
    """It neither wins over a piece many times as large nor loses to one that is smaller and later."""
    u, size = np.array([0.0, STEP, 0.0, STEP, 0.5]), np.array([1e-6, 1.0, 1.0, 1.0, 1.0])
    tiny, large, zero, first, late = _times(_race, u, size).tolist()
    assert large < tiny
    assert zero < first < late


def test_all_other_numbers_keep_their_bits():
    """The times are those of the plain formula."""
    rng = np.random.default_rng(0)
    u = np.concatenate([rng.integers(1, 1 << 24, 100_000), [1, 2, 3, (1 << 24) - 1]]) * STEP
    size = 10.0 ** rng.uniform(-9, 2, len(u))
    assert (_times(_race, u, size) == _times(_plain, u, size)).all()


def test_zero_takes_its_share_of_the_race():
    """Its time is the middle of those of numbers below the first step: half of that one's."""
    zero, first = _times(_race, np.array([0.0, STEP]), np.ones(2)).view(np.float32)
    assert zero == first / 2


@wp.kernel(enable_backward=False)
def _cut_all(
    program: Program,
    layouts: LayoutsView,
    search: Search,
    obj: int,
    corner: wp.array3d(dtype=wp.vec2),
    out_of_reach: wp.array2d(dtype=bool),
    left: wp.array3d(dtype=float),
):
    c, k = wp.tid()
    row = search.row[c]
    variant = search.turn[c].variant
    frame = points._frame(program, layouts, row, obj)
    t = points._triangle(program, program.variant_triadr[variant] + k, frame)
    corner[c, k, 0] = t.a
    corner[c, k, 1] = t.b
    corner[c, k, 2] = t.c
    out_of_reach[c, k] = points._is_out_of_reach(program, search, c, obj, t)
    polygon = wp.zeros(shape=(_CORNERS,), dtype=wp.vec2)
    for combination in range(program.obj_cutnum[obj]):
        left[c, k, combination] = area(polygon, points._cut(program, search, c, obj, combination, t, polygon))


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


@pytest.mark.parametrize("name", LEFT)
def test_nothing_is_dropped_of_what_relations_leave(name: str, tmp_path: Path):
    """Each triangle within each piece of all relations has the area that shapely finds; what is skipped has none."""
    shapes = Shapes(tmp_path, airy=True)
    others: dict[str, Any] = {n: {"asset": shapes.odd, "kind": "fixture", "on": "floor"} for n in "abc"}
    others["slab"] = {"asset": shapes.slab, "kind": "fixture", "on": "floor"}
    lies = {"on": "slab", "region": {"polygon": [[-0.5, -0.4], [0.5, -0.4], [0.3, 0.1], [0.5, 0.4], [-0.4, 0.3]]}}
    compiled = scene({**others, "q": related(shapes.cube, *LEFT[name], **lies)}, attempts=1, restarts=0)
    generator = LayoutGenerator(compiled, 60, seed=5)
    generator.generate()
    search, program, obj = generator._search, compiled.program, compiled.placed.index("q")
    num = int(search.candidates.numpy()[0])
    assert num == 60
    triangles, cuts = int(program.variant_trinum.numpy().max()), int(program.obj_cutnum.numpy()[obj])
    corner = wp.zeros((num, triangles, 3), dtype=wp.vec2, device="cpu")
    skipped = wp.zeros((num, triangles), dtype=bool, device="cpu")
    left = wp.zeros((num, triangles, cuts), dtype=float, device="cpu")
    inputs = [program, generator.layouts.view, search, obj]
    wp.launch(_cut_all, dim=(num, triangles), inputs=inputs, outputs=[corner, skipped, left], device="cpu")

    adr = int(program.obj_reladr.numpy()[obj])
    relations = range(adr, adr + int(program.obj_relnum.numpy()[obj]))
    pieces, side_adr = program.rel_piecenum.numpy(), program.rel_sideadr.numpy()
    sides, resolved = search.sides.numpy(), search.relations.numpy()
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
