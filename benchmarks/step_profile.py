"""Time of a control step by parts: physics, resets, and the task's own operations.

    python -m benchmarks.step_profile --task TabletopReach-v0

prints a line of JSON for each part [ms per control step of all worlds].
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
import tyro

from benchmarks.timing import captured, wait
from sceniris_gym.adapters.rsl_rl import RslRlVecEnvWrapper
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.training.task_scenes import make_env, scene_of
from sceniris_gym.vector.arm_controller import ArmController
from sceniris_gym.vector.vector_env import SceneVectorEnv


@dataclass(frozen=True)
class Options:
    """Options of the measurement.

    Attributes:
        task: id without its namespace
        num_envs: worlds
        steps: control steps that are timed
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
    """

    task: str = "TabletopReach-v0"
    num_envs: int = 4096
    steps: int = 100
    device: str | None = None


def clock(envs: SceneVectorEnv, steps: int, step: Callable[[], Any]) -> float:
    """Return the mean time of `steps` calls [ms]."""
    for _ in range(3):
        step()
    wait(envs)
    start = time.perf_counter()
    for _ in range(steps):
        step()
    wait(envs)
    return 1e3 * (time.perf_counter() - start) / steps


def tell(what: str, milliseconds: float) -> None:
    """Print a line."""
    print(json.dumps({"what": what, "ms": round(milliseconds, 3)}), flush=True)


def main(options: Options) -> None:
    """Time one part after another."""
    compiled = compile_scene(scene_of(options.task, reachable=True), options.device)
    envs = make_env(options.task, options.num_envs, compiled)
    adapter = RslRlVecEnvWrapper(envs, seed=0)
    s, task = envs.state, envs.task
    # pyrefly: ignore[no-matching-overload]
    action = 0.3 * torch.randn(envs.action_space.shape, device=envs.device).clamp(-1.0, 1.0)
    nobody = torch.zeros(options.num_envs, dtype=torch.bool, device=envs.device)
    some = torch.arange(options.num_envs, device=envs.device) % 200 == 0
    with torch.inference_mode():
        tell("environment step", clock(envs, options.steps, lambda: envs.step(action)))
        tell("step through the adapter", clock(envs, options.steps, lambda: adapter.step(action)))
        if envs.device.type == "cuda":
            tell("environment step in one graph", clock(envs, options.steps, captured(lambda: envs.step(action))))
        tell("physics", clock(envs, options.steps, envs.batch.step))
        tell("reset of no world", clock(envs, options.steps, lambda: envs.randomizer.reset(nobody)))
        tell("reset of 0.5% of the worlds", clock(envs, options.steps, lambda: envs.randomizer.reset(some)))
        tell("apply", clock(envs, options.steps, lambda: task.apply(s, action)))
        tell("observe", clock(envs, options.steps, lambda: task.observe(s)))
        tell("reward", clock(envs, options.steps, lambda: task.reward(s, action)))
        arm = ArmController(s)
        for size in (4, 6):
            moves = 0.3 * torch.randn((options.num_envs, size), device=envs.device).clamp(-1.0, 1.0)
            move = partial(arm.move_tool, s, moves)
            tell(f"move_tool, {size} numbers", clock(envs, options.steps, move))
            if envs.device.type == "cuda":
                tell(f"move_tool, {size} numbers, in one graph", clock(envs, options.steps, captured(move)))


if __name__ == "__main__":
    main(tyro.cli(Options))
