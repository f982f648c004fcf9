"""Points of objects: uniform over the exact region that their relations leave, which differs from world to world.

The exponential race chooses a piece of a region by area, also where a random number is 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
import warp as wp
from scipy import stats

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.audit.geometry import poses_of
from sceniris_gym.layout.tables import make_table
from sceniris_gym.layout.wave.points import NO_PIECE, PointCounter, arrival_key, arrival_time, piece_of
from tests.layout.related import Shapes, scene
from tests.oracle.regions import regions
from tests.oracle.uniformity import spread_p_value, turned_back

N = 1200
FLOOR_AREA = shapely.box(-1, -1, 1, 1)
STEP = 2.0**-24  # of a uniform number


@pytest.fixture(scope="module")
def shapes(tmp_path_factory) -> Shapes:
    """Assets that touch nothing, so that nothing but the region decides where an object is."""
    return Shapes(tmp_path_factory.mktemp("shapes"), airy=True)


class Drawn:
    """Layouts and what their objects look like from above.

    Args:
        objects: the scene's objects.
        seed: of the first layout.
    """

    def __init__(self, objects: dict[str, Any], seed: int = 1) -> None:
        self.compiled = scene(objects)
        table = make_table(self.compiled, N, seed)
        assert table.valid.all()
        outlines = Auditor(self.compiled.mjm, self.compiled.config, self.compiled.scene.bodies).outlines
        self.poses = poses_of(self.compiled.mjm, table)
        seen = outlines.see(self.poses, {})
        self.seen, self.under = seen.outlines, seen.support_heading

    def surface(self, body: str, corners: list[tuple[float, float]]) -> np.ndarray:
        """A polygon [m] of a body's own frame in each layout, seen from above, shape (N,)."""
        i = self.compiled.mjm.body(body).id
        flat = np.array(corners) @ self.poses.xmat[:, i, :2, :2].transpose(0, 2, 1) + self.poses.xpos[:, i, None, :2]
        return np.asarray(shapely.polygons(flat))

    def p_values(self, name: str, support: np.ndarray | shapely.Geometry = FLOOR_AREA) -> tuple[float, float]:
        """Test the hypothesis that an object is uniform over the area that its relations leave of a support.

        Returns:
            The p-values of its spread, seen in the world and in the frame of the first anchor.
        """
        relations = self.compiled.config.objects[name].relations
        areas = np.full(N, support)
        for r in relations:
            areas = shapely.intersection(areas, regions(r, self.seen[name], self.seen, self.under[name]))
        points = self.seen[name].pivot[:, :2]
        heading = self.seen[relations[0].anchors[0]].heading
        return spread_p_value(points, areas), spread_p_value(*turned_back(points, areas, heading))


def fixture(asset: str, x: float, y: float, size: float = 0.05, **words: Any) -> dict[str, Any]:
    """A fixture within `size` of (x, y)."""
    box = [[x - size, y - size], [x + size, y + size]]
    return {"asset": asset, "kind": "fixture", "on": "floor", "region": {"box": box}, **words}


WORDS: dict[str, tuple[dict, ...]] = {
    "half plane": ({"front_of": "a"},),
    "wedge": ({"right_of": "a", "angle": 35},),
    "narrow wedge": ({"back_of": "a", "angle": 4},),
    "wedge across 180 degrees": ({"left_of": "a", "frame": "world", "angle": 50},),
    "wedge across 180 degrees that is wide": ({"direction": [-1, 0.02], "of": "a", "frame": "world", "angle": 130},),
    "half angle above 90 degrees": ({"back_of": "a", "angle": 150},),
    "half angle of 180 degrees": ({"back_of": "a", "angle": 180},),
    "disk": ({"near": "a", "distance": {"max": 0.4}},),
    "ring": ({"near": "a", "distance": {"min": 0.3, "max": 0.6}},),
    "far": ({"left_of": "a", "angle": 180, "distance": {"min": 0.7}},),
    "soft band": ({"near": "a", "distance": {"equal": 0.4}},),
    "slice of a ring": (
        {"direction": [1, -1], "of": "a", "frame": "b", "angle": 55, "distance": {"min": 0.2, "max": 0.7}},
    ),
    "slice of a ring across 180 degrees": ({"left_of": "a", "frame": "world", "angle": 70, "distance": {"min": 0.2}},),
    "near by bounds": ({"near": "a", "measure": "bounds", "distance": {"max": 0.1}},),
    "ring by bounds": ({"near": "a", "measure": "bounds", "distance": {"min": 0.1, "max": 0.3}},),
    "band by bounds": ({"near": "a", "measure": "bounds", "distance": {"equal": 0.2, "tolerance": 0.03}},),
    "side by bounds": ({"front_of": "a", "measure": "bounds", "angle": 60, "distance": {"min": 0.02, "max": 0.15}},),
    "between two": ({"between": ["a", "b"], "width": 0.3},),
    "between three": ({"between": ["a", "b", "c"]},),
    "two relations": ({"right_of": "a", "angle": 100}, {"near": "b", "distance": {"max": 0.5}}),
    "four relations": (
        {"right_of": "a", "angle": 170},
        {"near": "b", "distance": {"min": 0.1, "max": 0.8}},
        {"front_of": "c", "distance": {"min": 0.1}},
        {"between": ["a", "b"], "width": 1.5},
    ),
}


