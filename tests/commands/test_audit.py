"""The generator before its judge, in a scene that uses every word of the language."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.commands.audit import judge_rows, load_rows, make_rows, rejected_candidates, report, save_rows
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneFileError, SceneMismatchError, ScenirisError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene, upload_scene
from sceniris_gym.scene.build import build_model
from tests.layout.scenes import compile_on_cpu, write_mjcf
from tests.oracle.balance import Balance

BUSY = {
    "floor": {"size": [2.0, 2.0]},
    "robot": {"asset": "panda", "base": [-0.5, 0.0, 0.0], "joints": {"*": {"noise": 0.02}}},
    "objects": {
        "table": {"asset": "table", "kind": "static"},
        "cabinet": {
            **{"asset": "cabinet", "kind": "fixture", "on": "floor"},
            "region": {"box": [[-0.9, -0.9], [0.9, 0.9]]},
            "joints": {"lower": {"fraction": [0.3, 1.0]}, "upper": {"choice": [0.0, 0.1, 0.25]}},
        },
        "can": {"asset": "can", "on": "table", "ratio_on_support": 1.0},
        "mug": {"asset": "mug", "on": "table", "clearance": 0.02, "ratio_on_support": 0.5},
        "bowl": {"asset": "bowl", "on": "table", "region": {"fraction": [[0.0, 0.0], [0.5, 1.0]]}},
        "apple": {"asset": "apple", "in": "cabinet/upper_drawer", "orientation": {"yaw": [-30, 30]}},
        "banana": {
            **{"asset": "banana", "inside": "cabinet/lower_drawer"},
            "region": {"fraction": [[0.1, 0.5], [0.9, 1.0]]},
        },
        "orange": {"asset": "orange", "on": "cabinet", "gap": 0.002},
        "goal": {"kind": "marker", "region": {"box": [[-0.2, -0.2, 0.6], [0.2, 0.2, 0.9]]}},
    },
}


def judged(compiled: CompiledScene, layouts: int, rejected: int, settled: int) -> dict[str, Any]:
    """Return the findings about the first layouts and rejected candidates."""
    return judge_rows(compiled, make_rows(compiled, layouts, rejected, seed=3), settled)


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_no_fault_is_found_in_a_scene_of_every_word(geometry: str):
    """Robot, table, shelf, drawers, regions and roofs: nothing collides, is misplaced, falls or is rejected wrongly."""
    compiled = compile_scene(SceneConfig.load(BUSY, {"geometry": geometry}), "cpu")
    rows = make_rows(compiled, layouts=120, rejected=120, seed=3)
    found = judge_rows(compiled, rows, settled=0)
    assert found["valid"] > 100
    assert found["rejected"] == 120
    for fault in ("missed_collisions", "false_alarms", "misplaced"):
        assert found[fault] == 0, found
    assert Balance(Auditor(compiled.mjm, compiled.config, compiled.scene.bodies)).falling(rows.table) == []


PRONGS = """
<geom type="box" size="0.05 0.05 0.05" pos="0 0 0.05"/>
<body name="left" pos="0 0 0.3"><joint name="left" type="slide" axis="0 1 0" range="-0.02 0.04"/>
  <geom type="box" size="0.01 0.01 0.05" pos="0 0.01 0"/></body>
<body name="right" pos="0 0 0.3"><joint name="right" type="slide" axis="0 -1 0" range="-0.02 0.04"/>
  <geom type="box" size="0.01 0.01 0.05" pos="0 -0.01 0"/></body>
"""


def test_fingers_in_each_other_are_no_false_alarm(tmp_path: Path):
    """Candidates of a robot that were rejected because its own parts collide, and those that were accepted."""
    key = '<keyframe><key name="home" qpos="0.03 0.03"/></keyframe>'
    robot = {"asset": write_mjcf(tmp_path, "prongs", PRONGS, key), "joints": {"*": {"fraction": [0, 1]}}}
    scene = {"floor": {"size": [2.0, 2.0]}, "robot": robot, "objects": {"can": {"asset": "can", "on": "floor"}}}
    found = judged(compile_on_cpu(scene), 60, 60, 0)
    assert found["rejected"] == 60
    assert (found["false_alarms"], found["missed_collisions"]) == (0, 0), found


def test_a_drawn_robot_stands_on_what_is_lowest_of_it(tmp_path: Path):
    """The robot's lowest point, 10 cm below the origin of its base, is on the floor."""
    foot = '<geom type="box" size="0.05 0.05 0.05" pos="0 0 -0.05"/>'
    arm = (
        '<body name="arm" pos="0 0 0.2"><joint name="turn" axis="0 0 1"/><geom type="box" size="0.2 0.02 0.02"/></body>'
    )
    robot = {"asset": write_mjcf(tmp_path, "footed", foot + arm), "on": "floor"}
    scene = {"floor": {"size": [2.0, 2.0]}, "robot": robot, "objects": {"can": {"asset": "can", "on": "floor"}}}
    found = judged(compile_on_cpu(scene), 20, 0, 0)
    assert (found["misplaced"], found["missed_collisions"]) == (0, 0), found


