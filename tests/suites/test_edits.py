"""Edits of layouts: how far objects move, what moves with them, and what refuses an edit."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym import LayoutGenerator, compile_scene
from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.commands.replay import replay
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.claims import judge_reach, reach_claims
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.suites.edits import Editor
from tests.layout.scenes import box_mjcf
from tests.suites.conftest import WIDE
from tests.vector.conftest import SCENE

NUMBER, SEED = 8, 1 << 40


def nominal(compiled) -> LayoutTable:
    """Return the nominal layouts, without params."""
    generator = LayoutGenerator(compiled, NUMBER, seed=SEED, split="eval")
    generator.generate()
    return generator.table()


def turn(after: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Return the rotation between two quaternions in the world's frame [degrees], by MuJoCo C."""
    both, found, back = np.zeros(4), np.zeros(3), before.astype(float) * [1, -1, -1, -1]
    mujoco.mju_mulQuat(both, after.astype(float), back)
    mujoco.mju_quat2Vel(found, both, 1.0)
    return np.degrees(found)


def test_objects_move_by_the_grade_within_their_regions():
    """By 3 g cm, or to the edge of the region; by 18 g degrees about the vertical. All else stays within 0.02 mm."""
    compiled = compile_scene(WIDE, "cpu")
    table, editor = nominal(compiled), Editor(compiled, {}, NUMBER, SEED)
    adr = {
        name: compiled.mjm.jnt_qposadr[compiled.mjm.body_jntadr[body]] for name, body in compiled.scene.bodies.items()
    }
    auditor, seen = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies), set()
    for axis, grade in (("shift", 1), ("shift", 5), ("turn", 2)):
        cases, _ = editor.edits(axis, grade, 6)
        assert cases
        for case in cases:
            made, i = replay(compiled, LayoutId.parse(case.id)), LayoutId.parse(case.id).seed - SEED
            assert made.valid.all()
            report = auditor.judge(made)
            assert not report.conflicts
            assert not report.misplaced
            before, after, still = table.qpos[i], made.qpos[0], np.ones(compiled.mjm.nq, bool)
            seen.add((axis, bool(case.tags)))
            for name, edit in (case.edits or {}).items():
                at = adr[name]
                still[at : at + 7] = False
                away = after[at : at + 3] - before[at : at + 3]
                assert abs(away[2]) < 1e-6
                if axis == "turn":
                    assert turn(after[at + 3 : at + 7], before[at + 3 : at + 7]) == pytest.approx(
                        [0, 0, edit["turn"]], abs=1e-2
                    )
                    assert abs(edit["turn"]) == pytest.approx(36.0)
                else:
                    assert away[:2] == pytest.approx(edit["shift"], abs=2e-5)
                    assert case.tags or np.hypot(*edit["shift"]) == pytest.approx(0.03 * grade)
                    assert np.hypot(*edit["shift"]) <= 0.03 * grade + 1e-6
            np.testing.assert_allclose(after[still], before[still], atol=2e-5)
            np.testing.assert_array_equal(made.present[0], table.present[i])
    assert {("shift", True), ("shift", False), ("turn", False)} <= seen


def test_grasps_are_found_again():
    """The audit, which shares no code with the search of joints, accepts the grasp, and the arm's joints in it."""
    compiled = compile_scene("drawer_pick", "cpu")
    (case,), _ = Editor(compiled, {}, 4, SEED).edits("shift", 1, 1)
    made, before = replay(compiled, LayoutId.parse(case.id)), nominal(compiled)[LayoutId.parse(case.id).seed - SEED]
    adr = compiled.mjm.jnt_qposadr[compiled.mjm.body_jntadr[compiled.scene.bodies["banana"]]]
    moved = made.qpos[0, adr : adr + 2] - before.qpos[0, adr : adr + 2]
    assert np.hypot(*moved) == pytest.approx(np.hypot(*(case.edits or {})["banana"]["shift"]), abs=3e-5)
    assert (made.grasp_qpos != before.grasp_qpos)[0, 0, :7].any()
    assert judge_reach(compiled, made, reach_claims(compiled, made)) == []
    assert [found.name for found in judge_reach(compiled, made, reach_claims(compiled, before))] == ["banana"]


