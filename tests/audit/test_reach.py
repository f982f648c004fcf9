"""The audit of reach, on claims that are right and on ones with known faults."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.audit.reach import ReachAudit
from sceniris_gym.commands.audit import judge_rows, make_rows
from sceniris_gym.geometry.rotations import quaternion
from sceniris_gym.layout.claims import judge_reach, reach_claims
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.scene.layout_table import LayoutTable
from tests.layout.crane import RADIUS, crane_map, crane_mjcf, crane_scene
from tests.layout.scenes import box_mjcf, compile_on_cpu
from tests.layout.starting import HELD, LIFTED, PLACED, STANDING, starting

N = 30


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """A crane, a cube that it reaches clear of all else, and one that only its map was asked for."""
    folder = tmp_path_factory.mktemp("crane")
    asset, cube = crane_mjcf(folder), box_mjcf(folder, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    scene = crane_scene(asset, cube, reachable="clear")
    scene["objects"]["other"] = {"asset": cube, "on": "floor", "reachable": "map"}
    return compile_on_cpu(scene, bank=4)


@pytest.fixture(scope="module")
def table(compiled: CompiledScene) -> LayoutTable:
    """Layouts of it."""
    return make_table(compiled, N, 11)


def causes(compiled: CompiledScene, table: LayoutTable) -> set[tuple[int, str, str]]:
    """Return the audit's findings on a table, as (row, name, cause)."""
    return {(u.row, u.name, u.cause) for u in judge_reach(compiled, table, reach_claims(compiled, table))}


def test_what_was_made_is_reached(compiled: CompiledScene, table: LayoutTable):
    """No complaint about fresh layouts, here or in what `audit` answers."""
    assert causes(compiled, table) == set()
    found = judge_rows(compiled, make_rows(compiled, N, 0, 11), settled=0)
    assert (found["reach_claims"], found["unreached"]) == (2 * N, 0)


def test_every_fault_is_named(compiled: CompiledScene, table: LayoutTable):
    """One row each, from no grasp at all to a cube that stands too near the crane."""
    grasp_pose, qpos, before = table.grasp_pose.copy(), table.grasp_qpos.copy(), table.pregrasp_qpos.copy()
    grasp_pose[0, 0] = np.nan
    grasp_pose[1, 0, 2] += 0.1
    qpos[2, 0] = np.nan
    qpos[3, 0, 1] = RADIUS[1] + 0.01
    qpos[4, 0, 0] += np.radians(1.0)
    before[5, 0, 2] -= 0.002
    moved = table.qpos.copy()
    adr = compiled.mjm.jnt_qposadr[compiled.mjm.joint("other/free").id]
    shift = np.array([0.35, -0.1]) - moved[6, adr : adr + 2]  # within the ring of the crane
    moved[6, adr : adr + 2] += shift
    grasp_pose[6, 1, :2] += shift
    wrong = replace(table, qpos=moved, grasp_pose=grasp_pose, grasp_qpos=qpos, pregrasp_qpos=before)
    assert causes(compiled, wrong) == {
        (0, "thing", "no grasp"),
        (1, "thing", "off the object"),
        (2, "thing", "no joints"),
        (3, "thing", "limits"),
        (4, "thing", "another pose"),
        (5, "thing", "pre-grasp: another pose"),
        (6, "other", "no joints found"),
    }


def test_a_path_is_walked():
    """Paths as they were made, one without corners, and one whose via swings the arm through the table."""
    compiled = compile_scene({"base": "tabletop_lift", "objects": {"can": {"reachable": "path"}}}, "cpu")
    table = make_table(compiled, 6, 3)
    assert causes(compiled, table) == set()
    assert compiled.reaching is not None
    path, column = table.path.copy(), compiled.reaching.names.index("can")
    path[0, column, 0] = np.nan
    path[1, column, MAX_JOINTS + 1] += 1.5
    found = causes(compiled, replace(table, path=path))
    assert {(row, name) for row, name, _ in found} == {(0, "can"), (1, "can")}
    assert (0, "can", "no path") in found
    assert all(cause.startswith("path: hits") for row, _, cause in found if row == 1)


