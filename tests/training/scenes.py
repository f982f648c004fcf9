"""Scenes and tasks that tests of training, of its commands and of benchmarks share."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.training.task_scenes import scene_of


@cache
def reach_scene(*, reachable: bool = True) -> CompiledScene:
    """Return the CompiledScene of TabletopReach-v0, with or without `reachable`, with a bank of 8."""
    return compile_scene(SceneConfig.load(scene_of("TabletopReach-v0", reachable=reachable), {"bank": 8}), "cpu")


SMALL = (
    *("--num-envs", "2", "--layouts", "3", "--device", "cpu"),
    *("--every", "1", "--million-steps", "0.00001", "--set", "hidden=[8]", "--set", "steps=4"),
)
"""Options of a training of two iterations."""

OWN_TASK = """
import gymnasium as gym
import torch

from sceniris_gym import SceneVectorEnv, Task


class Lower(Task):
    scene = SCENE
    substeps = 2

    def observe(self, s):
        return {"policy": {"arm": s.qpos("arm")}}

    def reward(self, s, action):
        return {"low": -s.site("arm/tcp")[:, 2]}

    def success(self, s):
        return s.site("arm/tcp")[:, 2] < 0.0


gym.register(f"{__name__}-v0", vector_entry_point=SceneVectorEnv, max_episode_steps=4, kwargs={"task": Lower})
"""
"""A task that lowers the tool of an arm beside a block; it shows the policy one group, and the critic no other."""

OWN_SCENE = """
model: small_arm.xml
floor: {size: [1.6, 1.6]}
objects:
  block: {on: floor, region: {box: [[-0.3, -0.6], [-0.1, 0.6]]}}
bank: 4
"""


def write_task(folder: Path, module: str) -> str:
    """Write a module that registers a task, and its scene, to a folder; return the name of the task."""
    model = Path(__file__).parents[1] / "data" / "small_arm.xml"
    (folder / "small_arm.xml").write_bytes(model.read_bytes())
    (folder / "lower.yaml").write_text(OWN_SCENE)
    (folder / f"{module}.py").write_text(OWN_TASK.replace("SCENE\n", f"{str(folder / 'lower.yaml')!r}\n", 1))
    return f"{module}:{module}-v0"