def test_doors_deeper_than_at_home_are_no_false_alarm(tmp_path: Path):
    """Rejected for nothing else; those that are free are as deep as at home, and listed as allowed for."""
    leaf = '<joint name="{0}" axis="0 0 1" range="-30 30"/><geom type="box" size="0.101 0.01 0.3" pos="{1} 0 0"/>'
    doors = f"""<geom type="box" size="0.3 0.02 0.3" pos="0 0.3 0.3"/>
      <body name="left" pos="-0.2 0 0.31">{leaf.format("left", 0.1)}</body>
      <body name="right" pos="0.2 0 0.31">{leaf.format("right", -0.1)}</body>"""
    thing = {"asset": write_mjcf(tmp_path, "doors", doors), "kind": "static", "joints": {"*": {"range": [-0.3, 0.3]}}}
    scene = {"floor": {"size": [2.0, 2.0]}, "objects": {"doors": thing, "can": {"asset": "can", "on": "floor"}}}
    found = judged(compile_on_cpu(scene), 60, 60, 0)
    assert found["rejected"] == 60
    assert (found["false_alarms"], found["missed_collisions"]) == (0, 0), found
    assert "they touch at home; 0.002 m deep there" in found["allowed_contacts"]["doors/left doors/right"]


LIMP = """
<geom type="box" size="0.05 0.05 0.3" pos="0 0.3 0.3"/>
<body name="link" pos="0 0 0.66"><joint name="shoulder" axis="0 1 0" range="-180 180"/>
  <geom type="capsule" fromto="0.12 0 0 0.6 0 0" size="0.03" mass="3"/></body>
"""


@pytest.mark.parametrize("actuator", ["motor", "position"])
def test_an_arm_is_held_while_objects_settle(tmp_path: Path, actuator: str):
    """A torque-driven arm does not swing into oranges: it is frozen, and the report says so."""
    gains = 'kp="5000" kv="500"' if actuator == "position" else ""
    rest = (
        f'<actuator><{actuator} joint="shoulder" {gains}/></actuator><keyframe><key name="home" qpos="0"/></keyframe>'
    )
    region = {"box": [[0.1, -0.05], [0.3, 0.05]]}
    objects = {"orange": {"asset": "orange", "on": "floor", "region": region, "ratio_on_support": 1.0}}
    robot = {"asset": write_mjcf(tmp_path, "limp", LIMP, rest)}
    scene = {"floor": {"size": [2.0, 2.0]}, "robot": robot, "objects": objects}
    found = judged(compile_on_cpu(scene), 30, 0, 30)
    assert found["moved"] == {"orange": 0}
    assert found["frozen_joints"] == (["limp/shoulder"] if actuator == "motor" else [])


def test_links_that_overlap_at_home_are_listed_and_no_penetration(tmp_path: Path):
    """One verdict: no missed collision, so no depth either; what is allowed for stands beside it with the reason."""
    key = '<keyframe><key name="home" qpos="0 0 0"/></keyframe>'
    body = LIMP.replace("</body>", '<body pos="0.3 0 0"><joint axis="0 0 1" range="-90 90"/>')
    body += '<geom type="sphere" size="0.04" pos="-0.2 0 0"/></body></body>'
    body = '<body pos="0 0 0.01"><joint axis="0 0 1" range="-5 5"/><geom size="0.06" pos="0.1 0 0.65"/></body>' + body
    objects = {"can": {"asset": "can", "on": "floor"}}
    scene = {
        "floor": {"size": [2.0, 2.0]},
        "robot": {"asset": write_mjcf(tmp_path, "odd", body, key)},
        "objects": objects,
    }
    found = judged(compile_on_cpu(scene), 30, 0, 0)
    assert found["missed_collisions"] == 0
    assert found["deepest_penetration_m"] <= 1e-5
    assert found["allowed_contacts"]


