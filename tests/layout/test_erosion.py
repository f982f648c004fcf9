"""`ratio_on_support` shrinks a support by what the drawn orientation and joints make of the object's footprint."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from scipy import stats
from shapely.geometry import box
from shapely.geometry.base import BaseGeometry

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.related import drawer_mjcf
from tests.layout.scenes import Rows, box_mjcf, compile_on_cpu, make, posed, write_mjcf
from tests.oracle.solids import Solids
from tests.oracle.uniformity import spread_p_value

TILES = [((-0.4, -0.4), (0.0, 0.3)), ((0.0, -0.4), (0.4, 0.0))]
SHAPE = shapely.union_all([box(*low, *high) for low, high in TILES])
EDGES = (0.16, 0.1, 0.03)  # m, of the brick
N = 1500


def _slab(folder: Path) -> dict[str, Any]:
    """An L that stays where it is."""
    geoms = [
        f'<geom type="box" size="{(x1 - x0) / 2} {(y1 - y0) / 2} .03" pos="{(x0 + x1) / 2} {(y0 + y1) / 2} .03"/>'
        for (x0, y0), (x1, y1) in TILES
    ]
    return {"asset": write_mjcf(folder, "slab", "".join(geoms)), "kind": "static"}


def _brick(folder: Path) -> str:
    return box_mjcf(folder, "brick", *EDGES)


def _seen(compiled: CompiledScene, rows: Rows, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Middle and extents [m] of an object's bounds along and across its heading, by MuJoCo C, shapes (n, 2)."""
    solids, root = Solids(compiled.mjm, "physics"), compiled.mjm.body(name).id
    geoms = solids.geoms(name)
    middles, extents = [], []
    for data in posed(compiled, rows):
        x, y, _ = data.xmat[root].reshape(3, 3)[:2].T
        x = np.array([y[1], -y[0]]) if np.linalg.norm(x) < 1e-3 else x
        x /= np.linalg.norm(x)
        axes = np.stack([x, [-x[1], x[0]]])
        points = np.concatenate([solids.points(data, g) for g in geoms])[:, :2] @ axes.T
        low, high = points.min(0), points.max(0)
        middles.append(0.5 * (low + high) @ axes)
        extents.append(high - low)
    return np.array(middles), np.array(extents)


def _eroded(shape: BaseGeometry, distance: np.ndarray) -> np.ndarray:
    return np.array([shape.buffer(-d, quad_segs=64) for d in distance])


@pytest.mark.parametrize("related", [False, True], ids=["alone", "with a relation"])
def test_a_stable_pose_is_kept_from_the_edge_by_its_own_shorter_edge(related: bool, tmp_path: Path):
    """A brick that lies on any of its faces is uniform over what its own pose leaves, as often as it should be."""
    relation = {"direction": [1, 0], "of": "slab", "angle": 180}
    words = {"relations": [relation]} if related else {}
    brick = {"asset": _brick(tmp_path), "on": "slab", "orientation": "stable", "ratio_on_support": 0.9, **words}
    compiled = compile_on_cpu({"objects": {"slab": _slab(tmp_path), "brick": brick}})
    rows = make(compiled, 2 * N, seed=4)
    points, extents = _seen(compiled, rows, "brick")
    short = extents.min(1)
    reach = np.asarray(shapely.distance(SHAPE.boundary, shapely.points(points)))
    assert (reach >= 0.45 * short - 1e-5).all()
    flat = np.asarray(short > 0.09)
    assert 0.5 < flat.mean() < 0.95
    poses = compiled.plan.objects[0].stable_poses
    expected = sum(v.probability for v in poses if v.short_edge > 0.09)
    assert stats.binomtest(int(flat.sum()), len(flat), expected).pvalue > 0.001
    for some in (flat, ~flat):
        assert spread_p_value(points[some], _eroded(SHAPE, 0.45 * short[some])) > 0.001
        assert reach[np.flatnonzero(some)].min() < 0.45 * short[some].min() + 0.003