@pytest.mark.parametrize("pattern", ["rim*", "grasp_rim*"])
def test_only_chosen_grasps_count(tmp_path_factory: pytest.TempPathFactory, pattern: str):
    """A claim in a grasp that the glob leaves out is named, also where the arm reaches it; half a turn is no matter."""
    folder = tmp_path_factory.mktemp("chosen")
    asset, cube = crane_mjcf(folder), box_mjcf(folder, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    sites = '<site name="grasp_{}" pos="0 {} 0.02" quat="0 1 0 0"/>'
    grasps = "".join(sites.format(name, y) for name, y in (("rim_a", -0.005), ("rim_b", 0.0), ("handle", 0.01)))
    text = Path(cube).read_text()
    assert "</body>" in text
    Path(cube).write_text(text.replace("</body>", f"{grasps}</body>", 1))
    scene = crane_scene(asset, cube, reachable={"tier": "map", "grasp": pattern})
    compiled = compile_on_cpu(scene, bank=4)
    table = make_table(compiled, N, 3)
    assert causes(compiled, table) == set()
    pose, data = table.grasp_pose.copy(), mujoco.MjData(compiled.mjm)
    table.put(data, 4)
    mujoco.mj_kinematics(compiled.mjm, data)
    names = [compiled.mjm.site(s).name for s in range(compiled.mjm.nsite)]
    (handle,) = (s for s, name in enumerate(names) if name.endswith("grasp_handle"))
    pose[4, 0, :3] = data.site_xpos[handle]
    pose[4, 0, 3:] = quaternion(data.site_xmat[handle].reshape(3, 3))
    pose[5, 0, 3:] = turned(pose[5, 0, 3:], np.pi)
    pose[6, 0, 3:] = turned(pose[6, 0, 3:], 0.5)
    wrong = replace(table, grasp_pose=pose)
    assert causes(compiled, wrong) == {(4, "thing", "another grasp"), (6, "thing", "another grasp")}
    scene["objects"]["thing"]["reachable"]["grasp"] = "top*"  # generated, because no site has such a name
    compiled = compile_on_cpu(scene, bank=4)
    assert causes(compiled, make_table(compiled, N, 3)) == set()


def test_only_grasps_at_the_part_count(tmp_path_factory: pytest.TempPathFactory):
    """A claim in a grasp at the root, or at a lid that is another joint, is named, where `grasp` is a part."""
    folder = tmp_path_factory.mktemp("part")
    asset, cube = crane_mjcf(folder), box_mjcf(folder, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    site, geom = '<site name="grasp_{}" pos="{} 0 0.02" quat="0 1 0 0"/>', '<geom size="0.005" pos="0 0 0.03"/>'
    lid = '<body name="{0}"><joint name="{0}" type="slide" axis="0 0 1" range="0 0.01" limited="true"/>{1}</body>'
    lids = "".join(lid.format(f"lid_{i}", geom + site.format(f"lid_{i}", 0.005 * i)) for i in range(2))
    text = Path(cube).read_text()
    Path(cube).write_text(text.replace("</body>", f"{site.format('root', -0.005)}{lids}</body>", 1))
    scene = crane_scene(asset, cube, reachable={"tier": "map", "grasp": "top"})
    scene["objects"]["thing"] |= {"kind": "fixture", "parts": {"top": "lid_*"}}
    compiled = compile_on_cpu(scene, bank=4)
    table = make_table(compiled, N, 3)
    assert causes(compiled, table) == set()
    pose, data = table.grasp_pose.copy(), mujoco.MjData(compiled.mjm)
    for row, name in ((4, "root"), (5, "lid_0"), (6, "lid_1")):
        table.put(data, row)
        mujoco.mj_kinematics(compiled.mjm, data)
        at = compiled.mjm.site(f"thing/grasp_{name}").id
        pose[row, 0] = np.hstack([data.site_xpos[at], quaternion(data.site_xmat[at].reshape(3, 3))])
    expected = {(4, "thing", "another grasp"), (6, "thing", "another grasp")}
    assert causes(compiled, replace(table, grasp_pose=pose)) == expected


def turned(quat: np.ndarray, angle: float) -> np.ndarray:
    """An orientation, wxyz, turned about its own z axis [rad]."""
    result = np.empty(4)
    mujoco.mju_mulQuat(result, quat.astype(float), np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]))
    return result


def test_an_arm_that_hits_something_is_not_clear(tmp_path_factory: pytest.TempPathFactory):
    """The hand stands in another cube: seen for `clear`, of no interest to `ik`."""
    folder = tmp_path_factory.mktemp("solid")
    asset, cube = crane_mjcf(folder, solid=True), box_mjcf(folder, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    for tier, expected in (("clear", "hits something"), ("ik", None)):
        scene = crane_scene(asset, cube, reachable=tier)
        scene["objects"]["other"] = {"asset": cube, "on": "floor"}
        compiled = compile_on_cpu(scene, bank=4)
        table = make_table(compiled, 5, 0)
        assert causes(compiled, table) == set()
        moved = table.qpos.copy()
        adr, other = (compiled.mjm.jnt_qposadr[compiled.mjm.joint(f"{name}/free").id] for name in ("thing", "other"))
        moved[2, other : other + 3] = moved[2, adr : adr + 3] + [0.0, 0.0, 0.05]
        wrong = replace(table, qpos=moved)
        assert causes(compiled, wrong) == ({(2, "thing", expected)} if expected else set())


def test_only_the_hand_may_touch_its_target_and_only_in_the_grasp(tmp_path_factory: pytest.TempPathFactory):
    """The same claims, of models in which a part of the crane has a param that is in the post."""
    folder = tmp_path_factory.mktemp("target")
    asset, post = crane_mjcf(folder, solid=True), box_mjcf(folder, "post", 0.04, 0.04, 0.15)
    crane_map(asset)
    compiled = compile_on_cpu(crane_scene(asset, post, reachable="clear"))
    table = make_table(compiled, 5, 0)
    assert causes(compiled, table) == set()
    assert compiled.scene.spec is not None
    spec = compiled.scene.spec.copy()
    bodies = compiled.scene.bodies

    def judged(body: str, at: float) -> set[str]:
        changed = spec.copy()
        size, pos = [0.005, 0.005, 0.005], [0.0, 0.0, at]
        changed.body(f"crane/{body}").add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=pos)
        claims = reach_claims(compiled, table)
        return {
            u.cause
            for u in ReachAudit(changed.compile(), bodies["robot"], bodies, compiled.scene.tcps["robot"]).judge(
                table, claims
            )
        }

    assert judged("hand", 0.0) == set()  # at the TCP, 8 cm above where it grasps
    assert judged("hand", 0.08) == {"pre-grasp: hits its target"}
    assert judged("up", 0.0) == {"hits its target"}


