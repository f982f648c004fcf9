"""Notes about an arm's reach: shares of objects within reach, and the approach axis of the hand that reaches most."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

from sceniris_gym.audit.chain import Chain
from sceniris_gym.commands.approach import Approach
from sceniris_gym.commands.init import init
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.tables import make_table
from tests.importers.models.models import FINGERS, arm


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_a_wrong_approach_axis_is_told_with_a_better_one(tmp_path: Path):
    """Most of the board is nearer than the 0.3 m from shoulder to wrist, and the hand has to point down to it."""
    cube = '<body name="cube" pos="0.1 0 0"><freejoint/><geom type="box" size="0.01 0.01 0.01"/></body>'
    board = f'<worldbody><geom name="board" type="box" size="0.2 0.2 0.1" pos="0 0 -0.13"/>{cube}'
    mjcf = arm('<site name="pinch" pos="0 0 0.07"/>' + FINGERS).replace("<worldbody>", board)
    (tmp_path / "arm.xml").write_text(mjcf)
    scene = init(tmp_path / "arm.xml", "cpu")
    assert scene.robot is not None
    share = re.fullmatch(r"(\d+)% of the objects are within reach from above\.", scene.robot.notes[-1])
    assert share is not None
    assert int(share[1]) > 80
    tcp = {"site": "pinch", "roll": 90}
    wrong = compile_scene({**scene.words(), "robot": {"in_model": "base", "tcp": tcp}}, "cpu", overrides={"bank": 8})
    note = Approach(wrong).notes(["cube"])[-1]
    found = re.fullmatch(rf"(\d+)% .*, but {share[1]}% with `tcp: {{site: pinch}}`\.", note)
    assert found is not None
    assert int(found[1]) < 20


def test_a_thing_out_of_reach_gets_a_region_within_reach(tmp_path: Path):
    """It starts in a corner of a large board. All its places in the region are reached, by the chain of the audit."""
    cube = '<body name="cube" pos="0.9 0.9 0"><freejoint/><geom type="box" size="0.01 0.01 0.01"/></body>'
    board = f'<worldbody><geom name="board" type="box" size="1 1 0.1" pos="0 0 -0.13"/>{cube}'
    mjcf = arm('<site name="pinch" pos="0 0 0.07"/>' + FINGERS).replace("<worldbody>", board)
    (tmp_path / "arm.xml").write_text(mjcf)
    scene = init(tmp_path / "arm.xml", "cpu")
    assert scene.robot is not None
    share = re.match(r"(\d+)% of the objects are within reach from above", scene.robot.notes[-1])
    assert share is not None
    assert int(share[1]) > 90
    (low, high) = np.array(scene.words()["objects"]["cube"]["region"]["box"])
    assert ((high - low) > 0.1).all()
    compiled = compile_scene(scene.words(), "cpu", overrides={"bank": 4})
    places = make_table(compiled, 10, 3).qpos[:, :3]
    assert ((places[:, :2] > low) & (places[:, :2] < high)).all()
    chain = Chain(compiled.mjm, compiled.mjm.body("base").id, compiled.mjm.site("pinch").id)
    found = [
        np.isfinite(chain.ik(from_above(place), chain.random_joints(20), 30)).all(axis=1).any() for place in places
    ]
    assert np.mean(found) > 0.8


def from_above(place: np.ndarray) -> np.ndarray:
    """Return poses at a place that point down or 45 degrees aslant, for 12 yaws from the arm's, shape (24, 4, 4)."""
    away = np.degrees(np.arctan2(place[1], place[0]))  # the arm tilts its hand only in its own plane
    angles = [(away + yaw, tilt, 180) for yaw in range(0, 360, 30) for tilt in (0, 45)]
    poses = np.tile(np.eye(4), (24, 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("ZYX", angles, degrees=True).as_matrix()
    poses[:, :3, 3] = place
    return poses


@pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")
def test_an_arm_without_things_has_an_object_to_add_and_tries_other_axes(tmp_path: Path):
    """The fingers are at the origin of a hand whose last joint turns across them, so the axis is wrong."""
    (tmp_path / "arm.xml").write_text(
        arm('<site name="tcp" pos="0 0 0.1"/>').replace('"j5" axis="0 0 1"', '"j5" axis="0 1 0"')
    )
    scene = init(tmp_path / "arm.xml", "cpu")
    assert scene.robot is not None
    assert re.match(r"\d+% of the places on the ground .*, but \d+% with `tcp: \{site: tcp\}`", scene.robot.notes[-1])
    mug = re.search(r"# (mug: \{asset: mug, on: floor, region: .*, reachable: ik\})", scene.text())
    assert mug is not None
    words = {
        **scene.words(),
        "robot": {"in_model": "base", "tcp": "tcp"},
        "objects": YAML(typ="safe").load(mug[1]),
        "floor": {"size": [3, 3]},
        "restarts": 30,
    }
    assert make_table(compile_scene(words, "cpu", overrides={"bank": 4}), 50, 0).valid.mean() > 0.3
