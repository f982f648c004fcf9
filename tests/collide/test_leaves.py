"""Pairs of leaves: round primitives are exact, faces without area are nothing, and far planes are met."""

from __future__ import annotations

import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.errors import ModelWarning
from sceniris_gym.layout.generate import LayoutGenerator
from tests.layout.scenes import Rows, box_mjcf, collisions, compile_on_cpu, make, posed, read, valid, write_mjcf
from tests.versions import OLD


def test_faces_without_area_are_no_obstacles(tmp_path: Path):
    """A cube with a vertex in the middle of an edge, closed by a face without area: it has the layouts of the cube.

    It is turned, so that the box around that face is a large one.
    """
    corners = [(x, y, z) for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.1, 0.1)]
    vertices = " ".join(f"{v}" for corner in (*corners, (-0.1, -0.1, 0.0)) for v in corner)
    sides = "0 2 6 0 6 4 1 5 7 1 7 3 2 3 7 2 7 6 4 6 7 4 7 5"
    cubes = {"whole": "0 1 3 0 3 2 0 4 5 0 5 1", "split": "0 1 3 0 3 2 0 4 8 8 4 5 8 5 1 0 8 1"}
    pea = {"asset": box_mjcf(tmp_path, "pea", 0.01, 0.01, 0.01)}
    around = {"region": {"box": [[-0.3, -0.3, -0.1], [0.3, 0.3, 0.1]]}}
    hits = []
    for name, faces in cubes.items():
        rest = f'<asset><mesh name="cube" vertex="{vertices}" face="{sides} {faces}"/></asset>'
        asset = write_mjcf(tmp_path, name, '<geom name="cube" type="mesh" mesh="cube" euler="30 40 20"/>', rest)
        scene = {"geometry": "visual", "objects": {"cube": {"asset": asset, "kind": "static"}, "pea": pea | around}}
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            hits.append(collisions(scene, "pea", 2000)[0])
        assert [w.category for w in caught] == [ModelWarning] * (name == "split")
    assert hits[0] == hits[1]
    assert 150 < hits[0] < 700


@pytest.mark.parametrize("wall", ["ball", "pill", "drum", "egg", "box", "gem"])
@pytest.mark.parametrize("other", ["ball", "pill", "drum", "egg"])
def test_round_primitives_are_exact_as_they_are_seen(tmp_path: Path, wall: str, other: str):
    """Half a metre large, around each other and around a mesh: MuJoCo C finds them apart by their clearance.

    Its distances are good to 0.1 mm where both are curved; as inscribed meshes they would be off by up to 2 mm.
    """
    if OLD and {"ball", "pill"}.isdisjoint({wall, other}):
        pytest.skip("MuJoCo before 4.0: mj_geomDistance says 0 of some cylinders and ellipsoids that are far apart")
    shapes = {
        "ball": '<geom type="sphere" size=".5"/>',
        "pill": '<geom type="capsule" size=".4 .3"/>',
        "drum": '<geom type="cylinder" size=".5 .3"/>',
        "egg": '<geom type="ellipsoid" size=".5 .3 .4"/>',
        "box": '<geom type="box" size=".5 .3 .4"/>',
        "gem": '<geom type="mesh" mesh="gem"/>',
    }
    gem = '<asset><mesh name="gem" vertex=".5 0 0 -.5 0 0 0 .5 0 0 -.5 0 0 0 .5 0 0 -.5"/></asset>'
    paths = [write_mjcf(tmp_path, name, shapes[name], gem) for name in (wall, other)]
    a, b = {"asset": paths[0]}, {"asset": paths[1]}
    near = {"box": [[-1.2, -1.2, -1.2], [1.2, 1.2, 1.2]]}
    a |= {"region": {"box": [[0, 0, 0], [0, 0, 0]]}, "orientation": "any", "clearance": 0.0}
    b |= {"region": near, "orientation": "any", "clearance": 0.001}
    scene = {"geometry": "visual", "attempts": 40, "restarts": 0, "objects": {"a": a, "b": b}}
    compiled = compile_on_cpu(scene, bank=1)
    generator = LayoutGenerator._recording(compiled, 500, rejected=20_000)
    generator.generate()
    view = generator.layouts.view
    count = int(view.rejected_count.numpy()[0])
    poses = [v.numpy()[:count] for v in (view.rejected_qpos, view.rejected_mocap_pos, view.rejected_mocap_quat)]
    judged = []
    for rows in (valid(read(generator.layouts)), Rows(*poses, *[np.zeros(count)] * 2)[:500]):
        geoms = [int(compiled.mjm.body_geomadr[compiled.mjm.body(n).id]) for n in "ab"]
        judged.append(
            np.array([mujoco.mj_geomDistance(compiled.mjm, d, *geoms, 1.0, None) for d in posed(compiled, rows)])
        )
    accepted, rejected = judged
    slack = 1e-5 if {wall, other} <= {"ball", "pill", "box"} else 1e-4
    assert len(accepted) > 200
    assert len(rejected) > 50
    assert 0.001 - slack <= accepted.min() < 0.05
    assert rejected.max() <= 0.001 + slack


