"""Footprints: with `ratio_on_support: 1` the shadow of an object lies on its support.

Covers: `on` draws points below open sky, `inside` points that something covers, `in` both.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import shapely
import warp as wp
from scipy import stats
from scipy.spatial.transform import Rotation
from shapely.geometry import MultiPoint, box

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.device.transforms import Pose, relative
from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.geometry.pieces import PieceType
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.placement import footprint
from sceniris_gym.program.compiled import upload_scene
from sceniris_gym.program.device import Program, fill_struct
from sceniris_gym.scene.build import build_model
from tests.layout.candidates import refused
from tests.layout.scenes import FLOOR, Rows, compile_on_cpu, make, posed, read, write_mjcf
from tests.oracle.solids import Solids
from tests.oracle.uniformity import grid_p_value
from tests.placement.supports import PLATE, TILES, goal_points, tiles_mjcf

SHELF = """<geom type="box" size=".3 .2 .01" pos="0 0 .01"/><geom type="box" size=".3 .01 .2" pos="0 .21 .2"/>
  <geom type="box" size=".1 .2 .01" pos=".2 0 .39"/>"""


@pytest.mark.parametrize("tiles", [TILES, PLATE], ids=["hollow", "convex"])
@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize("asset", ["banana", "mug"])
def test_at_ratio_one_the_whole_footprint_lies_on_the_support(tmp_path: Path, asset: str, geometry: str, tiles: list):
    """The shadow of the posed meshes is inside of the L and off its hole, or on the plate; what was refused was not."""
    shape = shapely.union_all([box(*low, *high) for low, high in tiles])
    objects = {
        "slab": {"asset": tiles_mjcf(tmp_path, tiles), "kind": "fixture", "on": "floor"},
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

    accepted, (others, causes) = rows.status == LayoutStatus.VALID, refused(generator)
    assert 50 < accepted.sum() < 280
    assert outside(rows[accepted], 2e-6).max() == 0.0
    counts = {cause: n for cause, n in generator.rejection_counts()[asset].items() if n}
    assert counts == {"footprint": int((~accepted).sum())}
    assert len(causes) == counts["footprint"]
    assert outside(others, 0.0).min() > 0.0


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
    rel = Pose()  # pyrefly: ignore[missing-argument]
    rel.pos = pos[i]
    rel.rot = rot[i]
    for edge in range(first[i], first[i] + number[i]):
        if footprint._extends_beyond(program, piece[i], edge, turn[i], rel):
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
    program = Program()  # pyrefly: ignore[missing-argument]
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


@wp.kernel(enable_backward=False)
def _outline(
    program: Program,
    points: wp.array[wp.vec2],
    pos: wp.array[wp.vec3],
    rot: wp.array[wp.mat33],
    # Out:
    inside: wp.array[bool],
    distance: wp.array[float],
    crossed: wp.array[bool],
):
    i = wp.tid()
    inside[i] = footprint.inside_outline(program, 0, points[i])
    distance[i] = footprint.outline_distance(program, 0, points[i])
    rel = Pose()  # pyrefly: ignore[missing-argument]
    rel.pos = pos[i]
    rel.rot = rot[i]
    for edge in range(program.surface_edgenum[0]):
        if footprint.shadow_on_edge(program, 0, edge, rel):
            crossed[i] = True


def test_points_and_shadows_lie_in_an_outline_as_shapely_says():
    """An L with a hole: points in and out with their distances, and shadows of a hull that an edge passes through."""
    n, rng = 3000, np.random.default_rng(9)
    shape = shapely.union_all([box(*low, *high) for low, high in TILES]).simplify(1e-9)
    rings = [shapely.get_coordinates(ring) for ring in shapely.get_rings(shape)]
    sides = np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings])
    hull = rng.normal(size=(12, 3)) * [0.04, 0.03, 0.02]
    program = Program()  # pyrefly: ignore[missing-argument]
    arrays = {
        "piece_type": np.array([PieceType.HULL]),
        "piece_size": np.zeros((1, 3)),
        "piece_radius": np.array([np.linalg.norm(hull, axis=1).max()]),
        "piece_vertnum": np.array([len(hull)]),
        "piece_vertadr": np.array([0]),
        "vert": hull,
        "surface_edgeadr": np.array([0]),
        "surface_edgenum": np.array([len(sides)]),
        "edge_a": sides[:, 0],
        "edge_b": sides[:, 1],
    }
    fill_struct(Program, program, arrays, "cpu")
    points = rng.uniform(-0.5, 0.5, (n, 2))
    pos, turns = np.concatenate([points, rng.uniform(0.0, 0.5, (n, 1))], axis=1), Rotation.random(n, rng=rng)
    inputs = [program, wp.array(points, dtype=wp.vec2, device="cpu"), wp.array(pos, dtype=wp.vec3, device="cpu")]
    inputs.append(wp.array(turns.as_matrix(), dtype=wp.mat33, device="cpu"))
    out = [wp.zeros(n, dtype=kind, device="cpu") for kind in (bool, float, bool)]
    wp.launch(_outline, dim=n, inputs=inputs, outputs=out, device="cpu")
    inside, distance, crossed = (a.numpy() for a in out)
    expected = shapely.distance(shape.boundary, shapely.points(points))
    np.testing.assert_allclose(distance, expected, atol=1e-6)
    assert (inside == shapely.contains_xy(shape, points[:, 0], points[:, 1]))[expected > 1e-6].all()
    shadows = [MultiPoint((turns[i].apply(hull) + pos[i])[:, :2]).convex_hull for i in range(n)]
    slim, wide = shapely.buffer(shadows, -5e-6), shapely.buffer(shadows, 1e-6)
    assert crossed[shapely.intersects(slim, shape.boundary)].all()
    assert not crossed[~shapely.intersects(wide, shape.boundary)].any()
    assert 0.1 < crossed.mean() < 0.9


def _drawer(word: str, opening: float, geometry: str, **others) -> dict:
    cabinet = {"asset": "cabinet", "kind": "fixture", "on": "floor", "joints": {"upper": {"value": opening}}}
    goal = {"kind": "marker", word: "cabinet/upper_drawer"}
    return {"floor": FLOOR, "geometry": geometry, "objects": {"cabinet": cabinet, "goal": goal}, **others}


def _covered(compiled, rows: Rows, geometry: str) -> np.ndarray:
    """Return whether a ray of MuJoCo C straight up from the goal meets the cabinet, for each row."""
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
def test_the_cover_over_a_drawer_is_decided_by_its_opening(opening: float, geometry: str):
    """`on` draws open points, `inside` covered ones, `in` both; single refusals of `inside` are right as well."""
    rows = {}
    for word in ("on", "inside", "in"):
        compiled = compile_on_cpu(_drawer(word, opening, geometry, attempts=100))
        rows[word] = make(compiled, 300, seed=5)
        assert (rows[word].status == LayoutStatus.VALID).all()
    compiled = compile_on_cpu(_drawer("in", opening, geometry))
    covered = {word: _covered(compiled, rows[word], geometry) for word in rows}
    assert not covered["on"].any()
    assert covered["inside"].all()
    assert 0.05 < covered["in"].mean() < 0.95
    once = make(compile_on_cpu(_drawer("inside", opening, geometry, attempts=1, restarts=0)), 300, seed=5)
    assert ((once.status == LayoutStatus.VALID) == covered["in"]).all()


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_a_shut_drawer_has_no_open_sky(geometry: str):
    """The error names the object without a place, and what is overhead as the cause."""
    with pytest.raises(InfeasibleSceneError, match="'goal' could not be placed, mostly because of overhead"):
        compile_on_cpu(_drawer("on", 0.0, geometry))


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_a_cover_of_the_same_body_counts(tmp_path: Path, geometry: str):
    """A shelf covered over its right third, whose cover is a surface as well."""
    shelf = {"asset": write_mjcf(tmp_path, "shelf", SHELF), "kind": "static"}
    words = {}
    for word in ("on", "inside", "in"):
        goal = {"kind": "marker", word: "shelf"}
        words[word] = goal_points({"geometry": geometry, "objects": {"shelf": shelf, "goal": goal}}, 2000)
    covered = {word: (p[:, 0] > 0.1) & (p[:, 2] < 0.3) for word, p in words.items()}
    low = {word: p[:, 2] < 0.3 for word, p in words.items()}
    assert not covered["on"].any()
    assert covered["inside"].all()
    share = 0.4 / (0.6 + 0.2)  # the cover is 0.2 m wide, the board 0.6 m, 0.4 m of which lie open
    assert stats.binomtest(int((low["on"]).sum()), 2000, 0.4 / 0.6).pvalue > 0.001
    assert stats.binomtest(int((low["in"] & ~covered["in"]).sum()), 2000, share).pvalue > 0.001
    open_board = box(-0.3, -0.2, 0.1, 0.2)
    assert grid_p_value(words["on"][low["on"], :2], open_board, 5) > 0.001


def test_a_cover_of_another_object_does_not_count(tmp_path: Path):
    """A board that hangs over the floor does not cover a crate below it: only the support's own object is asked."""
    board = write_mjcf(tmp_path, "board", '<geom type="box" size=".4 .4 .01" pos="0 0 .5"/>')
    crate = write_mjcf(tmp_path, "crate", '<geom type="box" size=".1 .1 .1" pos="0 0 .1"/>')
    objects = {
        "board": {"asset": board, "kind": "static"},
        "crate": {"asset": crate, "kind": "static"},
        "goal": {"kind": "marker", "on": "crate"},
    }
    assert len(goal_points({"objects": objects}, 50)) == 50


@wp.kernel(enable_backward=False)
def _crosses(
    point: wp.array[wp.vec3],
    half: wp.array[wp.vec3],
    pos: wp.array[wp.vec3],
    rot: wp.array[wp.mat33],
    out: wp.array[bool],
):
    i = wp.tid()
    frame = Pose()  # pyrefly: ignore[missing-argument]
    frame.pos = pos[i]
    frame.rot = rot[i]
    out[i] = footprint._crosses_box(half[i], relative(footprint._upward(point[i]), frame))


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


def test_a_box_covers_a_point_where_a_line_straight_up_crosses_it():
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
