"""Where points are drawn: uniform over regions, on what is left of a support, below a roof or under open sky."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import shapely
import warp as wp
from scipy import stats
from scipy.spatial.transform import Rotation
from shapely.geometry import MultiPoint, Polygon, box
from shapely.geometry.base import BaseGeometry

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.device.transforms import Pose, relative
from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Status
from sceniris_gym.placement import cover_and_footprint as regions
from sceniris_gym.program.compiled import upload_scene
from sceniris_gym.program.device import Program, fill_struct
from sceniris_gym.scene.model import build_model
from tests.layout.candidates import refused
from tests.layout.scenes import FLOOR, Rows, compile_on_cpu, make, posed, read, write_mjcf
from tests.oracle.solids import Solids

# An L of two tiles and a frame of four around a hole, 6 cm high.
TILES = [
    ((-0.4, -0.4), (0.0, 0.0)),
    ((-0.4, 0.0), (0.0, 0.4)),
    ((0.0, -0.4), (0.4, -0.3)),
    ((0.0, -0.1), (0.4, 0.0)),
    ((0.0, -0.3), (0.1, -0.1)),
    ((0.3, -0.3), (0.4, -0.1)),
]
PLATE = [((-0.3, -0.2), (0.3, 0.2))]
SHAPE = shapely.union_all([box(*low, *high) for low, high in TILES])
SHELF = """<geom type="box" size=".3 .2 .01" pos="0 0 .01"/><geom type="box" size=".3 .01 .2" pos="0 .21 .2"/>
  <geom type="box" size=".1 .2 .01" pos=".2 0 .39"/>"""


def _tiles(folder: Path, tiles: list[tuple[tuple[float, float], tuple[float, float]]] = TILES) -> str:
    """Write the asset of a support of tiles, by default the L."""
    geoms = [
        f'<geom type="box" size="{(x1 - x0) / 2} {(y1 - y0) / 2} .03" pos="{(x0 + x1) / 2} {(y0 + y1) / 2} .03"/>'
        for (x0, y0), (x1, y1) in tiles
    ]
    return write_mjcf(folder, "slab", "".join(geoms))


def _uniformity(points: np.ndarray, region: BaseGeometry, n: int = 8) -> float:
    """The p value of a chi-square test of points (n, 2) over the cells that a grid cuts the region into."""
    assert shapely.covers(region.buffer(1e-6), shapely.points(points)).all()
    x0, y0, x1, y1 = region.bounds
    xs, ys = np.linspace(x0, x1, n + 1), np.linspace(y0, y1, n + 1)
    cells = [box(xs[i], ys[j], xs[i + 1], ys[j + 1]) for i in range(n) for j in range(n)]
    share = shapely.area(shapely.intersection(cells, region)) / region.area
    i, j = (
        np.clip(np.searchsorted(s, p, side="right") - 1, 0, n - 1) for s, p in ((xs, points[:, 0]), (ys, points[:, 1]))
    )
    count = np.bincount(i * n + j, minlength=n * n)
    small = share * len(points) < 8
    expected = np.append(share[~small], share[small].sum()) * len(points)
    observed = np.append(count[~small], count[small].sum())
    keep = expected > 1e-6
    return stats.chisquare(observed[keep], expected[keep]).pvalue


def _points(scene: dict, nworld: int = 4000, seed: int = 11) -> np.ndarray:
    """Where a goal without a body is drawn, shape (nworld, 3)."""
    compiled = compile_on_cpu(scene)
    rows = make(compiled, nworld, seed=seed)
    assert (rows.status == Status.VALID).all()
    return rows.mocap_pos[:, int(compiled.mjm.body("goal").mocapid[0])]


REGIONS = {
    "whole": (None, SHAPE),
    "box": ({"box": [[-0.2, -0.2], [0.35, 0.3]]}, SHAPE & box(-0.2, -0.2, 0.35, 0.3)),
    "fraction": ({"fraction": [[0.25, 0.0], [1.0, 0.5]]}, SHAPE & box(-0.2, -0.4, 0.4, 0.0)),
    "polygon": (
        {"polygon": [[-0.4, -0.4], [0.3, -0.4], [-0.3, 0.1], [-0.1, 0.3], [-0.4, 0.3]]},
        SHAPE & Polygon([[-0.4, -0.4], [0.3, -0.4], [-0.3, 0.1], [-0.1, 0.3], [-0.4, 0.3]]),
    ),
}


@pytest.mark.parametrize("region", [{}, {"region": {"box": [[-0.1, -0.3], [0.9, 0.05]]}}])
def test_points_are_uniform_over_the_floor(region: dict):
    """The whole floor, and a crop that reaches beyond it."""
    goal = {"kind": "marker", "on": "floor", **region}
    points = _points({"floor": {"size": [1.2, 0.7]}, "objects": {"goal": goal}})
    floor = box(-0.6, -0.35, 0.6, 0.35)
    assert _uniformity(points[:, :2], floor & box(-0.1, -0.3, 0.9, 0.05) if region else floor) > 0.001
    np.testing.assert_allclose(points[:, 2], 0.0005, atol=1e-7)


@pytest.mark.parametrize("name", REGIONS)
def test_points_are_uniform_over_an_l_with_a_hole(tmp_path: Path, name: str):
    """All of the support and its crops, in the support's frame; nothing falls through the hole."""
    words, expected = REGIONS[name]
    objects = {
        "slab": {"asset": _tiles(tmp_path), "kind": "static"},
        "goal": {"kind": "marker", "on": "slab", **({"region": words} if words else {})},
    }
    points = _points({"objects": objects})
    assert _uniformity(points[:, :2], expected) > 0.001
    np.testing.assert_allclose(points[:, 2], 0.0605, atol=1e-6)