def test_yaws_end_where_the_scene_file_says():
    """An edit ends there, and says so. Without room, the layout is refused."""
    narrow = SceneConfig.load(SCENE, {"objects.block.orientation": {"yaw": [-15, 15]}})
    cases, _ = Editor(compile_scene(narrow, "cpu"), {}, NUMBER, SEED).edits("turn", 2, 4)
    assert {case.tags for case in cases} == {("clipped",)}
    assert all(abs((case.edits or {})["block"]["turn"]) < 36.0 for case in cases)
    fixed = compile_scene(SceneConfig.load(SCENE, {"objects.block.orientation": "fixed"}), "cpu")
    cases, refused = Editor(fixed, {}, NUMBER, SEED).edits("turn", 2, 4)
    assert (cases, list(refused)) == ([], ["turn 2: no object has room"])


def test_objects_with_relations_are_drawn_again():
    """Params cannot fix them, so the case has a tag. They keep their relations."""
    near = {"asset": "can", "on": "floor", "relations": [{"near": "block", "distance": {"max": 0.3}}]}
    compiled = compile_scene(SceneConfig.load(SCENE, {"objects.can": near}), "cpu")
    cases, _ = Editor(compiled, {}, NUMBER, SEED).edits("shift", 3, 4)
    assert len(cases) == 4
    for case in cases:
        assert "redrawn" in case.tags
        assert list(case.edits or {}) == ["block"]
        report = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies).judge(
            replay(compiled, LayoutId.parse(case.id))
        )
        assert not (report.conflicts or report.misplaced or report.relation_violations)


def test_scenes_without_objects_to_move_are_refused():
    """Regions that are no boxes, and starts, which place objects themselves."""
    points = {"objects.block.region": {"points": [[0.0, 0.5], [0.1, -0.5]]}}
    with pytest.raises(ArgumentError, match="should have a free object with a box and a yaw"):
        Editor(compile_scene(SceneConfig.load(SCENE, points), "cpu"), {}, 1, 0)
    with pytest.raises(ArgumentError, match="should have no 'start'"):
        Editor(compile_scene(SceneConfig.load("drawer_pick", {"start": [{"robot": "home"}]}), "cpu"), {}, 1, 0)


def test_an_edit_that_always_collides_names_the_object(tmp_path: Path):
    """A bar between two cans cannot be crosswise."""
    bar, spot = box_mjcf(tmp_path, "bar", 0.2, 0.02, 0.02), {"box": [[0.0, 0.0], [0.001, 0.001]]}
    cans = {
        name: {"asset": "can", "kind": "fixture", "on": "floor", "region": {"box": [[0, y], [0.001, y + 0.001]]}}
        for name, y in (("left", 0.058), ("right", -0.058))
    }
    objects = {**cans, "bar": {"asset": bar, "on": "floor", "region": spot}}
    compiled = compile_scene({"floor": {"size": [1, 1]}, "objects": objects, "bank": 4}, "cpu")
    cases, refused = Editor(compiled, {}, 4, SEED).edits("turn", 5, 2)
    assert (cases, refused) == ([], {"turn 5: bar: collision": 4})


def test_objects_on_an_object_move_with_it():
    """Their pose in its frame stays the same, and only the object below has an edit."""
    objects = {
        "tray": {"asset": "plate", "on": "floor", "region": {"box": [[-0.5, -0.5], [0.5, 0.5]]}},
        "can": {"asset": "can", "on": "tray"},
    }
    compiled = compile_scene({"floor": {"size": [2, 2]}, "objects": objects, "bank": 4}, "cpu")
    data, table, editor = mujoco.MjData(compiled.mjm), nominal(compiled), Editor(compiled, {}, NUMBER, SEED)

    def relative(one):
        one.put(data, 0)
        mujoco.mj_kinematics(compiled.mjm, data)
        tray, can = (compiled.scene.bodies[name] for name in ("tray", "can"))
        mat = data.xmat[tray].reshape(3, 3).T
        return mat @ (data.xpos[can] - data.xpos[tray]), mat @ data.xmat[can].reshape(3, 3), data.xpos[can].copy()

    for axis in ("shift", "turn"):
        (case,), _ = editor.edits(axis, 3, 1)
        assert list(case.edits or {}) == ["tray"]
        made, row = replay(compiled, LayoutId.parse(case.id)), table[LayoutId.parse(case.id).seed - SEED]
        for before, after in zip(relative(row)[:2], relative(made)[:2], strict=True):
            np.testing.assert_allclose(after, before, atol=2e-5)
        assert np.abs(relative(made)[2] - relative(row)[2]).max() > 1e-4