@pytest.mark.parametrize("name", WORDS)
def test_points_are_uniform_in_the_region(name: str, shapes: Shapes):
    """Anchors are drawn and turned anew in every world; the object is an L that is turned too."""
    anchors = {
        "a": fixture(shapes.odd, -0.1, 0.0),
        "b": fixture(shapes.bar, 0.4, 0.1),
        "c": fixture(shapes.cube, 0.1, 0.6),
    }
    thing = {"asset": shapes.odd, "on": "floor", "relations": list(WORDS[name])}
    assert min(Drawn({**anchors, "thing": thing}).p_values("thing")) > 0.001


def test_what_a_drawn_joint_carries_off_is_seen_where_it_is(shapes: Shapes):
    """A cart whose bounds are far from the pivot that its home state gives it: the ring around its bounds is whole."""
    anchors = {"a": fixture(shapes.cart, 0.0, 0.0, joints={"slide": {"value": 0.3}})}
    ring = {"near": "a", "measure": "bounds", "distance": {"min": 0.25, "max": 0.35}}
    thing = {"asset": shapes.cube, "on": "floor", "relations": [ring]}
    assert min(Drawn({**anchors, "thing": thing}, seed=2).p_values("thing")) > 0.001


def test_points_are_uniform_between_eight(shapes: Shapes):
    """A hull of eight anchors that are drawn all over the floor."""
    anchors = {name: fixture(shapes.cube, 0.0, 0.0, 0.9) for name in "abcdefgh"}
    thing = {"asset": shapes.bar, "on": "floor", "relations": [{"between": list(anchors)}]}
    assert min(Drawn({**anchors, "thing": thing}).p_values("thing")) > 0.001


def test_points_are_uniform_between_three_on_a_line(shapes: Shapes):
    """A strip from end to end, whatever the order of the anchors."""
    places = {"a": (0.05, 0.02), "b": (-0.5, -0.2), "c": (0.6, 0.24)}
    anchors = {name: fixture(shapes.cube, *at, 1e-5, orientation="fixed") for name, at in places.items()}
    thing = {"asset": shapes.bar, "on": "floor", "relations": [{"between": list(anchors), "width": 0.2}]}
    assert min(Drawn({**anchors, "thing": thing}).p_values("thing")) > 0.001


def test_points_are_uniform_on_a_turned_support(shapes: Shapes):
    """A slab that is turned anew in every world, with a region and a direction in its own frame."""
    crop = [(-0.5, -0.4), (0.5, -0.4), (0.5, 0.2), (0.0, 0.4)]
    on_it = {"on": "slab", "region": {"polygon": [list(c) for c in crop]}}
    slab = fixture(shapes.slab, 0.0, 0.0, 0.3)
    anchor = {"asset": shapes.odd, "on": "slab", "region": {"box": [[-0.1, -0.1], [0.1, 0.1]]}}
    relations = [{"left_of": "a", "frame": "support", "angle": 60}]
    drawn = Drawn({"slab": slab, "a": anchor, "thing": {"asset": shapes.odd, **on_it, "relations": relations}})
    assert min(drawn.p_values("thing", drawn.surface("slab", crop))) > 0.001


def test_points_are_uniform_on_the_floor_of_a_drawer(shapes: Shapes):
    """All of the floor that is behind the drawer's front, at any opening."""
    case = fixture(shapes.drawer, 0.0, 0.0, 0.3, joints={"slide": {"fraction": [0, 1]}})
    inside = {"asset": shapes.cube, "in": "case/drawer"}
    near = {**inside, "relations": [{"near": "a", "distance": {"max": 0.12}}]}
    drawn = Drawn({"case": case, "a": inside, "thing": near})
    floor = [(-0.135, -0.091), (0.135, -0.091), (0.135, 0.095), (-0.135, 0.095)]
    assert min(drawn.p_values("thing", drawn.surface("case/drawer", floor))) > 0.001


