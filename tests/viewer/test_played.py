"""`play`: a shipped policy in one world of MuJoCo C, which acts and looks as in an environment."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym import cli
from sceniris_gym.config.loader import shipped
from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.layout.tables import make_table
from sceniris_gym.scene.build import build_model
from sceniris_gym.training.policies import policy_of
from sceniris_gym.training.settings import read_checkpoint
from sceniris_gym.training.task_scenes import make_env, scene_of
from sceniris_gym.viewer import command
from sceniris_gym.viewer.played import PlayedWorld
from tests.viewer.pages import control, page, press, text

pytest.importorskip("mjviser", reason="needs the extra 'viewer'")

TASK, SIZES = "TabletopReach-v0", (55, 8, 7)


def policy_file(path: Path) -> Path:
    """Write a policy for TabletopReach-v0 as `benchmarks.ship_policy` does, and return its path."""
    torch.manual_seed(0)
    actor = {}
    for i, (inputs, outputs) in enumerate(itertools.pairwise(SIZES)):
        actor[f"mlp.{2 * i}.weight"] = torch.randn(outputs, inputs).half()
        actor[f"mlp.{2 * i}.bias"] = torch.zeros(outputs).half()
    table = make_table(compile_scene("tabletop_reach", "cpu"), 4, 0, split="eval")
    layouts = {name: torch.from_numpy(v) if isinstance(v, np.ndarray) else v for name, v in vars(table).items()}
    torch.save({"actor_state_dict": actor, "task": TASK, "success": 0.5, "layouts": layouts}, path)
    return path


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the path of a policy."""
    return policy_file(tmp_path_factory.mktemp("shipped") / "tabletop_reach.pt")


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return a list of the modules whose kernels are launched in the test."""
    modules: list[str] = []

    def recording(launch: Callable[..., Any]) -> Callable[..., Any]:
        return lambda kernel, *args, **kwargs: (modules.append(kernel.module.name), launch(kernel, *args, **kwargs))[1]

    for name in ("launch", "launch_tiled"):
        monkeypatch.setattr(wp, name, recording(getattr(wp, name)))
    return modules


def test_a_world_of_mujoco_c_is_observed_as_a_world_of_mujoco_warp(file: Path, launched: list[str]):
    """At the start to the last digits, then nearly; no kernel of MuJoCo-Warp is compiled for it."""
    world = PlayedWorld(file)
    name = LayoutId.parse(world.ids[3])
    actions = torch.linspace(-1.5, 1.5, SIZES[-1])[None]
    seen, rewards = [world.reset(options={"layouts": [name]})[0]], []
    for _ in range(10):
        observation, reward, terminated, truncated, info = world.step(actions)
        seen.append(observation)
        rewards.append(reward)
    assert launched
    assert [module for module in launched if module.startswith("mujoco_warp")] == []
    assert (terminated.tolist(), truncated.tolist(), info["success"].shape) == ([False], [False], (1,))
    world._most = 11
    assert world.step(actions)[3].tolist() == [True]

    envs = make_env(TASK, 1, compile_scene("tabletop_reach", "cpu"), split="eval", autoreset_mode="Disabled")
    expected = envs.reset(options={"layouts": [name]})[0]
    assert world.observation_names == envs.observation_names
    for group, values in expected.items():
        assert seen[0][group] == pytest.approx(values, abs=1e-5), group
    for observation, reward in zip(seen[1:], rewards, strict=True):
        expected, expected_reward, *_ = envs.step(actions)
        assert observation["policy"] == pytest.approx(expected["policy"], abs=2e-3)
        assert reward == pytest.approx(expected_reward, abs=1e-4)
    envs.close()


def test_a_page_shows_the_stored_layouts(file: Path, monkeypatch: pytest.MonkeyPatch):
    """One after another, without a word about kernels; another layout is refused on the page."""
    policies = {"tabletop_reach": file}
    monkeypatch.setattr(
        "sceniris_gym.config.loader.shipped", lambda *at: policies if at == ("envs", ".pt") else shipped(*at)
    )
    shown: list[Any] = []

    def tick(view: Any) -> None:
        shown.append(view)
        raise InterruptedError

    monkeypatch.setattr("sceniris_gym.viewer.env_view.EnvView.tick", tick)
    monkeypatch.setattr("sceniris_gym.viewer.server.close_server", lambda _: None)
    with page() as server:
        monkeypatch.setattr("sceniris_gym.viewer.server.open_server", lambda *_: server)
        with pytest.raises(InterruptedError):
            cli.play("tabletop_reach")
        (view,) = shown
        view.step()
        assert control(server, "layout").value == view.envs.ids[0]
        assert "step 1: running. 0 episodes ended" in text(server)
        view._ended[:] = True
        view._draw()
        assert "step 1: ended, no success. 1 episode ended so far" in text(server)
        assert "kernels" not in text(server)
        assert "is being loaded" not in text(server)
        press(server, "layout", view.envs.compiled.layout_id(7, 0, "eval"))
        for action in view.requests.take(0.0):
            view._try(action)
        assert "should be a stored layout, with a seed from 0 to 3 and episode 0" in text(server)
    with pytest.raises(UnknownNameError, match=r"unknown policy 'tabletop_rech'\. Did you mean 'tabletop_reach'"):
        command.play(MagicMock(), "tabletop_rech")


def test_a_file_without_a_policy_is_refused(tmp_path: Path):
    """By its name."""
    (tmp_path / "clutter.pt").write_bytes(b"nothing")
    with pytest.raises(ArgumentError, match=r"clutter\.pt: is damaged or has no weights"):
        PlayedWorld(tmp_path / "clutter.pt")
    torch.save({"task": TASK}, tmp_path / "clutter.pt")
    with pytest.raises(ArgumentError, match=r"clutter\.pt: should be a file of"):
        PlayedWorld(tmp_path / "clutter.pt")


def test_shipped_policies_belong_to_the_shipped_scenes():
    """To the hash of the scene, which has the law of its layouts, in less than a megabyte; each solves a layout."""
    for name, path in shipped("envs", ".pt").items():
        stored = read_checkpoint(path, "cpu")
        assert path.stat().st_size < 1_000_000
        assert scene_of(stored["task"], reachable=True).name == name
        assert stored["layouts"]["scene"] == build_model(name).hash, name
        assert stored["layouts"]["valid"].all()
        world, policy = PlayedWorld(path), policy_of(str(path))
        observation = world.reset(options={"layouts": [LayoutId.parse(world.ids[0])]})[0]
        succeeded = False
        for _ in range(100):
            observation, _, _, _, info = world.step(policy(observation))
            succeeded = succeeded or bool(info["success"])
        assert succeeded, name


def test_a_port_of_a_page_has_bounds(capsys: pytest.CaptureFixture):
    """Said before anything is opened."""
    with pytest.raises(SystemExit):
        cli.main(["play", "clutter_extract", "--port", "0"])
    assert "--port 0: should be at least 1" in capsys.readouterr().err