def test_points_are_uniform_in_the_frame_of_a_turned_support(tmp_path: Path):
    """A fixture at any yaw, its region given in its own frame."""
    words, expected = REGIONS["polygon"]
    objects = {
        "slab": {"asset": _tiles(tmp_path), "kind": "fixture", "on": "floor"},
        "goal": {"kind": "marker", "on": "slab", "region": words},
    }
    compiled = compile_on_cpu({"floor": FLOOR, "objects": objects})
    rows = make(compiled, 4000, seed=12)
    slab, goal = (int(compiled.mjm.body(n).mocapid[0]) for n in ("slab", "goal"))
    local = []
    for data in posed(compiled, rows):
        body = compiled.mjm.body("slab").id
        local.append(data.xmat[body].reshape(3, 3).T @ (data.mocap_pos[goal] - data.xpos[body]))
    assert _uniformity(np.array(local)[:, :2], expected) > 0.001
    assert np.ptp(rows.mocap_quat[:, slab, 0]) > 0.9


def test_two_surfaces_are_chosen_by_their_areas(tmp_path: Path):
    """Two steps of a stair, one three times as large; and within each the points are uniform."""
    geoms = '<geom type="box" size=".1 .1 .05" pos="-.1 0 .05"/><geom type="box" size=".15 .2 .1" pos=".15 0 .1"/>'
    objects = {
        "stair": {"asset": write_mjcf(tmp_path, "stair", geoms), "kind": "static"},
        "goal": {"kind": "marker", "on": "stair"},
    }
    points = _points({"objects": objects})
    high = points[:, 2] > 0.15
    assert stats.binomtest(int(high.sum()), len(points), 0.75).pvalue > 0.001
    assert _uniformity(points[high, :2], box(0.0, -0.2, 0.3, 0.2), 5) > 0.001
    assert _uniformity(points[~high, :2], box(-0.2, -0.1, 0.0, 0.1), 5) > 0.001


@pytest.mark.parametrize("ratio", [0.0, 0.5])
def test_the_support_is_eroded_by_the_ratio_times_half_the_shorter_edge(tmp_path: Path, ratio: float):
    """A brick of 16 x 8 cm: its pivot keeps 2 cm from every edge at a ratio of 0.5, and reaches that far."""
    brick = write_mjcf(tmp_path, "brick", '<geom type="box" size=".08 .04 .02" pos="0 0 .02"/>')
    objects = {
        "slab": {"asset": _tiles(tmp_path), "kind": "static"},
        "brick": {"asset": brick, "on": "slab", "ratio_on_support": ratio},
    }
    points = make(compile_on_cpu({"objects": objects}), 4000).qpos[:, :2]
    left = SHAPE.buffer(-0.04 * ratio)
    assert _uniformity(points, left) > 0.001
    reach = shapely.distance(SHAPE.boundary, shapely.points(points)).min()
    assert 0.04 * ratio - 1e-6 <= reach < 0.04 * ratio + 0.001


