"""Starts of objects with variants, on several supports, or absent: MuJoCo C finds the present one in its place."""

from __future__ import annotations

from functools import cache
from typing import Any

import mujoco
import numpy as np
import torch

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.layout.claims import judge_reach, reach_claims
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.reading import read_layouts
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim.fit import make_worlds
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.viewer.shown import Player
from tests.layout.starting import LIFT, reset_worlds, stepped

HOME, STANDING, LIFTED, PLACED = range(4)
MEMBERS = [f"target/{variant}@{support}" for variant in ("can", "lemon") for support in ("floor", "stand")]
SCENE: dict[str, Any] = {
    "floor": {"size": [1.4, 1.2]},
    "robot": {"asset": "panda", "base": [-0.45, 0.0, 0.0]},
    "objects": {
        "stand": {"asset": "book", "kind": "fixture", "on": "floor", "region": {"box": [[0.1, -0.05], [0.15, 0.05]]}},
        "target": {
            "variants": {"can": {"asset": "can"}, "lemon": {"asset": "lemon"}},
            "on": {"floor": 1, "stand": 1},
            "reachable": "map",
            "region": {"box": [[-0.05, -0.3], [0.3, 0.3]]},
        },
        "apple": {"asset": "apple", "on": "floor", "region": {"box": [[-0.1, -0.3], [0.4, 0.3]]}},
        "goal": {"kind": "marker", "on": "floor", "region": {"box": [[0.1, 0.35], [0.25, 0.45]]}},
    },
    "start": [
        {},
        {"robot": "grasp", "of": "target"},
        {"robot": "grasp", "of": "target", "lift": LIFT},
        {"place": {"target": "goal"}},
    ],
    "bank": 8,
}
PARAMS = ("start.weights", "objects.target.weights")


@cache
def compiled() -> CompiledScene:
    """Return the compiled scene, one for all tests of a process."""
    return compile_scene(SCENE, "cpu")


def members(table: LayoutTable) -> np.ndarray:
    """Return the index in MEMBERS of the present member of each row, of which there is one."""
    there = table.present[:, [compiled().slots.index(name) for name in MEMBERS]]
    assert (there.sum(axis=1) == 1).all()
    return there.argmax(axis=1)


def gaps(table: LayoutTable, row: int, name: str) -> dict[str, float]:
    """Return the distances [m] of an object to others that are there, and as 'xy' that to the marker from above."""
    mjm, scene = compiled().mjm, compiled().scene
    data = mujoco.MjData(mjm)
    table.put(data, row)
    mujoco.mj_kinematics(mjm, data)

    def geoms(owner: str) -> list[int]:
        bodies = [0] if owner == "floor" else scene.subtree(owner)
        return [g for g in range(mjm.ngeom) if mjm.geom_bodyid[g] in bodies and mjm.geom_contype[g]]

    others = ["floor", *(n for n, there in zip(compiled().slots, table.present[row], strict=True) if there)]
    found = {
        other: min(mujoco.mj_geomDistance(mjm, data, a, b, 1.0, None) for a in geoms(name) for b in geoms(other))
        for other in others
        if other not in (name, "goal")
    }
    away = data.xpos[scene.bodies[name]] - data.xpos[scene.bodies["goal"]]
    return found | {"xy": float(np.linalg.norm(away[:2]))}


def test_whichever_member_is_there_is_held():
    """On either support: between the fingers for half a second without an action, and away from all else."""
    data, layouts = reset_worlds(compiled(), 96)
    kinds, found = layouts.start.cpu().numpy(), stepped(compiled(), data, layouts)
    there = layouts.present.cpu().numpy()[:, [compiled().slots.index(name) for name in MEMBERS]].argmax(axis=1)
    for kind in (STANDING, LIFTED):
        assert set(there[kinds == kind].tolist()) == set(range(4))
    assert len(found) == np.isin(kinds, (STANDING, LIFTED)).sum()
    assert max(held.drift for held in found) < 2e-3
    assert min(held.fingers for held in found) == 2
    assert sum(held.others for held in found) == 0


def test_the_member_on_the_support_of_the_marker_is_at_the_marker():
    """It stands there, and penetrates nothing. On the other support it stands as in any other layout."""
    table = make_table(compiled(), 160, 3)
    there, met = members(table), set()
    for row in np.flatnonzero(table.start == PLACED):
        name = MEMBERS[there[row]]
        support, found = name.partition("@")[2], gaps(table, int(row), name)
        met.add(name)
        assert (found.pop("xy") < 1e-4) == (support == "floor")
        assert 0.0 < found.pop(support) < 2e-3
        assert min(found.values()) > 0.0
    assert met == set(MEMBERS)


def test_the_audit_agrees():
    """And finds a can that is beside its marker, though not one of another support."""
    table = make_table(compiled(), 80, 7)
    auditor = Auditor(compiled().mjm, compiled().config, compiled().scene.bodies)
    report = auditor.judge(table, settled=20)
    assert (report.conflicts, report.misplaced, report.relation_violations) == ([], [], 0)
    assert judge_reach(compiled(), table, reach_claims(compiled(), table)) == []
    there, qpos = members(table), table.qpos
    for number, faults in ((0, {"start"}), (1, {"support"})):
        row = int(np.flatnonzero((table.start == PLACED) & (there == number))[0])
        qpos[row, compiled().mjm.joint(f"{MEMBERS[number]}/free").qposadr[0]] += 0.06
        assert {m.cause for m in auditor.judge(table[slice(row, row + 1)]).misplaced} & faults