def test_a_scene_that_rejects_nothing_gives_no_candidates():
    """One object alone on a floor never collides."""
    compiled = compile_scene(
        {"floor": {"size": [1.0, 1.0]}, "objects": {"can": {"asset": "can", "on": "floor"}}}, "cpu"
    )
    rows, names = rejected_candidates(compiled, 5, 0, "train")
    assert len(rows) == 0
    assert names == []


def test_saved_rows_are_judged_as_fresh_ones(tmp_path: Path):
    """Layouts with their grasps, seeds and episodes, and candidates with object and cause; nothing is made anew."""
    compiled = compile_scene("mid", "cpu")
    rows = make_rows(compiled, 20, 20, 5)
    save_rows(compiled, rows, tmp_path / "rows.npz")
    bare = upload_scene(build_model(SceneConfig.load("mid")), "cpu")
    again = load_rows(bare, tmp_path / "rows.npz")
    assert judge_rows(bare, again) == judge_rows(compiled, rows)
    with np.load(tmp_path / "rows.npz") as file:
        assert str(file["hash"]) == compiled.hash
        assert str(file["config"]) == compiled.config.canonical()
        assert (str(file["split"]), int(file["seed"])) == ("train", 5)
        assert file["layouts_seed"].tolist() == list(range(5, 25))
        assert not file["layouts_episode"].any()
        assert set(file["rejected_object"]) <= set(compiled.placed)
        assert set(file["rejected_cause"]) == {"collision"}
    assert [path.name for path in tmp_path.iterdir()] == ["rows.npz"]


@pytest.mark.parametrize("candidates", [0, 2])
def test_layouts_that_are_reached_can_be_saved_with_candidates_or_without(tmp_path: Path, candidates: int):
    """The columns of the candidates' grasps and paths may be empty: nothing reads them."""
    compiled = compile_scene("tabletop_reach", "cpu")
    rows = make_rows(compiled, 3, candidates, 5)
    save_rows(compiled, rows, tmp_path / "rows.npz")
    again = load_rows(compiled, tmp_path / "rows.npz")
    assert again.table.grasp.shape == rows.table.grasp.shape != (3, 0)
    assert (len(again.rejected), again.names) == (candidates, rows.names)


def test_rows_of_another_scene_are_refused(tmp_path: Path):
    """With both hashes; and what is no such file is refused in words."""
    scene = {"floor": {"size": [1.0, 1.0]}, "objects": {"can": {"asset": "can", "on": "floor"}}}
    compiled = compile_on_cpu(scene)
    save_rows(compiled, make_rows(compiled, 2, 0, 0), tmp_path / "rows.npz")
    other = upload_scene(build_model(SceneConfig.load(scene, {"objects.can.clearance": 0.1})), "cpu")
    with pytest.raises(SceneMismatchError, match=rf"{compiled.hash}.*{other.hash}"):
        load_rows(other, tmp_path / "rows.npz")
    (tmp_path / "text.npz").write_text("nothing")
    for name in ("text.npz", "missing.npz"):
        with pytest.raises(SceneFileError, match="--save"):
            load_rows(compiled, tmp_path / name)