@pytest.mark.parametrize(("width", "cause"), [(0.042, {"hits itself"}), (0.2, set())], ids=["apart", "in each other"])
def test_hits_of_the_arm_with_itself_are_seen(
    compiled: CompiledScene, table: LayoutTable, width: float, cause: set[str]
):
    """The same claims, of models in which the crane's fingers are wide: in a grasp they are in each other.

    But those that are so at home, where they are open, may be as deep as there.
    """
    assert compiled.scene.spec is not None
    spec = compiled.scene.spec.copy()
    for name in ("left", "right"):
        (pad,) = spec.body(f"crane/{name}").geoms
        pad.size, pad.contype, pad.conaffinity = [0.01, width, 0.02], 1, 1
    mjm: mujoco.MjModel = spec.compile()
    audit = ReachAudit(mjm, compiled.scene.bodies["robot"], compiled.scene.bodies, compiled.scene.tcps["robot"])
    claims = reach_claims(compiled, table)[:1]
    assert {u.cause for u in audit.judge(table, claims)} == cause


@pytest.fixture(scope="module")
def auditor() -> Auditor:
    """The auditor of the scene."""
    compiled = starting()
    return Auditor(compiled.mjm, compiled.config, compiled.scene.bodies)


def test_layouts_pass(auditor: Auditor):
    """Of every kind, with their claims about reach."""
    table = make_table(starting(), 60, 100)
    assert set(table.start.tolist()) == set(range(7))
    report = auditor.judge(table, settled=20)
    assert (report.conflicts, report.misplaced, report.depth, report.relation_violations) == ([], [], 0.0, 0)
    assert report.settled == 20 - np.isin(table.start[:20], (LIFTED, HELD)).sum()
    assert judge_reach(starting(), table, reach_claims(starting(), table)) == []


@pytest.mark.parametrize(("kind", "name"), [(STANDING, "block"), (LIFTED, "block"), (PLACED, "apple")])
def test_what_is_not_where_its_start_says_is_found(auditor: Auditor, kind: int, name: str):
    """A thing that was moved out of the hand by hand, or away from its marker."""
    table = make_table(starting(), 60, 100)
    rows = table[table.start == kind]
    adr = starting().mjm.joint(f"{name}/free").qposadr[0]
    qpos = rows.qpos.copy()
    qpos[:, adr + 2] += 0.001 if kind == PLACED else 0.3
    qpos[:, adr] += 0.001
    found = auditor.judge(replace(rows, qpos=qpos)).misplaced
    assert {(m.row, m.name) for m in found if m.cause == "start"} == {(row, name) for row in range(len(rows))}


def test_what_falls_has_the_number_of_its_layout(auditor: Auditor):
    """Behind layouts with something in the air, which are not stepped."""
    table = make_table(starting(), 60, 100)
    held = np.isin(table.start, (LIFTED, HELD))
    row = int(np.flatnonzero(~held[held.argmax() :])[0] + held.argmax())
    qpos = table.qpos.copy()
    qpos[row, starting().mjm.joint("apple/free").qposadr[0] + 2] += 0.05
    found = auditor.judge(replace(table, qpos=qpos), settled=row + 1).misplaced
    assert [(m.row, m.name) for m in found if m.cause == "falls"] == [(row, "apple")]


def test_an_empty_hand_is_no_excuse(auditor: Auditor):
    """In the state of a grasp that is called another kind, the fingers are in the thing."""
    table = make_table(starting(), 60, 100)
    rows = table[table.start == STANDING]
    report = auditor.judge(replace(rows, start=np.zeros_like(rows.start)))
    assert {c.row for c in report.conflicts} == set(range(len(rows)))