@pytest.mark.parametrize("tiles", [TILES, PLATE], ids=["hollow", "convex"])
@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize("asset", ["banana", "mug"])
def test_at_ratio_one_the_whole_footprint_lies_on_the_support(tmp_path: Path, asset: str, geometry: str, tiles: list):
    """The shadow of the posed meshes is inside of the L and off its hole, or on the plate; what was refused was not."""
    shape = shapely.union_all([box(*low, *high) for low, high in tiles])
    objects = {
        "slab": {"asset": _tiles(tmp_path, tiles), "kind": "fixture", "on": "floor"},
        asset: {"asset": asset, "on": "slab", "ratio_on_support": 1.0},
    }
    config = {"floor": FLOOR, "geometry": geometry, "attempts": 1, "restarts": 0, "objects": objects}
    compiled = upload_scene(build_model(SceneConfig.load(config)), "cpu")
    generator = LayoutGenerator(compiled, 300, seed=3)
    generator.generate()
    rows, solids = read(generator.layouts), Solids(compiled.mjm, geometry)

    def outside(rows: Rows, slack: float) -> np.ndarray:
        areas, allowed = [], shape.buffer(slack, join_style="mitre")
        for data in posed(compiled, rows):
            body = compiled.mjm.body("slab").id
            frame = data.xmat[body].reshape(3, 3)
            points = [(solids.points(data, g) - data.xpos[body]) @ frame for g in solids.geoms(asset)]
            footprint = MultiPoint(np.concatenate(points)[:, :2]).convex_hull
            areas.append(footprint.difference(allowed).area)
        return np.array(areas)

    accepted, (others, causes) = rows.status == Status.VALID, refused(generator)
    assert 50 < accepted.sum() < 280
    assert outside(rows[accepted], 2e-6).max() == 0.0
    counts = {cause: n for cause, n in generator.rejection_counts()[asset].items() if n}
    assert counts == {"footprint": int((~accepted).sum())}
    assert len(causes) == counts["footprint"]
    assert outside(others, 0.0).min() > 0.0


def _drawer(word: str, opening: float, geometry: str, **others) -> dict:
    cabinet = {"asset": "cabinet", "kind": "fixture", "on": "floor", "joints": {"upper": {"value": opening}}}
    goal = {"kind": "marker", word: "cabinet/upper_drawer"}
    return {"floor": FLOOR, "geometry": geometry, "objects": {"cabinet": cabinet, "goal": goal}, **others}


def _covered(compiled, rows: Rows, geometry: str) -> np.ndarray:
    """MuJoCo C's rays straight up from the goals: is any part of the cabinet above?"""
    groups = np.zeros(6, np.uint8)
    groups[3 if geometry == "physics" else 2] = 1
    goal, geom = int(compiled.mjm.body("goal").mocapid[0]), np.zeros(1, np.int32)
    up = np.array([0.0, 0.0, 1.0])
    return np.array(
        [
            mujoco.mj_ray(compiled.mjm, data, data.mocap_pos[goal].copy(), up, groups, 1, -1, geom) >= 0.0
            for data in posed(compiled, rows)
        ]
    )


