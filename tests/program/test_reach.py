"""The reach targets of a scene on the host: maps, tiers, and the tool centre point."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.tier import Tier
from sceniris_gym.errors import ArmError, MapError
from sceniris_gym.program.plan import build_plan
from sceniris_gym.program.reach import robot_arm
from sceniris_gym.scene.build import build_model
from tests.layout.crane import crane_map, crane_mjcf, crane_scene
from tests.layout.scenes import write_mjcf


def reaching(scene: dict[str, Any]) -> Any:
    """The arms and reach targets of a scene, on the host alone."""
    return build_plan(build_model(SceneConfig.load(scene))).reaching


def test_a_map_that_is_built_later_decides_nothing_until_the_scene_names_it(folder: Path, cube: str):
    """It lies where the command writes it: the tier and the hash stay, and both change with the word."""
    asset = crane_mjcf(folder, "later")
    scene = crane_scene(asset, cube, reachable=True)
    before = build_model(SceneConfig.load(scene)).hash
    path = crane_map(asset)
    assert reaching(scene).targets[0].tier == Tier.IK
    assert build_model(SceneConfig.load(scene)).hash == before
    scene["robot"]["map"] = str(path)
    assert reaching(scene).targets[0].tier == Tier.MAP
    assert build_model(SceneConfig.load(scene)).hash != before


def test_the_body_of_an_arm_on_a_drive_is_named_as_in_its_file(folder: Path):
    """An asset's bodies have its name as a prefix in the scene, which they lack in a scene's `model`."""
    pole = '<body name="pole"><geom size=".1"/><body><joint/><geom size=".1"/><site name="tcp"/></body></body>'
    drive = f'<body name="stage"><joint name="x" type="slide"/><geom size=".1"/>{pole}</body>'
    scene = build_model(SceneConfig.load({"robot": {"asset": write_mjcf(folder, "drive", drive)}, "objects": {}}))
    with pytest.raises(ArmError, match=r"joint 'x' is a slide without limits.* `robot: \{in_model: pole\}`"):
        robot_arm(scene)


def test_a_map_that_is_not_there_is_refused(folder: Path, cube: str):
    """By the key that names it, whatever the tier."""
    scene = crane_scene(crane_mjcf(folder, "lost"), cube, reachable="ik")
    scene["robot"]["map"] = str(folder / "nowhere.reach")
    with pytest.raises(MapError, match=r"robot\.map: .*nowhere\.reach: there is no such reachability map") as told:
        reaching(scene)
    assert str(told.value).endswith(f"--build -o {folder / 'nowhere.reach'}.")  # where the scene looks for it


def test_a_map_of_another_arm_is_refused(folder: Path, cube: str):
    """The crane's turntable is limited after its map was made."""
    asset = crane_mjcf(folder, "changed")
    crane_map(asset)
    crane_mjcf(folder, "changed", turn=3.1)
    with pytest.raises(MapError, match=r"robot\.map: .*changed\.reach"):
        reaching(crane_scene(asset, cube))


def test_a_robot_without_a_tcp_is_refused(folder: Path, cube: str):
    """The robot has no site `tcp`."""
    stump = write_mjcf(folder, "stump", '<geom type="box" size="0.1 0.1 0.1"/>')
    keyed = Path(stump).read_text().replace("</worldbody>", '</worldbody><keyframe><key name="home"/></keyframe>')
    Path(stump).write_text(keyed)
    where = r": robot: the arm has no site 'tcp'\. Write 'tcp: NAME', with the name between the fingertips: "
    with pytest.raises(ArmError, match=where + r"stump\."):
        reaching(crane_scene(stump, cube, reachable="ik"))
    sited = keyed.replace("</geom>", "").replace("<geom", '<site name="tip"/><site name="top"/><geom', 1)
    Path(stump).write_text(sited)
    with pytest.raises(ArmError, match=where + r"tip, top\."):  # the sites alone, and no guess
        reaching(crane_scene(stump, cube, reachable="ik"))


def test_a_scene_without_anything_to_reach_has_no_arm_to_prepare(folder: Path, cube: str):
    """Though there is a robot."""
    assert not reaching(crane_scene(crane_mjcf(folder, "idle"), cube, reachable=False)).arms
