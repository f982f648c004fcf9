"""Edits of layouts: how far objects move, what moves with them, and what refuses an edit."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from sceniris_gym import LayoutGenerator, compile_scene
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.claims import judge_reach, reach_claims
from sceniris_gym.suites.edits import Edited, Editor
from tests.suites.conftest import WIDE
from tests.vector.conftest import SCENE


def test_objects_move_by_the_grade_within_their_regions():
    """By 3 g cm, or to the edge of the region; by 18 g degrees about the vertical. All else keeps its bits."""
    compiled = compile_scene(WIDE, "cpu")
    generator = LayoutGenerator(compiled, 6, split="eval")
    generator.generate()
    table, editor, random = generator.table(), Editor(compiled), np.random.default_rng(0)
    adr = {
        name: compiled.mjm.jnt_qposadr[compiled.mjm.body_jntadr[body]] for name, body in compiled.scene.bodies.items()
    }
    seen = set()
    for i in range(6):
        for axis, grade in (("shift", 1), ("shift", 5), ("turn", 2)):
            one = editor.edit(table[i], axis, grade, random)
            assert isinstance(one, Edited)
            before, after, still = table.qpos[i], one.row.qpos[0], np.ones(compiled.mjm.nq, bool)
            seen.add((axis, one.clipped))
            for name, edit in one.edits.items():
                at = adr[name]
                still[at : at + 7] = False
                away = after[at : at + 3] - before[at : at + 3]
                assert away[2] == 0.0
                if axis == "turn":
                    assert (away == 0.0).all()
                    turn = np.zeros(3)
                    back = before[at + 3 : at + 7] * [1, -1, -1, -1]
                    both = np.zeros(4)
                    mujoco.mju_mulQuat(both, after[at + 3 : at + 7].astype(float), back.astype(float))
                    mujoco.mju_quat2Vel(turn, both, 1.0)
                    assert np.degrees(turn) == pytest.approx([0, 0, edit["turn"]], abs=1e-3)
                    assert abs(edit["turn"]) == 36.0
                else:
                    assert away[:2] == pytest.approx(edit["shift"], abs=1e-6)
                    assert one.clipped or np.hypot(*edit["shift"]) == pytest.approx(0.03 * grade)
                    assert np.hypot(*edit["shift"]) <= 0.03 * grade + 1e-6
            np.testing.assert_array_equal(after[still], before[still])
    assert {("shift", True), ("shift", False), ("turn", False)} <= seen


def test_grasps_move_with_their_objects_and_are_reached():
    """The audit, which shares no code with the search of joints, accepts the grasp, and the arm's joints in it."""
    compiled = compile_scene("drawer_pick", "cpu")
    generator = LayoutGenerator(compiled, 2, split="eval")
    generator.generate()
    row = generator.table()[0]
    one = Editor(compiled).edit(row, "shift", 1, np.random.default_rng(0))
    assert isinstance(one, Edited)
    moved = one.row.grasp_pose[0, 0, :3] - row.grasp_pose[0, 0, :3]
    assert np.hypot(*moved[:2]) == pytest.approx(np.hypot(*one.edits["banana"]["shift"]), abs=1e-5)
    assert (one.row.grasp_qpos != row.grasp_qpos)[0, 0, :7].any()
    assert judge_reach(compiled, one.row, reach_claims(compiled, one.row)) == []
    assert [found.name for found in judge_reach(compiled, one.row, reach_claims(compiled, row))] == ["banana"]


def test_scenes_without_objects_to_move_are_refused():
    """Regions that are no boxes, and starts, which place objects themselves."""
    points = {"objects.block.region": {"points": [[0.0, 0.5], [0.1, -0.5]]}}
    with pytest.raises(ArgumentError, match="should have a free object whose region is a box"):
        Editor(compile_scene(SceneConfig.load(SCENE, points), "cpu"))
    with pytest.raises(ArgumentError, match="should have no 'start'"):
        Editor(compile_scene(SceneConfig.load("drawer_pick", {"start": [{"robot": "home"}]}), "cpu"))


def test_an_edit_that_always_collides_names_the_objects():
    """Two cans at almost the same place."""
    can = {"asset": "can", "on": "floor"}
    objects = {"first": {**can, "region": {"box": [[0, 0], [0.001, 0.001]]}}}
    objects["second"] = {**can, "region": {"box": [[-0.3, -0.1], [0.3, 0.1]]}}
    compiled = compile_scene({"floor": {"size": [1, 1]}, "objects": objects, "bank": 4}, "cpu")
    generator = LayoutGenerator(compiled, 1)
    generator.generate()
    row = generator.table()
    address = compiled.mjm.jnt_qposadr[compiled.mjm.body_jntadr[compiled.scene.bodies["second"]]]
    row.qpos[0, address : address + 2] = row.qpos[0, :2] + [0.01, 0.0]
    assert Editor(compiled).edit(row, "turn", 1, np.random.default_rng(0)) == "first and second collide"


def test_objects_on_an_object_move_with_it():
    """Their pose in its frame stays the same, and only the object below has an edit."""
    objects = {
        "tray": {"asset": "plate", "on": "floor", "region": {"box": [[-0.5, -0.5], [0.5, 0.5]]}},
        "can": {"asset": "can", "on": "tray"},
    }
    compiled = compile_scene({"floor": {"size": [2, 2]}, "objects": objects, "bank": 4}, "cpu")
    generator = LayoutGenerator(compiled, 1)
    generator.generate()
    data = mujoco.MjData(compiled.mjm)

    def relative(table):
        table.put(data, 0)
        mujoco.mj_kinematics(compiled.mjm, data)
        tray, can = (compiled.scene.bodies[name] for name in ("tray", "can"))
        mat = data.xmat[tray].reshape(3, 3).T
        return mat @ (data.xpos[can] - data.xpos[tray]), mat @ data.xmat[can].reshape(3, 3), data.xpos[can].copy()

    row, random = generator.table(), np.random.default_rng(0)
    for axis in ("shift", "turn"):
        one = Editor(compiled).edit(row, axis, 3, random)
        assert isinstance(one, Edited)
        assert list(one.edits) == ["tray"]
        for before, after in zip(relative(row)[:2], relative(one.row)[:2], strict=True):
            np.testing.assert_allclose(after, before, atol=1e-6)
        assert np.abs(relative(one.row)[2] - relative(row)[2]).max() > 1e-4