@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize("opening", [0.1, 0.25])
def test_the_roof_over_a_drawer_is_decided_by_its_opening(opening: float, geometry: str):
    """`on` draws open points, `inside` covered ones, `in` both; single refusals of `inside` are right as well."""
    rows = {}
    for word in ("on", "inside", "in"):
        compiled = compile_on_cpu(_drawer(word, opening, geometry, attempts=100))
        rows[word] = make(compiled, 300, seed=5)
        assert (rows[word].status == Status.VALID).all()
    compiled = compile_on_cpu(_drawer("in", opening, geometry))
    covered = {word: _covered(compiled, rows[word], geometry) for word in rows}
    assert not covered["on"].any()
    assert covered["inside"].all()
    assert 0.05 < covered["in"].mean() < 0.95
    once = make(compile_on_cpu(_drawer("inside", opening, geometry, attempts=1, restarts=0)), 300, seed=5)
    assert ((once.status == Status.VALID) == covered["in"]).all()


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_a_shut_drawer_has_no_open_sky(geometry: str):
    """What cannot be placed under it is named, with what is overhead as the cause."""
    with pytest.raises(InfeasibleSceneError, match="'goal' could not be placed, mostly because of overhead"):
        compile_on_cpu(_drawer("on", 0.0, geometry))


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_a_roof_of_the_same_body_counts(tmp_path: Path, geometry: str):
    """A shelf covered over its right third, whose roof is a surface as well."""
    shelf = {"asset": write_mjcf(tmp_path, "shelf", SHELF), "kind": "static"}
    words = {}
    for word in ("on", "inside", "in"):
        goal = {"kind": "marker", word: "shelf"}
        words[word] = _points({"geometry": geometry, "objects": {"shelf": shelf, "goal": goal}}, 2000)
    covered = {word: (p[:, 0] > 0.1) & (p[:, 2] < 0.3) for word, p in words.items()}
    low = {word: p[:, 2] < 0.3 for word, p in words.items()}
    assert not covered["on"].any()
    assert covered["inside"].all()
    share = 0.4 / (0.6 + 0.2)  # the roof is 0.2 m wide, the board 0.6 m, 0.4 m of which lie open
    assert stats.binomtest(int((low["on"]).sum()), 2000, 0.4 / 0.6).pvalue > 0.001
    assert stats.binomtest(int((low["in"] & ~covered["in"]).sum()), 2000, share).pvalue > 0.001
    open_board = box(-0.3, -0.2, 0.1, 0.2)
    assert _uniformity(words["on"][low["on"], :2], open_board, 5) > 0.001


def test_a_roof_of_another_object_does_not_count(tmp_path: Path):
    """A board that hangs over the floor is no roof of a crate below it: only the support's own object is asked."""
    board = write_mjcf(tmp_path, "board", '<geom type="box" size=".4 .4 .01" pos="0 0 .5"/>')
    crate = write_mjcf(tmp_path, "crate", '<geom type="box" size=".1 .1 .1" pos="0 0 .1"/>')
    objects = {
        "board": {"asset": board, "kind": "static"},
        "crate": {"asset": crate, "kind": "static"},
        "goal": {"kind": "marker", "on": "crate"},
    }
    assert len(_points({"objects": objects}, 50)) == 50


@wp.kernel(enable_backward=False)
def _crosses(
    point: wp.array[wp.vec3],
    half: wp.array[wp.vec3],
    pos: wp.array[wp.vec3],
    rot: wp.array[wp.mat33],
    out: wp.array[bool],
):
    i = wp.tid()
    frame = Pose()
    frame.pos = pos[i]
    frame.rot = rot[i]
    out[i] = regions._crosses_box(half[i], relative(regions._upward(point[i]), frame))


def _above(point: np.ndarray, half: np.ndarray, pos: np.ndarray, rot: np.ndarray) -> np.ndarray:
    """In double precision: is any of the 5 m from 0.1 mm over each point on within its box? By what its sides leave."""
    start = np.einsum("nij,ni->nj", rot, point + [0.0, 0.0, 1e-4] - pos)
    low, high = np.zeros(len(point)), np.full(len(point), 5.0)
    for axis in range(3):
        for sign in (1.0, -1.0):  # sign * (start + t * along) <= half
            along, room = sign * rot[:, 2, axis], half[:, axis] - sign * start[:, axis]
            with np.errstate(divide="ignore", invalid="ignore"):
                limit = room / along
            high = np.where(along > 0.0, np.minimum(high, limit), high)
            low = np.where(along < 0.0, np.maximum(low, limit), low)
            low = np.where((along == 0.0) & (room < 0.0), np.inf, low)
    return low <= high


