"""Where the time of a control step goes: physics, the task's own operations, and variants of the physics options.

    python -m benchmarks.step_profile --task TabletopReach-v0

prints a line of JSON for each part [ms per control step of all worlds].
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import torch
import tyro
import warp as wp

from benchmarks.task_scenes import make_env, scene_of
from sceniris_gym.adapters.rsl_rl import RslRlVecEnv
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.vector.vector_env import SceneVectorEnv


@dataclass(frozen=True)
class Options:
    """What to time.

    Attributes:
        task: id without its namespace
        num_envs: worlds
        steps: control steps that are timed
        variants: time physics with other options too, which compiles kernels
        device: "cpu" or "cuda:0"; by default cuda:0 if there is one
    """

    task: str = "TabletopReach-v0"
    num_envs: int = 4096
    steps: int = 100
    variants: bool = True
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


def wait(envs: SceneVectorEnv) -> None:
    """Wait until the device is idle."""
    if envs.device.type == "cuda":
        torch.cuda.synchronize(envs.device)


def captured(envs: SceneVectorEnv, action: torch.Tensor) -> Callable[[], None]:
    """Record a whole step, torch and Warp together, into one CUDA graph."""
    stream, graph = torch.cuda.Stream(), torch.cuda.CUDAGraph()
    torch.cuda.synchronize()
    with torch.cuda.graph(graph, stream=stream):
        warp_stream = wp.stream_from_torch(torch.cuda.current_stream())
        with wp.ScopedStream(warp_stream, sync_enter=False), wp.ScopedCapture(stream=warp_stream, external=True):
            envs.step(action)
    return graph.replay


def tell(what: str, milliseconds: float) -> None:
    """Print a line."""
    print(json.dumps({"what": what, "ms": round(milliseconds, 3)}), flush=True)


def main(options: Options) -> None:
    """Time one part after another."""
    compiled = compile_scene(scene_of(options.task, reachable=True), options.device)
    envs = make_env(options.task, options.num_envs, compiled)
    adapter = RslRlVecEnv(envs, seed=0)
    s, task = envs.state, envs.task
    action = 0.3 * torch.randn(envs.action_space.shape, device=envs.device).clamp(-1.0, 1.0)  # type: ignore[arg-type]
    nobody = torch.zeros(options.num_envs, dtype=torch.bool, device=envs.device)
    some = torch.arange(options.num_envs, device=envs.device) % 200 == 0
    with torch.inference_mode():
        tell("environment step", clock(envs, options.steps, lambda: envs.step(action)))
        tell("step through the adapter", clock(envs, options.steps, lambda: adapter.step(action)))
        if envs.device.type == "cuda":
            tell("environment step in one graph", clock(envs, options.steps, captured(envs, action)))
        tell("physics", clock(envs, options.steps, envs.batch.step))
        tell("reset of no world", clock(envs, options.steps, lambda: envs.randomizer.reset(nobody)))
        tell("reset of 0.5% of the worlds", clock(envs, options.steps, lambda: envs.randomizer.reset(some)))
        tell("apply", clock(envs, options.steps, lambda: task.apply(s, action)))
        tell("observe", clock(envs, options.steps, lambda: task.observe(s)))
        tell("reward", clock(envs, options.steps, lambda: task.reward(s, action)))
    if options.variants:
        for name, change in VARIANTS.items():
            compiled = compile_scene(scene_of(options.task, reachable=True), options.device)
            envs = make_env(options.task, options.num_envs, change(compiled))
            if name == "6 iterations":
                envs.batch.model.opt.iterations = envs.batch.model.opt.ls_iterations = 6
            envs.reset(seed=0)
            tell(f"physics, {name}", clock(envs, options.steps, envs.batch.step))


def dense(compiled: Any) -> Any:
    """Use dense Jacobians in the solver."""
    compiled.mjm.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    return compiled


def pyramidal(compiled: Any) -> Any:
    """Use pyramidal friction cones."""
    compiled.mjm.opt.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    return compiled


def without_contacts(compiled: Any) -> Any:
    """Disable contacts."""
    compiled.mjm.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    return compiled


VARIANTS: dict[str, Callable[[Any], Any]] = {
    "as it is": lambda compiled: compiled,
    "without contacts": without_contacts,
    "6 iterations": lambda compiled: compiled,
    "dense": dense,
    "pyramidal": pyramidal,
}

if __name__ == "__main__":
    main(tyro.cli(Options))
