"""The `demos` command: files that NumPy reads, actions that repeat the episodes, and what it refuses."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from torch import Tensor

from sceniris_gym import SceneVectorEnv, cli
from sceniris_gym.commands import demos as module
from sceniris_gym.commands.demos import demos
from sceniris_gym.commands.options import Demos
from sceniris_gym.config.settings import read_changes
from sceniris_gym.errors import ArgumentError, MissingExtraError, UnknownNameError
from sceniris_gym.vector.state import State
from tests.training.test_demonstrator import ORANGE, SCENE, Lift

STEPS = 120
STARTS = [{"robot": "pregrasp", "of": "orange"}, {"robot": "grasp", "of": "orange", "lift": [0.0, 0.1]}]
DOWN = {**SCENE, "objects": {"orange": {**ORANGE, "reachable": "clear"}}, "start": STARTS}


class DownToOrange(Lift):
    """Lift an orange with a tool that points down, whose pose the action changes."""

    action_size = 5

    def apply(self, s: State, action: Tensor) -> None:
        """Move the tool and the gripper."""
        self.arm.move_tool(s, action[:, :4], lowest=0.01)
        self.arm.grip(s, action[:, 4])

    def on_reset(self, s: State, mask: Tensor) -> None:
        """Set the tool's target to the tool."""
        self.arm.start(s, mask)


@pytest.fixture(autouse=True)
def _own_tasks() -> Iterator[None]:
    """Forget the tasks of a test."""
    before = set(gym.registry)
    yield
    for name in set(gym.registry) - before:
        del gym.registry[name]


def register(name: str, scene: dict, steps: int | None = STEPS) -> str:
    """Register the task, and return its id."""
    options = {"task": DownToOrange, "scene": scene}
    gym.register(name, vector_entry_point="sceniris_gym:SceneVectorEnv", max_episode_steps=steps, kwargs=options)
    return name


def test_recorded_actions_repeat_the_episodes(tmp_path: Path, capsys: pytest.CaptureFixture):
    """From the ids and the options of the manifest: the same observations, rewards and successes, bit for bit.

    Each world starts at the arm's start pose, although the scene also has starts partway. Each
    part has rows for all of its steps.
    """
    task = register("DownToOrange-v0", DOWN)
    words = ["demos", task, "--episodes", "2", "--num-envs", "1", "--seed", "7", "--device", "cpu"]
    cli.main([*words, "-o", str(tmp_path / "demos")])
    out = capsys.readouterr().out
    assert out.startswith("ok: 2 demonstrations of DownToOrange-v0: ")
    assert out.splitlines()[1:] == ['--set objects.orange.reachable="path"', "--set start=[]"]
    told = json.loads((tmp_path / "demos" / "demos.json").read_text())
    assert told["files"] == ["demos-00000.npz", "demos-00001.npz"]
    assert told["observations"] == {"policy": [["joints", [7]], ["width", []]]}
    assert (told["fps"], told["targets"], told["episodes"]) == (50, ["orange"], 2)
    parts = [dict(np.load(tmp_path / "demos" / file)) for file in told["files"]]
    rows = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    assert {name: values.shape for name, values in rows.items()} == {
        **{"observation/policy": (2 * STEPS, 8), "action": (2 * STEPS, 5), "reward": (2 * STEPS,)},
        **{"length": (2,), "id": (2,), "seed": (2,), "success": (2,)},
    }
    assert rows["success"].all()
    assert rows["id"].tolist() == [f"{told['hash']}:train:{seed}:0" for seed in rows["seed"]]

    envs = SceneVectorEnv(
        DownToOrange, 2, scene=DOWN, overrides=read_changes(told["set"]), device="cpu", autoreset_mode="Disabled",
        output="numpy",
    )  # fmt: skip
    observation, _ = envs.reset(options={"layouts": rows["id"].tolist()})
    action, seen, reward = (
        rows[name].reshape(2, STEPS, -1).swapaxes(0, 1) for name in ("action", "observation/policy", "reward")
    )
    for k in range(STEPS):
        np.testing.assert_array_equal(observation["policy"], seen[k])
        observation, got, _, _, info = envs.step(action[k])
        np.testing.assert_array_equal(got, reward[k, :, 0])
        assert info["success"].all() or k < STEPS - 1
    home = [0, -0.785, 0, -2.356, 0, 1.571, 0.785]
    np.testing.assert_allclose(seen[0, :, :7], np.tile(home, (2, 1)), atol=0.01)
    envs.close()
    with pytest.raises(ArgumentError, match=r"demos: .*demos.json exists"):
        demos(Demos(task, out=tmp_path / "demos"))


def test_too_few_successes_are_a_verdict(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The command ends after the tries, with no episode that failed."""
    monkeypatch.setattr(module, "TRIES", 1)
    task = register("TooShort-v0", DOWN, steps=3)
    found = demos(Demos(task, out=tmp_path, episodes=1, num_envs=2, device="cpu"))
    assert (found["ok"], found["episodes"], found["tried"]) == (False, 0, 4)
    assert np.load(tmp_path / "demos-00000.npz")["action"].shape == (0, 5)
    assert module.report(found).startswith("FAIL: 0 demonstrations of TooShort-v0: 0.0% of 4 episodes succeeded")


def test_what_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Before any work: tasks without a target or a limit, several targets, unknown ones, and a missing library."""

    def refused(name: str, objects: dict, steps: int | None = STEPS, **more: Any) -> None:
        demos(Demos(register(name, {**SCENE, "objects": objects}, steps), out=tmp_path, device="cpu", **more))

    two = {"orange": ORANGE, "apple": {**ORANGE, "asset": "apple"}}
    with pytest.raises(ArgumentError, match="task 'None-v0' should have an object with 'reachable'"):
        refused("None-v0", {"orange": {**ORANGE, "reachable": False}})
    with pytest.raises(ArgumentError, match=r"should have one target. Add --target with one of orange, apple"):
        refused("Two-v0", two)
    with pytest.raises(UnknownNameError, match="unknown reachable object 'pear'"):
        refused("Three-v0", two, target="pear")
    with pytest.raises(ArgumentError, match="'Endless-v0' should be registered with max_episode_steps"):
        refused("Endless-v0", {"orange": ORANGE}, steps=None)
    monkeypatch.setitem(sys.modules, "lerobot", None)
    with pytest.raises(MissingExtraError, match="lerobot is not installed"):
        refused("Lerobot-v0", two, format="lerobot")
    with pytest.raises(SystemExit):
        cli.main(["demos", "Two-v0", "--episodes", "0"])
