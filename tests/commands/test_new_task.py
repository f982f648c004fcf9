"""The `new-task` command: short files that run as they are, and names that no module can have."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest
import torch

from sceniris_gym import cli
from sceniris_gym.scene.build import build_model
from sceniris_gym.training.task_scenes import spec_of
from tests.importers.models.models import FINGERS, arm
from tests.layout.scenes import box_mjcf


def test_what_it_writes_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture):
    """A scene of at most 15 lines, a task of at most 25: it is found by its name, reset and stepped."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    cli.main(["new-task", "pick_fruit"])
    assert " sceniris-gym train pick_fruit:PickFruit-v0\n" in capsys.readouterr().out
    cli.main(["new-task", "pick_tin", "-o", "my tasks"])
    assert " cd 'my tasks' && sceniris-gym train pick_tin:PickTin-v0\n" in capsys.readouterr().out
    for file, most in (("pick_fruit.yaml", 15), ("pick_fruit.py", 25)):
        lines = [line for line in (tmp_path / file).read_text().splitlines() if line]
        assert len(lines) <= most, file
        assert "first_task" not in "".join(lines).lower().replace("firsttask", "first_task")
    assert spec_of("pick_fruit:PickFruit-v0").max_episode_steps == 150
    envs = gym.make_vec("PickFruit-v0", num_envs=2, device="cpu", overrides={"bank": 8})
    observation, _ = envs.reset(seed=0)
    assert observation["policy"].shape == (2, 34)
    assert (envs.step(envs.action_space.sample())[1] > 0.0).all()
    envs.close()
    one = gym.make("PickFruit-v0", device="cpu", overrides={"bank": 8})
    assert one.reset(seed=0)[0]["policy"].shape == (34,)
    one.close()


def test_the_task_is_a_lift_that_a_linear_policy_solves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """With an arm of six joints from a file: along `way`, closed at its end, and up; its reward tells the stages."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "lab.xml").write_bytes((Path(__file__).parents[1] / "data" / "six_axes.xml").read_bytes())
    box_mjcf(tmp_path, "box", 0.05, 0.05, 0.1)
    cli.main(["new-task", "lift_box", "--robot", "lab.xml", "--target", "box.xml"])
    spec_of("lift_box:LiftBox-v0")
    changes = {"bank": 8, "start": [{}]}
    envs: Any = gym.make_vec("LiftBox-v0", num_envs=8, device="cpu", overrides=changes)
    state, _ = envs.reset(seed=0)
    assert envs.unwrapped.observation_names["policy"][-2:] == [("way", (6,)), ("target", (7,))]
    closed, rewards, success = torch.zeros(8), [], torch.zeros(8, dtype=torch.bool)
    for _ in range(149):
        way = state["policy"][:, -13:-7]
        is_there = way[:, :3].norm(dim=1) + 0.1 * way[:, 3:].norm(dim=1) < 0.015
        closed += is_there | (closed > 0)
        moves = torch.cat([60.0 * way[:, :3], 6.0 * way[:, 3:]], dim=1).clamp(-1.0, 1.0) * (closed == 0)[:, None]
        moves[:, 2] += closed > 25
        grip = torch.where(closed > 0, 1.0, -1.0)[:, None]
        state, reward, _, _, info = envs.step(torch.cat([moves.clamp(-1.0, 1.0), grip], dim=1))
        rewards.append(reward.mean())
        success = info["success"]
    assert success.sum() >= 6
    assert rewards[0] < 1.0 < 4.0 < rewards[-1]
    envs.close()


def test_what_it_writes_fits_a_shipped_arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The action moves the tool, so its size is the same for every arm."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    cli.main(["new-task", "pick_by_six", "--robot", "ur5e"])
    assert spec_of("pick_by_six:PickBySix-v0").max_episode_steps == 150
    envs = gym.make_vec("PickBySix-v0", num_envs=2, device="cpu", overrides={"bank": 8})
    envs.reset(seed=0)
    assert envs.action_space.shape == (2, 7)
    assert (envs.step(envs.action_space.sample())[1] > 0.0).all()
    envs.close()


def test_files_of_ones_own_are_seen_from_the_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """An arm without a map and an object, given from the working folder, in a scene in another one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lab.xml").write_bytes((Path(__file__).parents[1] / "data" / "six_axes.xml").read_bytes())
    box_mjcf(tmp_path, "box", 0.05, 0.05, 0.1)
    (tmp_path / "box.xml").rename(tmp_path / "a box: #1.xml")
    cli.main(["new-task", "pick_box", "--robot", "lab.xml", "--target", "a box: #1.xml", "-o", "tasks"])
    scene = build_model(tmp_path / "tasks" / "pick_box.yaml")
    assert scene.mjm.body("lab/hand").id > 0
    assert scene.mjm.geom(int(scene.mjm.body("target").geomadr[0])).size == pytest.approx([0.025, 0.025, 0.05])


def test_an_arm_of_a_file_gets_the_tool_that_init_finds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Without a site and a keyframe of the usual names: the scene was refused, as that of Menagerie's Panda was."""
    monkeypatch.chdir(tmp_path)
    key = '<keyframe><key qpos="0 0.5 0 0 0 0 0 0"/></keyframe></mujoco>'
    Path("own.xml").write_text(arm(FINGERS).replace("</mujoco>", key))
    cli.main(["new-task", "pick_it", "--robot", "own.xml"])
    scene = build_model(tmp_path / "pick_it.yaml")
    tip = scene.home.site("own/tcp").xpos - scene.home.body("own/link1").xpos
    assert tip == pytest.approx((0.57 * math.sin(0.5), 0.0, 0.57 * math.cos(0.5)), abs=1e-6)


@pytest.mark.parametrize(("option", "path"), [("--robot", "pand"), ("--target", "bottle.xml"), ("--robot", "arms")])
def test_a_file_that_does_not_exist_is_refused(
    option: str, path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    """By its option and name, with a shipped asset of a similar name; a folder is no file either."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arms").mkdir()
    with pytest.raises(SystemExit):
        cli.main(["new-task", "pick", option, path])
    said = capsys.readouterr().err
    assert f"error: new-task: {option}: unknown file or asset '{path}'." in said
    assert ("Did you mean 'panda'?" in said) is (path == "pand")
    assert [file.name for file in tmp_path.iterdir()] == ["arms"]


@pytest.mark.parametrize("name", ["2x", "class", "Pick", "my-task"])
def test_names_that_no_module_has_are_refused(name: str, tmp_path: Path, capsys: pytest.CaptureFixture):
    """Before anything is written."""
    with pytest.raises(SystemExit):
        cli.main(["new-task", name, "-o", str(tmp_path)])
    assert f"should be a module name in lower case, such as pick_can, got {name}." in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_files_are_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture):
    """Not even one of the two."""
    (tmp_path / "own.py").write_text("kept")
    with pytest.raises(SystemExit):
        cli.main(["new-task", "own", "--out", str(tmp_path)])
    assert f"{tmp_path / 'own.py'} exists" in capsys.readouterr().err
    assert [path.read_text() for path in tmp_path.iterdir()] == ["kept"]
