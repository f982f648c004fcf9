"""Grasps in what the tools write: data sets, replays, checks, and the picture of what reachability leaves."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image
from ruamel.yaml import YAML

from sceniris_gym.cli import main
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.tools.commands import replay
from sceniris_gym.tools.commands.generate import write_dataset
from sceniris_gym.tools.narrowing import narrow, narrowing
from sceniris_gym.tools.tables import make_table
from tests.layout.reaching import RADIUS, crane_map, crane_mjcf, crane_scene
from tests.layout.scenes import box_mjcf, compile_on_cpu

FLOOR = 4.0  # area of the crane's floor [m2]


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """A crane that is to reach a cube, with another one that may lie anywhere."""
    folder = tmp_path_factory.mktemp("crane")
    asset, cube = crane_mjcf(folder), box_mjcf(folder, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    scene = crane_scene(asset, cube)
    scene["objects"]["other"] = {"asset": cube, "on": "floor"}
    return compile_on_cpu(scene, bank_size=4)


def test_a_data_set_says_where_the_tcp_takes_each_reachable_object(compiled: CompiledScene, tmp_path: Path):
    """Index, pose in the world and joints by object; the cube is taken at its middle, straight from above."""
    table = make_table(compiled, 40, 3)
    write_dataset(compiled, table, tmp_path)
    stored = np.load(tmp_path / "layouts.npz")
    assert stored["reachable_names"].tolist() == ["thing"]
    assert stored["grasp"].shape == (40, 1)
    assert stored["grasp_qpos"].shape == stored["pregrasp_qpos"].shape == (40, 1, 4)
    assert np.isnan(stored["grasp_qpos"]).all()
    adr = compiled.mjm.jnt_qposadr[compiled.mjm.joint("thing/free").id]
    assert np.allclose(stored["grasp_pose"][:, 0, :3], stored["qpos"][:, adr : adr + 3] + [0.0, 0.0, 0.02], atol=1e-5)
    for quat in stored["grasp_pose"][:, 0, 3:]:
        turned = np.zeros(3)
        mujoco.mju_rotVecQuat(turned, np.array([0.0, 0.0, 1.0]), quat.astype(float))
        assert np.allclose(turned, [0.0, 0.0, -1.0], atol=1e-5)


def test_a_replay_names_the_grasp(compiled: CompiledScene):
    """In numbers and in the report; joints are null where none were solved for."""
    table = make_table(compiled, 1, 0)
    found = replay.describe(compiled, table)
    grasp = found["objects"]["thing"]["grasp"]
    assert grasp["name"] == "top 0"
    assert grasp["pos"] == pytest.approx(table.grasp_pose[0, 0, :3].tolist())
    assert grasp["qpos"] is grasp["pregrasp_qpos"] is None
    assert "grasp" not in found["objects"]["other"]
    assert "grasp 'top 0'" in replay.report({"id": "x", "picture": "y", **found})


@pytest.mark.parametrize("layouts", [200, 1000, 5000])
def test_narrowing_is_the_share_that_is_left_however_many_are_looked_at(compiled: CompiledScene, layouts: int):
    """The crane's ring of the floor, within four standard deviations of chance."""
    figures = narrowing(compiled, layouts, 0).figures()
    assert set(figures) == {"thing"}
    share = np.pi * (RADIUS[1] ** 2 - RADIUS[0] ** 2) / FLOOR
    assert figures["thing"]["candidates"] > 0.9 * layouts
    assert figures["thing"]["kept"] == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / layouts))
    assert figures["thing"]["unreachable"] > 0


def test_narrowing_counts_what_later_stages_refuse(tmp_path: Path):
    """A crane that does not turn all around reaches a part of its ring alone, which `ik` finds without a map."""
    asset, cube = crane_mjcf(tmp_path, turn=1.0), box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    found = narrowing(compile_on_cpu(crane_scene(asset, cube, reachable="ik"), bank_size=4), 400, 0)
    share = np.pi * (RADIUS[1] ** 2 - RADIUS[0] ** 2) / FLOOR * (1.0 / np.pi)
    assert found.figures()["thing"]["kept"] == pytest.approx(share, abs=4 * np.sqrt(share * (1 - share) / 400))


def test_a_picture_needs_something_to_reach(tmp_path: Path):
    """Without `reachable` there is nothing to say, and a picture of it is refused."""
    cube = box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    plain = compile_on_cpu({"floor": {"size": [1.0, 1.0]}, "objects": {"thing": {"asset": cube, "on": "floor"}}})
    assert narrow(plain, 8, 0) == {}
    with pytest.raises(SceneKeyError, match="no object has it"):
        narrow(plain, 8, 0, tmp_path / "x.png")


def test_the_command_check_tells_and_draws_it(tmp_path: Path, capsys: pytest.CaptureFixture):
    """`sceniris-gym check SCENE --picture FILE`: causes of reach, areas, and a picture with both panels."""
    asset, cube = crane_mjcf(tmp_path), box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04)
    crane_map(asset)
    file, picture = tmp_path / "ring.yaml", tmp_path / "ring.png"
    with file.open("w") as stream:
        YAML().dump(crane_scene(asset, cube), stream)
    command = ["check", str(file), "--layouts", "200", "--device", "cpu", "--picture", str(picture)]
    main([*command, "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["rejections"]["thing"]["unreachable"] == found["narrowing"]["thing"]["unreachable"] > 0
    assert found["picture"] == str(picture)
    drawn = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    orange = (drawn[..., 0] > 190) & (drawn[..., 1] < 130) & (drawn[..., 2] < 80)
    middle = drawn.shape[1] // 2
    assert orange[:, middle:].sum() > 0
    assert orange[:, :middle].sum() > 0
