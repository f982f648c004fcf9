"""Judging of policies, and how dense layouts are."""

from __future__ import annotations

import importlib
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.envs.registration import EnvSpec

pytest.importorskip("rsl_rl")

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.levels.curriculum import ADR
from sceniris_gym.registration import ENTRY_POINTS
from sceniris_gym.training import judging, layout_sources, task_scenes
from sceniris_gym.vector.settings import SimConfig
from tests.training.scenes import reach_scene


def test_density_is_about_the_target_that_is_chosen():
    """The number of other things and the distance of the nearest are those by qpos; the target does not count."""
    compiled = compile_scene(SceneConfig.load("tabletop_lift", {"bank": 8}), "cpu")
    envs = task_scenes.make_env("TabletopLift-v0", 6, compiled)
    envs.reset(seed=3)
    task: Any = envs.task
    chosen = task.chosen
    assert chosen.sum(dim=0).count_nonzero() > 1
    things, nearest = judging.density("TabletopLift-v0", envs.state, chosen)
    qpos, names = envs.batch.data.qpos.numpy(), ("block", "can", "lemon", "tin", "orange")
    at = [compiled.mjm.joint(f"{name}/free").qposadr[0] for name in names]
    for world in range(6):
        target, *_ = np.flatnonzero(chosen[world].numpy())
        flat = np.array([qpos[world, a : a + 2] for a in at])
        away = np.delete(np.linalg.norm(flat - flat[target], axis=1), target)
        assert int(things[world]) == 4
        assert float(nearest[world]) == pytest.approx(away.min(), abs=1e-5)


def test_a_task_without_a_target_has_the_least_distance_of_two_things():
    """Of those that are there, by qpos; all are counted."""
    envs = task_scenes.make_env("TabletopReach-v0", 3, reach_scene())
    envs.reset(seed=1)
    things, nearest = judging.density("TabletopReach-v0", envs.state, torch.ones(3, 1))
    scene, qpos = envs.batch.scene, envs.batch.data.qpos.numpy()
    names = [name for name, part in scene.config.objects.items() if part.kind == "free"]
    flat = np.stack([qpos[:, a : a + 2] for a in (scene.mjm.joint(f"{n}/free").qposadr[0] for n in names)], axis=1)
    away = np.linalg.norm(flat[:, :, None] - flat[:, None], axis=-1) + 9.0 * np.eye(len(names))
    assert things.tolist() == [len(names)] * 3 == [5] * 3
    np.testing.assert_allclose(nearest, away.min(axis=(1, 2)), atol=1e-5)


def test_a_scene_without_free_objects_has_no_things():
    """Such as one of a drawer to open."""
    envs = task_scenes.make_env("TabletopReach-v0", 3, reach_scene())
    parts = {name: part for name, part in envs.state.scene.config.objects.items() if part.kind != "free"}
    bare = SimpleNamespace(num_envs=3, device=envs.device, scene=SimpleNamespace(config=SimpleNamespace(objects=parts)))
    things, nearest = judging.density("module:Own-v0", bare, torch.ones(3, 1))  # pyrefly: ignore[bad-argument-type]
    assert (things.tolist(), nearest.tolist()) == ([0] * 3, [np.inf] * 3)


def test_a_task_that_asks_for_grasps_is_judged_where_objects_have_some(monkeypatch):
    """Unfiltered layouts of it may collide, but its objects are reachable; those of other tasks need not be."""
    base: Any = importlib.import_module("sceniris_gym.envs.tabletop_reach").TabletopReach

    class Grasp(base):
        def observe(self, s: Any) -> dict[str, dict[str, torch.Tensor]]:
            return {"policy": {"grasp": s.grasp("can")}}

    gymnasium.register("Grasp-v0", **ENTRY_POINTS, max_episode_steps=2, kwargs={"task": Grasp})
    monkeypatch.setattr(
        judging,
        "compile_scene",
        lambda scene, device: reach_scene(reachable=any(part.reachable for part in scene.objects.values())),
    )
    for task, reachable in (("Grasp-v0", True), ("TabletopReach-v0", False)):
        made = {name: env.unwrapped.compiled for name, env in judging.judges_of(task, 2, "cpu").items()}
        assert [bool(scene.config.objects["can"].reachable) for scene in made.values()] == [True, reachable]
    del gymnasium.registry["Grasp-v0"]


def test_overlapping_objects_have_room_for_their_constraints(monkeypatch: pytest.MonkeyPatch):
    """Twice the rows that valid layouts have; with too few, MuJoCo-Warp drops some, and warns at each step."""
    monkeypatch.setattr(judging, "compile_scene", lambda scene, device: reach_scene())
    judges = judging.judges_of("TabletopReach-v0", 2, "cpu")
    rows = {name: env.unwrapped.batch.data.njmax for name, env in judges.items()}
    assert rows == {"valid": 160, "unfiltered": 320}
    task: Any = importlib.import_module("sceniris_gym.envs.tabletop_reach").TabletopReach
    monkeypatch.setattr(task, "sim_config", SimConfig())  # as in tasks of one's own
    judges = judging.judges_of("TabletopReach-v0", 2, "cpu")
    valid, unfiltered = (judges[name].unwrapped.batch.data.njmax for name in ("valid", "unfiltered"))
    assert unfiltered == 2 * valid


def test_a_task_with_params_and_a_curriculum_is_judged_on_fresh_layouts(monkeypatch: pytest.MonkeyPatch):
    """As it is registered, with default params; unchecked layouts have neither, like stored ones in training."""
    region = "objects.can.region"
    words = {"task": "sceniris_gym.envs.tabletop_reach:TabletopReach", "params": (region,)}
    curriculum = ADR({region: [[0.0, -0.1], [0.2, 0.1]]})
    spec = EnvSpec("Param-v0", **ENTRY_POINTS, max_episode_steps=2, kwargs={**words, "curriculum": curriculum})
    monkeypatch.setitem(gymnasium.registry, "Param-v0", spec)
    monkeypatch.setattr(judging, "compile_scene", lambda scene, device: reach_scene())
    judges = {name: env.unwrapped for name, env in judging.judges_of("Param-v0", 2, "cpu").items()}
    assert [judges[name].randomizer.levels for name in ("valid", "unfiltered")] == [None, None]
    assert judges["valid"].reset(seed=0)[1]["layout"]["params"]
    stored = layout_sources.bank(layout_sources.valid_rows(reach_scene(), 2, 0))
    envs = task_scenes.make_env("Param-v0", 2, reach_scene(), **layout_sources.words_of(stored))
    assert "params" not in envs.reset(seed=0)[1]["layout"]
