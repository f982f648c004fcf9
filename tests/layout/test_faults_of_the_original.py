"""Faults of the original Sceniris that this generator must not have, each by its name."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.errors import InfeasibleSceneError, SceneKeyError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.tables import make_table
from tests.layout.related import Shapes, judged, near_middle, related, scene, table_of
from tests.layout.scenes import FLOOR, box_mjcf, compile_on_cpu, make


@pytest.fixture(scope="module")
def shapes(tmp_path_factory) -> Shapes:
    """The assets."""
    return Shapes(tmp_path_factory.mktemp("shapes"))


def test_an_articulated_object_is_tested_in_its_drawn_state_not_in_its_default_pose(shapes: Shapes):
    """A cube keeps off a drawer that is drawn out by 10 to 20 cm, and stands where the shut drawer's case is not."""
    case = near_middle(shapes.drawer, joints={"slide": {"fraction": [0.5, 1.0]}}, orientation="fixed")
    cube = {"asset": shapes.cube, "on": "floor", "region": {"box": [[-0.3, -0.45], [0.3, 0.2]]}}
    compiled = scene({"case": case, "cube": cube})
    generator = LayoutGenerator(compiled, 1000)
    generator.generate()
    assert generator.rejection_counts()["cube"]["collision"] > 200
    report = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies).judge(make_table(compiled, 1000, 0))
    assert not report.conflicts
    assert report.depth < 1e-4


@pytest.mark.parametrize("angle", [20, 90, 140])
def test_wedges_do_not_break_across_180_degrees(angle: float, shapes: Shapes):
    """To the left of something, which is at 180 degrees: both halves of the wedge are used, and nothing else."""
    relation = {"left_of": "a", "frame": "world", "angle": angle, "distance": {"max": 0.5}}
    compiled = scene({"a": near_middle(shapes.cube), "q": related(None, relation, kind="marker")})
    table = table_of(compiled, 2000)
    assert not [k for k in judged(compiled, table) if k.broken]
    above = table.mocap_pos[:, -1, 1] > table.mocap_pos[:, 0, 1]
    assert 900 < above.sum() < 1100


def test_a_failed_world_does_not_switch_an_object_off_in_all_worlds(shapes: Shapes):
    """If one world in three fails, the others have all objects in the room, as if they were alone."""
    cubes = {name: {"asset": shapes.cube, "on": "floor"} for name in "abc"}
    compiled = scene(cubes, floor={"size": [0.15, 0.15]}, attempts=2, restarts=0)
    generator = LayoutGenerator(compiled, 300)
    generator.generate()
    valid = generator.layouts.status.numpy() == LayoutStatus.VALID
    assert 10 < valid.sum() < 290
    assert generator.layouts.present.numpy().all()
    at = generator.layouts.qpos.numpy().reshape(300, 3, 7)[:, :, :3]
    assert np.abs(at[:, :, :2]).max() < 0.12
    for i in np.flatnonzero(valid)[:5]:
        assert make(compiled, 1, seed=int(i)).qpos.tobytes() == generator.layouts.qpos.numpy()[i].tobytes()


def test_a_support_eroded_to_nothing_is_no_valid_pose_at_the_origin(shapes: Shapes):
    """By erosion it is refused when the scene is compiled; by relations, in some worlds, it is a failed attempt."""
    on_cube = {"asset": shapes.slab, "on": "cube", "ratio_on_support": 0.9}
    with pytest.raises(SceneKeyError, match="no area of the support is left"):
        scene({"cube": near_middle(shapes.cube), "slab": on_cube})
    away = {"near": "a", "distance": {"min": 1.6, "max": 1.7}}
    others = {"a": {"asset": shapes.cube, "kind": "fixture", "on": "floor"}}
    compiled = scene({**others, "q": related(shapes.cube, away)}, restarts=0)
    table = make_table(compiled, 400, 0)
    assert 0.1 < table.valid.mean() < 0.99
    assert np.linalg.norm(table.qpos[:, :2] - table.mocap_pos[:, 0, :2], axis=1).min() > 1.59
    with pytest.raises(InfeasibleSceneError, match="empty"):
        scene({"a": near_middle(shapes.cube), "q": related(shapes.cube, {**away, "distance": {"equal": 5.0}})})


def test_face_to_is_a_proper_rotation_and_does_not_scale(shapes: Shapes):
    """Unit quaternions, upright, however far away the target is; the object is as large as it was."""
    near = {"near": "a", "distance": {"min": 0.1, "max": 0.9}}
    thing = related(shapes.odd, near, orientation={"face_to": "a"})
    compiled = scene({"a": near_middle(shapes.cube), "q": thing})
    table = table_of(compiled, 1000)
    quat = table.qpos[:, 3:7].astype(float)
    np.testing.assert_allclose(np.linalg.norm(quat, axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose(quat[:, 1:3], 0.0, atol=1e-7)
    assert not [k for k in judged(compiled, table) if k.broken]


def test_thin_parts_are_not_missed(tmp_path):
    """Bars of 2 mm, which spheres cannot fill: no pair of them crosses in 2,000 layouts."""
    bar = box_mjcf(tmp_path, "bar", 0.3, 0.002, 0.05)
    bars = {f"bar_{i}": {"asset": bar, "on": "floor"} for i in range(4)}
    compiled = compile_on_cpu({"floor": FLOOR, "objects": bars, "attempts": 30})
    generator = LayoutGenerator(compiled, 2000)
    generator.generate()
    assert generator.rejection_counts()["bar_3"]["collision"] > 200
    report = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies).judge(make_table(compiled, 2000, 0))
    assert not report.conflicts
    assert report.depth < 1e-4


def test_it_can_be_seeded(shapes: Shapes):
    """The same seed gives the same bits, another one others, with relations, groups and all orientations."""
    objects = {
        "a": near_middle(shapes.odd),
        "b": {"asset": shapes.odd, "on": "floor", "orientation": "stable"},
        "c": related(shapes.bar, {"between": ["a", "b"], "width": 0.2}, orientation={"face_to": "a"}),
        "d": related(shapes.cube, {"near": "a", "distance": {"max": 0.6}}, orientation="any"),
    }
    compiled = scene(objects, groups={"some": {"of": ["b", "d"], "count": [0, 2], "missing": "drop"}})
    first = make(compiled, 50, seed=3)
    assert make(compiled, 50, seed=3).bits() == first.bits()
    rows = {row.tobytes() for row in make(compiled, 50, seed=1000).qpos} | {row.tobytes() for row in first.qpos}
    assert len(rows) == 100
    few = make(compiled, 7, seed=[3 + i for i in (9, 4, 30, 0, 49, 22, 1)])
    assert [row.tobytes() for row in few.qpos] == [first.qpos[i].tobytes() for i in (9, 4, 30, 0, 49, 22, 1)]
