"""Tasks by name, their scenes and environments."""

from __future__ import annotations

import sys
from copy import deepcopy
from pathlib import Path

import gymnasium
import pytest
from gymnasium.envs.registration import EnvSpec

from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.scene.build import build_model
from sceniris_gym.training import task_scenes
from tests.training.scenes import write_task


def test_the_word_reachable_can_be_left_out():
    """The rest of the scene is the same."""
    scenes = [task_scenes.scene_of("TabletopReach-v0", reachable=reachable) for reachable in (True, False)]
    assert [bool(scene.objects["can"].reachable) for scene in scenes] == [True, False]
    assert scenes[0].objects["can"].region == scenes[1].objects["can"].region


def test_starts_are_left_out_together_with_reachable(monkeypatch: pytest.MonkeyPatch):
    """A start needs a target that is reachable, and unfiltered layouts to judge policies on have none."""
    name = "sceniris_gym/TabletopReach-v0"
    spec = deepcopy(gymnasium.registry[name])
    spec.kwargs["overrides"] = {"start": [{"weight": 2}, {"robot": "pregrasp", "of": "can"}]}
    monkeypatch.setitem(gymnasium.registry, name, spec)
    scenes = [task_scenes.scene_of(name, reachable=reachable) for reachable in (True, False)]
    assert [[kind.of for kind in scene.start] for scene in scenes] == [[None, "can"], [None]]


def test_a_task_is_found_with_and_without_its_namespace():
    """Either way it is the same registered environment."""
    short, long = (task_scenes.spec_of(name) for name in ("DrawerPick-v0", "sceniris_gym/DrawerPick-v0"))
    assert short is long is gymnasium.registry["sceniris_gym/DrawerPick-v0"]


def test_a_task_of_ones_own_is_imported_from_where_the_program_is_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Its scene is the one that its class names, and its environment takes what was compiled of it."""
    task = write_task(tmp_path, "own_task_here")
    monkeypatch.chdir(tmp_path)
    scene = task_scenes.scene_of(task, reachable=True)
    assert (list(scene.objects), scene.name) == (["block"], "lower")
    compiled = compile_scene(scene, "cpu")
    envs = task_scenes.make_env(task, 2, compiled)
    assert (type(envs.task).__name__, envs.compiled, envs.max_episode_steps) == ("Lower", compiled, 4)


LAW = """
import gymnasium as gym
from sceniris_gym import SceneVectorEnv, Task

GOAL, SCALE = 0.1, 2.0
OTHER = 1.0


def shaped(x, y=SCALE):
    return y * x


class Base(Task):
    scene = "table_top"

    def reward(self, s, action):
        return {"near": shaped(-s.pose("can")[:, 0])}

    def success(self, s):
        return s.pose("can")[:, 0] < GOAL


class Own(Base):
    action_size = 7


class Easy(Own):
    pass


gym.register("Own-v0", vector_entry_point=SceneVectorEnv, kwargs={"task": Own})
"""


@pytest.mark.parametrize(
    ("before", "after", "is_same"),
    [
        (
            "",
            "\n\ngym.register('Later-v0', vector_entry_point=SceneVectorEnv, kwargs={'task': Easy})\nMORE = [OTHER]\n",
            True,
        ),
        ("OTHER = 1.0", "OTHER = 2.0  # no class uses it", True),
        ("    pass", "    action_size = 3", True),
        ("2.0\n", "3.0\n", False),
        ("GOAL, SCALE = 0.1", "GOAL, SCALE = 0.2", False),
        ("return y * x", "return y + x", False),
        ("0] < GOAL", "0] > GOAL", False),
        ("action_size = 7", "action_size = 8", False),
    ],
)
def test_the_hash_of_a_task_is_the_code_that_its_class_uses(
    before: str, after: str, is_same: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Base classes, functions and constants count. Another environment or class of the same file does not."""
    file = tmp_path / "own_law.py"
    file.write_text(LAW)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "own_law", raising=False)
    scene = build_model("table_top")
    first = task_scenes.hashes_of("own_law:Own-v0", scene)
    assert first["scene"] == scene.hash
    file.write_text(LAW.replace(before, after, 1) if before else LAW + after)
    assert (task_scenes.hashes_of("own_law:Own-v0", scene) == first) is is_same


def test_the_scene_may_be_registered_with_the_task(monkeypatch: pytest.MonkeyPatch):
    """And changed there; the environment has it once."""
    words = {"task": "sceniris_gym.envs.tabletop_reach:TabletopReach", "scene": "table_top"}
    spec = EnvSpec(
        "Other-v0",
        vector_entry_point="sceniris_gym:SceneVectorEnv",
        max_episode_steps=3,
        kwargs={**words, "overrides": {"bank": 5}},
    )
    monkeypatch.setitem(gymnasium.registry, "Other-v0", spec)
    scene = task_scenes.scene_of("Other-v0", reachable=True)
    assert (scene.name, scene.bank) == ("table_top", 5)


@pytest.mark.parametrize(
    ("task", "error", "words"),
    [
        ("DrawerPik-v0", UnknownNameError, "unknown task 'DrawerPik-v0'. Did you mean 'DrawerPick-v0'?"),
        ("gymnasium:CartPole-v1", UnknownNameError, "registered tasks (yours: MODULE:ID): unknown task 'CartPole-v1'"),
        ("nowhere_at_all:Task-v0", ArgumentError, "'nowhere_at_all' should be a module that Python can import"),
    ],
)
def test_what_is_no_task_is_refused(task: str, error: type[Exception], words: str):
    """With the ids that are tasks, or with what could not be imported."""
    with pytest.raises(error) as refused:
        task_scenes.spec_of(task)
    assert words in str(refused.value)


def test_a_task_with_another_environment_is_refused(monkeypatch: pytest.MonkeyPatch):
    """Only many worlds on one device are trained; the error says how to register them."""
    entry = {"vector_entry_point": lambda **_: gymnasium.make_vec("CartPole-v1"), "kwargs": {"task": "any"}}
    spec = EnvSpec("Other-v0", **entry)
    monkeypatch.setitem(gymnasium.registry, "Other-v0", spec)
    with pytest.raises(
        ArgumentError, match="vector_entry_point='sceniris_gym:SceneVectorEnv', but makes a CartPoleVectorEnv"
    ):
        task_scenes.make_env("Other-v0", 2, None)  # pyrefly: ignore[bad-argument-type]
