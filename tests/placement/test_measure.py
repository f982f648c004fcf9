"""Orientations are drawn as the scene says; pivots and bounds of drawn joint states are as MuJoCo C poses them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from scipy import stats
from scipy.spatial.transform import Rotation

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.audit.geometry import poses_of
from sceniris_gym.audit.scene import Outline
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.geometry.rotations import matrix
from sceniris_gym.placement.measure import StableDraw, bounds_of, measure
from sceniris_gym.program.compiled import CompiledScene, upload_scene
from sceniris_gym.program.device import Program
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.layout_table import LayoutTable
from tests.layout.related import Shapes, drawer_mjcf, judged, near_middle, related, scene, table_of
from tests.layout.scenes import ANYWHERE
from tests.oracle.solids import Solids

wp.set_module_options({"enable_backward": False})

N = 200


@wp.kernel
def _measure(
    program: Program,
    quat: wp.array[wp.vec4],
    qpos: wp.array2d[float],
    place: wp.array[wp.vec4],
    # Out:
    body_pos: wp.array2d[wp.vec3],
    body_quat: wp.array2d[wp.vec4],
    pivot: wp.array[wp.vec3],
    bounds: wp.array[wp.vec4],
    around: wp.array[wp.vec4],
):
    """Measure object 0 in an orientation of heading 0, and its bounds around another pivot in another heading."""
    i = wp.tid()
    drawn = StableDraw()  # pyrefly: ignore[missing-argument]
    drawn.quat = quat[i]
    drawn.pivot = program.stable_pivot[0]
    drawn.bounds = program.stable_bounds[0]
    drawn = measure(program, 0, drawn, qpos[i], body_pos[i], body_quat[i])
    pivot[i] = drawn.pivot
    bounds[i] = drawn.bounds
    around[i] = bounds_of(program, 0, place[i], body_pos[i], body_quat[i])


def _compiled(folder: Path, orientation: Any, geometry: str) -> CompiledScene:
    chest = {"asset": drawer_mjcf(folder, "chest"), "region": {"box": ANYWHERE}, "orientation": orientation}
    chest |= {"joints": {"slide": {"fraction": [0.0, 1.0]}}}
    mark = {"kind": "marker", "region": {"box": ANYWHERE}}
    mark |= {"relations": [{"near": "chest", "distance": {"max": 2.0}, "measure": "bounds"}]}
    config = {"geometry": geometry, "objects": {"chest": chest, "mark": mark}}
    return upload_scene(build_model(SceneConfig.load(config)), "cpu")


@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize("orientation", ["any", {"yaw": [-20, 60]}])
def test_pivot_and_bounds_are_those_of_the_drawn_state(orientation: Any, geometry: str, tmp_path: Path):
    """The lowest point always; sideways the pivot is drawn anew for `any` alone, and stays that of home for others."""
    compiled, rng = _compiled(tmp_path, orientation, geometry), np.random.default_rng(5)
    mjm, program, solids = compiled.mjm, compiled.program, Solids(compiled.mjm, geometry)
    data, slide = mujoco.MjData(mjm), int(mjm.joint("chest/slide").qposadr[0])
    free = int(mjm.joint("chest/free").qposadr[0])
    turns = Rotation.random(N, rng=rng) if orientation == "any" else Rotation.identity(N)
    quat = turns.as_quat(scalar_first=True)
    qpos = np.tile(compiled.home_qpos, (N, 1))
    qpos[:, slide] = rng.uniform(0.0, 0.2, N)
    place = np.concatenate([rng.uniform(-1.0, 1.0, (N, 3)), rng.uniform(-3.0, 3.0, (N, 1))], axis=1)
    inputs = [program, wp.array(quat, dtype=wp.vec4, device="cpu"), wp.array(qpos, dtype=float, device="cpu")]
    inputs.append(wp.array(place, dtype=wp.vec4, device="cpu"))
    poses = [wp.zeros((N, mjm.nbody), dtype=kind, device="cpu") for kind in (wp.vec3, wp.vec4)]
    out = [wp.zeros(N, dtype=kind, device="cpu") for kind in (wp.vec3, wp.vec4, wp.vec4)]
    wp.launch(_measure, dim=N, inputs=inputs, outputs=[*poses, *out], device="cpu")
    pivot, bounds, around = (a.numpy() for a in out)
    home = program.stable_pivot.numpy()[0]
    for i in range(N):
        data.qpos[:] = qpos[i]
        data.qpos[free : free + 7] = [0.0, 0.0, 0.0, *quat[i]]
        mujoco.mj_kinematics(mjm, data)
        points = np.concatenate([solids.points(data, geom) for geom in solids.geoms("chest")])
        low, high = points.min(0), points.max(0)
        bottom = np.array([*(low + high)[:2] / 2.0, low[2]]) if orientation == "any" else [home[0], home[1], low[2]]
        np.testing.assert_allclose(turns[i].apply(pivot[i]), bottom, atol=2e-6)
        np.testing.assert_allclose(bounds[i], [*(low - bottom)[:2], *(high - bottom)[:2]], atol=2e-6)
        seen = Rotation.from_rotvec([0.0, 0.0, -place[i, 3]]).apply(points - place[i, :3])
        np.testing.assert_allclose(around[i], [*seen.min(0)[:2], *seen.max(0)[:2]], atol=4e-6)


DRAWN = 2000


@pytest.fixture(scope="module")
def shapes(tmp_path_factory) -> Shapes:
    """Assets that touch nothing: nothing but the draw decides how an object is turned."""
    return Shapes(tmp_path_factory.mktemp("shapes"), airy=True)


def drawn(
    objects: dict[str, Any], n: int = DRAWN, **words: Any
) -> tuple[CompiledScene, LayoutTable, dict[str, Outline]]:
    """Make layouts in which the audit finds nothing broken; also return what objects look like from above."""
    compiled = scene(objects, **words)
    table = table_of(compiled, n)
    broken = [k for k in judged(compiled, table) if k.broken]
    assert not broken, broken
    outlines = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies).outlines
    poses = poses_of(compiled.mjm, table)
    return compiled, table, {name: outlines.outline(name, poses) for name in objects}


def rotations(compiled: CompiledScene, table: LayoutTable, name: str) -> Rotation:
    """The orientations of a free object."""
    adr = compiled.mjm.joint(f"{name}/free").qposadr[0]
    return Rotation.from_quat(table.qpos[:, adr + 3 : adr + 7], scalar_first=True)


@pytest.mark.parametrize("yaw", [[-180, 180], [-30, 80], [150, 230], [90, 90], [-500, -200]], ids=str)
def test_a_yaw_is_uniform_in_its_interval(yaw: list[float], shapes: Shapes):
    """In the frame of a support that is turned itself, across 180 degrees too."""
    slab = near_middle(shapes.slab, orientation={"yaw": [-180, 180]})
    thing = {"asset": shapes.odd, "on": "slab", "orientation": {"yaw": yaw}}
    _, _, seen = drawn({"slab": slab, "thing": thing})
    low, high = np.radians(yaw)
    share = np.mod(seen["thing"].heading - seen["slab"].heading - low + 1e-6, 2 * np.pi) / max(high - low, 1e-3)
    assert stats.kstest(share, "uniform").pvalue > 0.001 or low == high


@pytest.mark.parametrize("where", [{"on": "floor"}, {"region": {"box": [[-0.5, -0.5, 0.5], [0.5, 0.5, 1.0]]}}], ids=str)
def test_any_is_uniform_over_all_rotations(where: dict, shapes: Shapes):
    """Angles to fixed rotations have the density (1 - cos) / pi, and every axis points anywhere."""
    compiled, table, _ = drawn({"thing": {"asset": shapes.odd, "orientation": "any", **where}}, 4000)
    turned = rotations(compiled, table, "thing")
    for fixed in ([0, 0, 0], [1, 0, 0], [0, 2, 0], [1, -1, 2]):
        angle = (Rotation.from_rotvec(fixed) * turned).magnitude()
        assert stats.kstest((angle - np.sin(angle)) / np.pi, "uniform").pvalue > 0.001
    for axis in np.eye(3):
        ends = turned.apply(axis)
        for along in range(3):
            assert stats.kstest(ends[:, along], "uniform", args=(-1, 2)).pvalue > 0.001
        turn = np.arctan2(ends[:, 1], ends[:, 0])
        assert stats.kstest(turn, "uniform", args=(-np.pi, 2 * np.pi)).pvalue > 0.001


@pytest.mark.parametrize(
    ("asset", "geometry"), [("odd", "physics"), ("mug", "physics"), ("banana", "physics"), ("banana", "visual")]
)
def test_stable_poses_are_drawn_by_their_probabilities(asset: str, geometry: str, shapes: Shapes):
    """Each drawn orientation is one of them, turned about the vertical by any angle."""
    thing = {"asset": getattr(shapes, asset, asset), "on": "floor", "orientation": "stable"}
    compiled, table, seen = drawn({"thing": thing}, 4000, geometry=geometry)
    poses = compiled.plan.objects[0].stable_poses
    ups = np.array([matrix(p.quat)[2] for p in poses])
    cosines = rotations(compiled, table, "thing").as_matrix()[:, 2] @ ups.T
    assert cosines.max(1).min() > 1 - 1e-6
    probabilities = np.array([p.probability for p in poses])
    counts = np.bincount(cosines.argmax(1), minlength=len(poses))
    common = probabilities * len(table) >= 5
    if not common.all():
        counts = np.append(counts[common], counts[~common].sum())
        probabilities = np.append(probabilities[common], probabilities[~common].sum())
    assert stats.chisquare(counts, probabilities / probabilities.sum() * len(table)).pvalue > 0.001
    share = np.mod(seen["thing"].heading, 2 * np.pi) / (2 * np.pi)
    assert stats.kstest(share, "uniform").pvalue > 0.001


def test_a_stable_pose_keeps_its_yaw_whatever_is_up(shapes: Shapes):
    """An L that stands on an end, with its x axis straight up, has a heading too, which relations see."""
    lies = {"asset": shapes.odd, "on": "floor", "orientation": {"stable": {"yaw": [-30, 80]}}}
    beside = {"beside": "a", "side": "right"}
    compiled, table, _ = drawn({"a": lies, "thing": related(shapes.odd, beside, orientation="stable")})
    upright = np.abs(rotations(compiled, table, "a").as_matrix()[:, 2, 0]) > 0.999
    assert upright.sum() > 50


@pytest.mark.parametrize("yaw", [[0, 0], [-30, 60], [170, 200]], ids=str)
def test_what_faces_something_does_so_from_every_side(yaw: list[float], shapes: Shapes):
    """All around the target, with an offset that crosses 180 degrees too; the audit measures the angle."""
    around = {"near": "a", "distance": {"min": 0.2, "max": 0.5}}
    turn = {"face_to": "a", "yaw": yaw}
    others = {"a": near_middle(shapes.odd)}
    _, _, seen = drawn({**others, "thing": related(shapes.odd, around, orientation=turn)})
    at = seen["thing"].pivot - seen["a"].pivot
    assert stats.kstest(np.arctan2(at[:, 1], at[:, 0]), "uniform", args=(-np.pi, 2 * np.pi)).pvalue > 0.001


def test_what_faces_something_is_measured_as_it_is_turned(shapes: Shapes):
    """A distance between bounds depends on the heading, which depends on the place."""
    ring = {"near": "a", "measure": "bounds", "distance": {"min": 0.05, "max": 0.08}}
    drawn({"a": near_middle(shapes.bar), "thing": related(shapes.bar, ring, orientation={"face_to": "a"})})


def test_an_object_in_space_faces_a_target(shapes: Shapes):
    """In a 3D box, upright."""
    box = {"box": [[-0.5, -0.5, 0.5], [0.5, 0.5, 1.0]]}
    drawn(
        {"a": near_middle(shapes.bar), "thing": {"asset": shapes.odd, "region": box, "orientation": {"face_to": "a"}}}
    )


@pytest.mark.parametrize("ratio", [0.5, 1.0])
@pytest.mark.parametrize("turn", ["stable", "any", {"yaw": [-180, 180]}], ids=str)
def test_the_footprint_counts_in_the_drawn_orientation(turn: Any, ratio: float, shapes: Shapes):
    """An L on a small slab: at ratio 1 its whole shadow lies on it, whatever way it lies."""
    slab = {"asset": shapes.lid, "kind": "fixture", "on": "floor", "region": {"box": [[-0.5, -0.5], [0.5, 0.5]]}}
    thing = {"asset": shapes.odd, "on": "slab/lid", "orientation": turn, "ratio_on_support": ratio}
    compiled = scene({"slab": slab, "thing": thing}, attempts=40)
    table = table_of(compiled, 500)
    report = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies).judge(table, settled=60)
    assert not report.misplaced
    assert not report.relation_violations