def test_unstable_layouts_are_reported_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Not as moved or fast; with what MuJoCo warned of; and nothing is written."""
    bodies = """<geom type="box" size="0.2 0.01 0.2" pos="0 0.3 0.3"/>
      <body pos="0 0 0.3"><joint name="slide" type="slide" axis="0 -1 0" range="0 0.3"/>
        <geom type="box" size="0.1 0.1 0.05" mass="0.001"/></body>"""
    servo = '<actuator><general joint="slide" gainprm="0" biastype="affine" biasprm="1 1e12 0"/></actuator>'
    asset = write_mjcf(tmp_path, "cabinet", bodies, servo)
    cabinet = {"asset": asset, "kind": "static", "joints": {"*": {"range": [0.05, 0.25]}}}
    objects = {"cabinet": cabinet, "can": {"asset": "can", "on": "floor"}}
    compiled = compile_on_cpu({"floor": {"size": [2.0, 2.0]}, "objects": objects})
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    found = judged(compiled, 10, 0, 6)
    assert (found["settled"], found["unstable"], found["moved"], found["fast"]) == (6, 6, {"can": 0}, {"can": 0})
    assert list(found["unstable_by"]) == ["BADQACC"]
    assert "6 layouts, the first: Nan, Inf or huge value in QACC" in found["unstable_by"]["BADQACC"]
    assert (found["moved_share"], found["top_speed_m_s"]) == (0.0, 0.0)
    assert list((tmp_path / "here").iterdir()) == []


PAIR = {
    "floor": {"size": [0.6, 0.6]},
    "objects": {"can": {"asset": "can", "on": "floor"}, "bowl": {"asset": "bowl", "on": "floor"}},
}


def test_rows_with_nan_are_invalid_and_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """In layouts and in candidates; the others are judged as if these were not there, and nothing is written."""
    monkeypatch.chdir(tmp_path)
    compiled = compile_on_cpu(PAIR)
    rows = make_rows(compiled, 12, 12, 5)
    sound = judge_rows(compiled, rows)
    assert (sound["valid"], sound["invalid"], sound["invalid_by"]) == (12, 0, {})
    rows.table.qpos[[0, 3, 4, 5], 1] = np.nan
    rows.table.qpos[9, 2] = np.inf
    rows.rejected.qpos[11, 1] = np.nan
    found = judge_rows(compiled, rows, settled=6)
    first = report(found).splitlines()[0]
    assert found["ok"] is False
    assert first.endswith("6 rows not finite (layouts qpos rows 0 3-5 9, rejected qpos rows 11)")
    assert first.startswith("FAIL: 12 layouts of ")
    assert report(sound).startswith("ok: 12 layouts of ")
    assert (found["layouts"], found["rejected"], found["valid"], found["settled"]) == (12, 12, 7, 2)
    assert found["invalid"] == 6
    assert found["invalid_by"] == {"layouts qpos": "rows 0 3-5 9", "rejected qpos": "rows 11"}
    for fault in ("missed_collisions", "false_alarms", "misplaced", "unstable"):
        assert found[fault] == 0, found
    rows.table.qpos[:, 0] = rows.rejected.qpos[:, 0] = np.nan
    found = judge_rows(compiled, rows)
    assert (found["valid"], found["invalid"], found["settled"]) == (0, 24, 0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"layouts_qpos": np.zeros((2, 5))}, r"layouts_qpos should have shape \(2, 14\), got \(2, 5\)"),
        ({"layouts_qpos": np.zeros((2, 15))}, r"layouts_qpos should have shape \(2, 14\), got \(2, 15\)"),
        ({"layouts_qpos": np.float64(0)}, r"layouts_qpos should have shape \(2, 14\), got \(\)"),
        ({"layouts_present": np.ones((1, 2), bool)}, r"layouts_present should have shape \(2, 2\), got \(1, 2\)"),
        ({"rejected_mocap_pos": np.zeros((3, 1, 3))}, r"rejected_mocap_pos should have shape \(3, 0, 3\)"),
        ({"layouts_grasp": np.zeros((2, 1), int)}, r"layouts_grasp should have shape \(2, 0\), got \(2, 1\)"),
        ({"layouts_qpos": np.full((2, 14), "x")}, "layouts_qpos should have type float32, got <U1"),
        ({"rejected_object": np.array(["can"])}, r"rejected_object should have shape \(3,\), got \(1,\)"),
        ({"rejected_object": np.array(["can", "cup", "can"])}, "unknown object 'cup'. Valid: bowl, can"),
    ],
)
def test_rows_of_another_shape_are_refused(tmp_path: Path, changes: dict[str, Any], words: str):
    """With what is there and what should be; also of another type, and of objects that are not placed."""
    compiled = compile_on_cpu(PAIR)
    save_rows(compiled, make_rows(compiled, 2, 3, 0), tmp_path / "rows.npz")
    with np.load(tmp_path / "rows.npz") as file:
        columns: dict[str, Any] = {name: file[name] for name in file.files}
    load_rows(compiled, tmp_path / "rows.npz")
    np.savez(tmp_path / "rows.npz", **(columns | changes))
    with pytest.raises(ScenirisError, match=words):
        load_rows(compiled, tmp_path / "rows.npz")