def test_a_box_is_a_roof_where_a_line_straight_up_crosses_it():
    """Turned any way, upright, or flat on a side; beginning and ending inside of it too; to 5 um."""
    n, rng = 60_000, np.random.default_rng(2)
    point, half = rng.uniform(-0.3, 0.3, (n, 3)), rng.uniform(0.002, 0.3, (n, 3))
    pos = rng.uniform([-0.3, -0.3, -0.5], [0.3, 0.3, 0.8], (n, 3))
    pos[: n // 3, 2] += 4.8
    turns = Rotation.random(n, rng=rng).as_matrix()
    turns[::3] = Rotation.from_rotvec(rng.uniform(-4, 4, (n, 1)) * [0.0, 0.0, 1.0]).as_matrix()[::3]
    turns[::7] = np.eye(3)
    arrays = [wp.array(a, dtype=wp.vec3, device="cpu") for a in (point, half, pos)]
    out = wp.zeros(n, dtype=bool, device="cpu")
    inputs = [*arrays, wp.array(turns, dtype=wp.mat33, device="cpu")]
    wp.launch(_crosses, dim=n, inputs=inputs, outputs=[out], device="cpu")
    found = out.numpy()
    assert not (found & ~_above(point, half + 5e-6, pos, turns)).any()
    assert not (~found & _above(point, half - 5e-6, pos, turns)).any()
    assert 0.1 < found.mean() < 0.5


@wp.kernel(enable_backward=False)
def _extends(
    program: Program,
    piece: wp.array[int],
    first: wp.array[int],
    number: wp.array[int],
    turn: wp.array[int],
    pos: wp.array[wp.vec3],
    rot: wp.array[wp.mat33],
    out: wp.array[bool],
):
    i = wp.tid()
    rel = Pose()
    rel.pos = pos[i]
    rel.rot = rot[i]
    for edge in range(first[i], first[i] + number[i]):
        if regions._extends_beyond(program, piece[i], edge, turn[i], rel):
            out[i] = True


def test_what_extends_beyond_a_convex_outline_is_what_shapely_says():
    """Hulls and boxes in any pose on random convex outlines, of which half run clockwise: to 2 um."""
    n, rng = 3000, np.random.default_rng(6)
    hulls = [rng.normal(size=(k, 3)) * [0.05, 0.03, 0.02] for k in (4, 9, 40)]
    size = np.array([0.06, 0.03, 0.01])
    corners = [*hulls, np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size]
    outlines, edges, turn = [], [], rng.choice([-1, 1], n)
    for i in range(n):
        outline = MultiPoint(rng.normal(size=(int(rng.integers(3, 12)), 2)) * 0.12).convex_hull
        ring = shapely.get_coordinates(outline)
        ring = ring if shapely.LinearRing(ring).is_ccw == (turn[i] > 0) else ring[::-1]
        outlines.append(outline)
        edges.append(np.stack([ring[:-1], ring[1:]], axis=1))
    count = np.array([len(e) for e in edges])
    sides = np.concatenate(edges)
    lengths = np.array([len(h) for h in hulls] + [0])
    program = Program()
    arrays = {
        "piece_type": np.array([PieceType.HULL] * 3 + [PieceType.BOX]),
        "piece_size": np.array([[0.0] * 3] * 3 + [size.tolist()]),
        "piece_vertnum": lengths,
        "piece_vertadr": np.cumsum(lengths) - lengths,
        "vert": np.concatenate(hulls),
        "edge_a": sides[:, 0],
        "edge_b": sides[:, 1],
    }
    fill_struct(Program, program, arrays, "cpu")
    piece, rot = rng.integers(4, size=n), Rotation.random(n, rng=rng).as_matrix()
    pos = np.concatenate([rng.uniform(-0.1, 0.1, (n, 2)), rng.uniform(0.0, 0.5, (n, 1))], axis=1)
    ints = [wp.array(a, dtype=int, device="cpu") for a in (piece, np.cumsum(count) - count, count, turn)]
    poses = [wp.array(pos, dtype=wp.vec3, device="cpu"), wp.array(rot, dtype=wp.mat33, device="cpu")]
    out = wp.zeros(n, dtype=bool, device="cpu")
    wp.launch(_extends, dim=n, inputs=[program, *ints, *poses], outputs=[out], device="cpu")
    beyond = np.empty(n)
    for i in range(n):
        shadow = shapely.points((corners[piece[i]] @ rot[i].T + pos[i])[:, :2])
        inside = shapely.covers(outlines[i], shadow)
        distance = shapely.distance(outlines[i].boundary, shadow)
        beyond[i] = np.where(inside, -distance, distance).max()
    found = out.numpy()
    assert 0.1 < found.mean() < 0.9
    assert (np.abs(beyond) < 2e-4).any()
    assert not found[beyond < -2e-6].any()
    assert found[beyond > 3e-6].all()