@pytest.mark.parametrize("related", [False, True], ids=["alone", "with a relation"])
def test_any_orientation_is_kept_from_the_edge_by_what_it_makes_of_the_bounds(related: bool, tmp_path: Path):
    """A brick turned any way: uniform over what is left in its own orientation, in every world another region."""
    relation = {"direction": [1, 0], "of": "slab", "angle": 180}
    words = {"relations": [relation]} if related else {}
    brick = {"asset": _brick(tmp_path), "on": "slab", "orientation": "any", "ratio_on_support": 0.8, **words}
    compiled = compile_on_cpu({"objects": {"slab": _slab(tmp_path), "brick": brick}})
    rows = make(compiled, N, seed=5)
    points, extents = _seen(compiled, rows, "brick")
    distance = 0.4 * extents.min(1)
    assert np.ptp(distance) > 0.02
    assert (shapely.distance(SHAPE.boundary, shapely.points(points)) >= distance - 1e-5).all()
    assert spread_p_value(points, _eroded(SHAPE, distance)) > 0.001


def test_the_edge_is_that_of_the_support_where_it_is_drawn(tmp_path: Path):
    """An L that is moved and turned anew in every world: seen in its frame the bricks on it keep off its edge."""
    slab = {**_slab(tmp_path), "kind": "fixture", "on": "floor"}
    brick = {"asset": _brick(tmp_path), "on": "slab", "orientation": "any", "ratio_on_support": 0.8}
    compiled = compile_on_cpu({"floor": {"size": [3.0, 3.0]}, "objects": {"slab": slab, "brick": brick}})
    rows = make(compiled, N, seed=9)
    points, extents = _seen(compiled, rows, "brick")
    poses = [
        (data.body("slab").xpos[:2].copy(), data.body("slab").xmat.reshape(3, 3)[:2, :2].copy())
        for data in posed(compiled, rows)
    ]
    local = np.array([(point - at) @ turn for point, (at, turn) in zip(points, poses, strict=True)])
    distance = 0.4 * extents.min(1)
    assert (shapely.distance(SHAPE.boundary, shapely.points(local)) >= distance - 1e-5).all()
    assert spread_p_value(local, _eroded(SHAPE, distance)) > 0.001


def test_drawn_joints_count_for_the_shorter_edge(tmp_path: Path):
    """A case of 0.3 x 0.2 m whose drawer makes it up to 0.4 m deep: what counts is the edge that it is drawn with."""
    case = {"asset": drawer_mjcf(tmp_path, "case"), "kind": "fixture", "on": "floor", "ratio_on_support": 0.6}
    case |= {"joints": {"slide": {"fraction": [0.0, 1.0]}}}
    compiled = compile_on_cpu({"floor": {"size": [1.0, 0.8]}, "objects": {"case": case}})
    rows = make(compiled, N, seed=6)
    _, extents = _seen(compiled, rows, "case")
    closed = rows.qpos.copy()
    closed[:] = 0.0
    points, _ = _seen(compiled, Rows(closed, rows.mocap_pos, rows.mocap_quat, rows.status, rows.attempts), "case")
    distance = 0.3 * extents.min(1)
    assert np.ptp(distance) > 0.02
    floor = box(-0.5, -0.4, 0.5, 0.4)
    assert (shapely.distance(floor.boundary, shapely.points(points)) >= distance - 1e-5).all()
    assert spread_p_value(points, _eroded(floor, distance)) > 0.001


def test_a_pose_that_does_not_fit_is_not_drawn_and_one_that_does_is_enough(tmp_path: Path):
    """On a board of 6 cm a brick cannot lie flat at a ratio of 1, but stand; on one of 2.5 cm it is refused."""
    for width, fits in ((0.06, True), (0.025, False)):
        board = {"asset": box_mjcf(tmp_path, f"board_{fits}", 0.5, width, 0.02), "kind": "static"}
        brick = {"asset": _brick(tmp_path), "on": "board", "orientation": "stable", "ratio_on_support": 1.0}
        scene = {"attempts": 100, "objects": {"board": board, "brick": brick}}
        if not fits:
            with pytest.raises(SceneKeyError, match="no area of the support is left"):
                compile_on_cpu(scene)
            continue
        compiled = compile_on_cpu(scene)
        generator = LayoutGenerator(compiled, 300)
        generator.generate()
        assert generator.rejection_counts()["brick"]["empty"] > 100
        _, extents = _seen(compiled, make(compiled, 300), "brick")
        assert extents.min(1).max() < 0.031