@pytest.mark.parametrize("own", ["bar", "odd"])
def test_what_is_beside_is_anywhere_along_the_side(own: str, shapes: Shapes):
    """Uniform on the line on which the narrower of the two lies within the span of the wider one."""
    thing = {"asset": getattr(shapes, own), "on": "floor", "relations": [{"beside": "a", "side": "back"}]}
    seen = Drawn({"a": fixture(shapes.odd, 0.0, 0.0), "thing": thing}).seen
    across = np.stack([np.cos(seen["a"].heading), np.sin(seen["a"].heading)], 1)
    low, high = seen["thing"].span(across)
    other_low, other_high = seen["a"].span(across)
    ends = np.sort([other_low - low, other_high - high], axis=0)
    share = -ends[0] / (ends[1] - ends[0])
    longer = ends[1] - ends[0] > 0.002  # shorter lines are nearly points, and as wide as they are long
    assert longer.sum() > 0.9 * N
    assert stats.kstest(share[longer], "uniform").pvalue > 0.001


def test_points_are_uniform_in_a_box_in_space(shapes: Shapes):
    """Seen from above in the region that is left of it, and in height."""
    box = {"box": [[-0.8, -0.8, 0.3], [0.8, 0.8, 0.7]]}
    thing = {"asset": shapes.odd, "region": box, "orientation": "any"}
    relations = [{"near": "a", "measure": "bounds", "distance": {"min": 0.1, "max": 0.3}}]
    drawn = Drawn({"a": fixture(shapes.odd, 0.0, 0.0), "thing": {**thing, "relations": relations}})
    assert min(drawn.p_values("thing", shapely.box(-0.8, -0.8, 0.8, 0.8))) > 0.001
    assert stats.kstest((drawn.seen["thing"].pivot[:, 2] - 0.3) / 0.4, "uniform").pvalue > 0.001


@wp.kernel(enable_backward=False)
def _arrive(u: wp.array[float], size: wp.array[float], time_out: wp.array[float]):
    i = wp.tid()
    time_out[i] = arrival_time(u[i], size[i])


def _times(u: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return the arrival times of pieces as their bits, by which the race compares them."""
    inputs = [wp.array(a, dtype=float, device="cpu") for a in (u, size)]
    out = wp.zeros(len(u), dtype=float, device="cpu")
    wp.launch(_arrive, dim=len(u), inputs=inputs, outputs=[out], device="cpu")
    return out.numpy().view(np.uint32)


def test_zero_is_judged_by_area_like_its_neighbours():
    """It neither wins over a piece many times as large nor loses to one that is smaller and later."""
    u, size = np.array([0.0, STEP, 0.0, STEP, 0.5]), np.array([1e-6, 1.0, 1.0, 1.0, 1.0])
    tiny, large, zero, first, late = _times(u, size).tolist()
    assert large < tiny
    assert zero < first < late


def test_all_other_numbers_have_the_time_of_the_formula():
    """By double precision, with two roundings to floats."""
    rng = np.random.default_rng(0)
    u = np.concatenate([rng.integers(1, 1 << 24, 100_000), [1, 2, 3, (1 << 24) - 1]]) * STEP
    size = (10.0 ** rng.uniform(-9, 2, len(u))).astype(np.float32)
    np.testing.assert_allclose(_times(u, size).view(np.float32), -np.log(1.0 - u) / size, rtol=1.3e-7)


def test_zero_takes_its_share_of_the_race():
    """Its time is the middle of those of numbers below the first step: half of that one's."""
    zero, first = _times(np.array([0.0, STEP]), np.ones(2)).view(np.float32)
    assert zero == first / 2


@wp.kernel(enable_backward=False)
def _finish(numbers: PointCounter, size: wp.array[float], key: wp.array[wp.uint64], index: wp.array[int]):
    i = wp.tid()
    key[i] = arrival_key(numbers, 2, i, size[i])
    index[i] = piece_of(key[i])


def test_the_least_key_is_that_of_the_first_to_finish():
    """The upper word has the time and the lower the number; every piece precedes the sentinel."""
    numbers = PointCounter()  # pyrefly: ignore[missing-argument]
    numbers.seed, numbers.episode, numbers.stream, numbers.trial = wp.uint64(3), 1, wp.uint32(4), 5
    size = np.tile(np.array([1e-9, 1e-3, 0.5, 2.0], np.float32), 5000)
    inputs = [numbers, wp.array(size, dtype=float, device="cpu")]
    key = wp.zeros(len(size), dtype=wp.uint64, device="cpu")
    index = wp.zeros(len(size), dtype=int, device="cpu")
    wp.launch(_finish, dim=len(size), inputs=inputs, outputs=[key, index], device="cpu")
    assert (index.numpy() == np.arange(len(size))).all()
    assert (key.numpy() < np.uint64(NO_PIECE)).all()
    time = (key.numpy() >> np.uint64(32)).astype(np.uint32).view(np.float32)
    assert (np.diff(time[np.argsort(key.numpy())]) >= 0.0).all()
    means = (time * size).reshape(-1, 4).mean(0)
    assert np.abs(means - 1.0).max() < 5 / np.sqrt(5000)