def test_relations_to_an_object_that_a_start_moves_are_excused():
    """By the name of the object, whichever variant is in the air."""
    near = {**SCENE["objects"]["apple"], "relations": [{"near": "target", "distance": {"max": 0.15}}]}
    held = {"robot": "grasp", "of": "target", "robot_joints": {"joint*": {"fraction": [0.3, 0.7]}}}
    scene = {**SCENE, "objects": {**SCENE["objects"], "apple": near}, "start": [held, SCENE["start"][PLACED]]}
    moving = compile_scene(scene, "cpu")
    report = Auditor(moving.mjm, moving.config, moving.scene.bodies).judge(make_table(moving, 60, 2))
    assert (report.conflicts, report.misplaced, report.relation_violations) == ([], [], 0)


def test_ids_params_and_stored_layouts_make_the_same_worlds():
    """Params choose the kinds and members; ids of such layouts make them again, and stored ones write their worlds."""
    model, data = make_worlds(compiled(), 12)
    randomizer = ResetRandomizer(compiled(), model, data, seed=4, params=PARAMS)
    randomizer.pipeline.set_params({"start.weights": [0, 0, 1, 1], "objects.target.weights": [0, 1, 1, 0]})
    randomizer.reset()
    assert set(randomizer.layouts.start.tolist()) == {LIFTED, PLACED}
    table = read_layouts(randomizer.layouts, "train", None)
    assert set(members(table).tolist()) == {1, 2}
    state = [getattr(data, name).numpy().copy() for name in ("qpos", "ctrl", "mocap_pos")]
    again = ResetRandomizer(compiled(), *make_worlds(compiled(), 12), seed=99, params=PARAMS)
    again.reset(layouts=randomizer.layouts.ids("train"))
    stored = ResetRandomizer(compiled(), *make_worlds(compiled(), 12), params=PARAMS)
    stored.write(table, np.arange(12))
    for other in (again, stored):
        for name, values in zip(("qpos", "ctrl", "mocap_pos"), state, strict=True):
            np.testing.assert_array_equal(getattr(other.data, name).numpy(), values)


def test_a_redraw_moves_whichever_member_is_at_the_marker():
    """To a place on its own support, away from the marker, without a contact; all others keep their bits."""
    generator = LayoutGenerator(compiled(), 60, seed=6)
    generator.generate()
    before = generator.table()
    after = generator.table()
    extended = generator.redraw(generator.layouts, ["target"])
    after.qpos[:] = extended.qpos.numpy()
    there, moved = members(before), 0
    for row in np.flatnonzero((before.start == PLACED) & (extended.status.numpy() == 1)):
        name = MEMBERS[there[row]]
        found = gaps(after, int(row), name)
        moved += found.pop("xy") > 0.01
        assert 0.0 < found.pop(name.partition("@")[2]) < 2e-3
        assert min(found.values()) > 0.0
    assert moved > 8
    own = [compiled().mjm.joint(f"{name}/free").qposadr[0] + np.arange(7) for name in MEMBERS]
    np.testing.assert_array_equal(np.delete(after.qpos, own, axis=1), np.delete(before.qpos, own, axis=1))


def test_an_arm_stays_at_home_with_open_fingers_where_its_object_is_absent():
    """With `missing: drop`: the start's reference to the absent object is ignored, also by stored layouts."""
    block = {"asset": "block", "on": "floor", "reachable": "map", "region": {"box": [[0.0, -0.3], [0.3, 0.3]]}}
    goal = {"kind": "marker", "on": "floor", "region": {"box": [[0.1, 0.35], [0.25, 0.45]]}}
    groups = {name: {"of": [name], "count": [0, 1], "missing": "drop"} for name in ("block", "goal")}
    start = [{}, {"robot": "grasp", "of": "block", "lift": LIFT}, {"place": {"block": "goal"}}]
    words = {"objects": {"block": block, "goal": goal}, "groups": groups, "start": start}
    scene = compile_scene({**SCENE, **words}, "cpu")
    data, layouts = reset_worlds(scene, 120)
    ctrl, kinds = data.ctrl.numpy(), layouts.start.cpu().numpy()
    present = layouts.present.cpu().numpy().astype(bool)
    held = (kinds == 1) & present[:, scene.slots.index("block")]
    assert held.any() and (held != (kinds == 1)).any()
    np.testing.assert_array_equal(ctrl[held, 7], 0.0)
    away = np.abs(ctrl[:, :7] - scene.scene.home_ctrl[:7]).max(axis=1) > 1e-3
    np.testing.assert_array_equal(away, held)
    np.testing.assert_allclose(ctrl[~held, 7], scene.scene.home_ctrl[7], atol=1e-6)
    table = make_table(scene, 120, 0)
    np.testing.assert_array_equal(table.start, kinds)
    other = ResetRandomizer(scene, *make_worlds(scene, 120))
    other.write(table, np.arange(120))
    np.testing.assert_array_equal(other.data.ctrl.numpy(), ctrl)
    for row in (np.flatnonzero(held)[0], np.flatnonzero((kinds == 1) & ~held)[0]):
        np.testing.assert_allclose(Player(scene, table[slice(row, row + 1)]).data.ctrl[7], ctrl[row, 7], atol=1e-6)
    report = Auditor(scene.mjm, scene.config, scene.scene.bodies).judge(table, settled=120)
    assert (report.conflicts, report.misplaced, report.relation_violations) == ([], [], 0)
    assert torch.equal(layouts.grasp[:, 0] >= 0, layouts.present[:, scene.slots.index("block")] != 0)