@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize(("half", "share"), [(60.0, 0.9), (450.0, 0.9), (880.0, 0.0)])
def test_things_keep_off_what_reaches_far_to_what_single_precision_resolves(
    tmp_path: Path, half: float, share: float, geometry: str
):
    """Up to 128 m nothing is deeper in it than the skin; beyond, no deeper than numbers of that size resolve."""
    turn = np.radians(33.0)
    along = np.array([np.cos(turn), np.sin(turn)])
    x, y = half * share * along
    (tmp_path / "own.xml").write_text(
        f"""<mujoco><worldbody><body name="wall" pos="{x} {y} .5" euler="0 0 33">
        <geom name="wall" type="box" size="{half} .05 .5"/></body>
        <body name="crate"><freejoint/><geom type="box" size=".05 .05 .05"/></body></worldbody></mujoco>"""
    )
    crate = {"on": "floor", "clearance": 0.0, "region": {"box": [[-0.12, -0.12], [0.12, 0.12]]}}
    words = {"model": str(tmp_path / "own.xml"), "geometry": geometry, "floor": {"size": [1, 1]}}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)
        rows = make(compile_on_cpu({**words, "objects": {"crate": crate}}), 20_000)
    mats = Rotation.from_quat(rows.qpos[:, 3:7].astype(float), scalar_first=True).as_matrix()
    across = np.array([-along[1], along[0]])
    middle = rows.qpos[:, :2].astype(float) @ across
    size = 0.05 * np.abs(np.einsum("nij,i->nj", mats[:, :2], across)).sum(axis=1)
    gap = np.abs(middle) - size - 0.05
    reach = half * (1.0 + share) * along[0]
    assert gap.min() < 2e-4  # they come close
    assert gap.min() > -max(1e-5, float(np.spacing(np.float32(reach))))


def test_sizes_that_a_primitive_has_no_use_for_mean_nothing(tmp_path: Path):
    """MuJoCo keeps them as they are written, also negative ones: balls of 0.1 m keep their distance all the same."""
    ball = write_mjcf(tmp_path, "ball", '<geom type="sphere" size=".05 -1 -1"/>')
    balls = {f"ball_{i}": {"asset": ball, "on": "floor"} for i in range(6)}
    rows = valid(make(compile_on_cpu({"floor": {"size": [0.6, 0.6]}, "objects": balls}), 256))
    at = rows.qpos.reshape(-1, 6, 7)[:, :, :3]
    apart = np.linalg.norm(at[:, :, None] - at[:, None], axis=3)[:, ~np.eye(6, dtype=bool)]
    assert len(rows.qpos) > 200
    assert apart.min() >= 0.1


def test_what_is_refused_beside_a_long_wall_is_in_its_way(tmp_path: Path):
    """Blocks hang over a wall of 40 m by at most 0.2 mm: MuJoCo finds those that are refused within 0.02 mm of it."""
    wall = write_mjcf(tmp_path, "wall", '<geom type="box" size="20 .2 .15" pos="0 0 .15"/>')
    block = write_mjcf(tmp_path, "block", '<geom type="box" size=".03 .02 .05"/>')
    over = {"region": {"box": [[-19, -0.1, 0.3], [19, 0.1, 0.3002]]}, "orientation": "any", "clearance": 0.0}
    objects = {"wall": {"asset": wall, "kind": "static", "clearance": 0.0}, "block": {"asset": block, **over}}
    compiled = compile_on_cpu({"objects": objects, "attempts": 1, "restarts": 0}, bank=1)
    generator = LayoutGenerator._recording(compiled, 20000, rejected=5000)
    generator.generate()
    view, mjm = generator.layouts.view, compiled.mjm
    count, data = int(view.rejected_count.numpy()[0]), mujoco.MjData(compiled.mjm)
    assert 200 < count < 3000
    for row in view.rejected_qpos.numpy()[:count]:
        data.qpos[:] = row
        mujoco.mj_kinematics(mjm, data)
        assert mujoco.mj_geomDistance(mjm, data, 0, 1, 1.0, None) < 2e-5