def test_the_width_of_between_is_that_of_the_drawn_pose(tmp_path: Path):
    """A brick that lies flat is drawn over a strip of its own breadth, one that stands over one of its thickness."""
    post = {"asset": box_mjcf(tmp_path, "post", 0.02, 0.02, 0.02), "kind": "fixture", "on": "floor"}
    places = {"a": (-0.6, 0.0), "b": (0.6, 0.0)}
    posts = {
        name: {**post, "region": {"box": [[x - 1e-5, y - 1e-5], [x + 1e-5, y + 1e-5]]}}
        for name, (x, y) in places.items()
    }
    relations = [{"between": ["a", "b"]}]
    for turn in ("stable", "any"):
        brick = {"asset": _brick(tmp_path), "on": "floor", "orientation": turn, "relations": relations}
        compiled = compile_on_cpu({"floor": {"size": [2.0, 1.0]}, "objects": {**posts, "brick": brick}})
        rows = make(compiled, N, seed=8)
        points, extents = _seen(compiled, rows, "brick")
        off = points[:, 1] / (0.5 * extents.min(1))
        assert np.abs(off).max() < 1.001
        assert stats.kstest(0.5 + 0.5 * off, "uniform").pvalue > 0.001


def test_what_never_changes_between_two_is_not_tried_again(tmp_path: Path):
    """Anchors far off the floor leave it empty: one attempt a start for a brick that stands, ten where it may lie."""
    far = {"kind": "marker", "region": {"box": [[3.0, -0.1, 0.0], [3.0, 0.1, 0.0]]}}
    near = {"kind": "marker", "region": {"box": [[-0.4, -0.1, 0.0], [4.0, 0.1, 0.0]]}}
    counts = {}
    for turn in ("fixed", "stable"):
        words = {"orientation": turn, "relations": [{"between": ["a", "b"]}]}
        brick = {"asset": _brick(tmp_path), "on": "floor", **words}
        objects = {"a": far, "b": near, "brick": brick}
        compiled = compile_on_cpu({"floor": {"size": [1.0, 1.0]}, "restarts": 30, "objects": objects})
        generator = LayoutGenerator(compiled, 200)
        generator.generate()
        counts[turn] = generator.rejection_counts()["brick"]["empty"]
    assert counts["stable"] == 10 * counts["fixed"] > 0


def test_a_marker_that_has_an_asset_has_no_width_of_its_own(tmp_path: Path):
    """It collides with nothing, so there is nothing to measure; seen by the eye it has bounds."""
    post = {"asset": box_mjcf(tmp_path, "post", 0.02, 0.02, 0.02), "kind": "static"}
    goal = {"asset": _brick(tmp_path), "kind": "marker", "on": "floor", "relations": [{"between": ["a", "b"]}]}
    b = {**post, "kind": "fixture", "on": "floor", "region": {"box": [[0.4, 0.4], [0.41, 0.41]]}}
    scene = {"floor": {"size": [1.0, 1.0]}, "objects": {"a": post, "b": b, "goal": goal}}
    with pytest.raises(SceneKeyError, match=r"objects\.goal\.relations\.0\.width: 'goal' has no geom"):
        compile_on_cpu(scene)
    assert (make(compile_on_cpu({**scene, "geometry": "visual"}), 20).status == 1).all()
    words = {"objects.goal.relations": [{"between": ["a", "b"], "width": 0.1}]}
    assert (make(compile_on_cpu(scene, words), 20).status == 1).all()


def test_the_audit_sees_what_is_too_near_to_the_edge(tmp_path: Path):
    """Of layouts that were made without a ratio those are misplaced that another hand finds too near to the edge."""
    objects = {"slab": _slab(tmp_path), "brick": {"asset": _brick(tmp_path), "on": "slab", "orientation": "stable"}}
    compiled, strict = (compile_on_cpu({"objects": objects}, {"objects.brick.ratio_on_support": r}) for r in (0.0, 0.9))
    points, extents = _seen(compiled, make(compiled, 600), "brick")
    spare = shapely.distance(SHAPE.boundary, shapely.points(points)) - 0.45 * extents.min(1)
    assert np.abs(spare).min() > 2e-5
    found = Auditor(strict.mjm, strict.config, strict.scene.bodies).judge(make_table(compiled, 600, 0)).misplaced
    assert [m.row for m in found] == np.flatnonzero(spare < 0).tolist()
    assert {m.cause for m in found} == {"support"}
