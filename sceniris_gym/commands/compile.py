"""The `compile` command: compiles scenes and kernels before they are used, as in the image of a container."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium
import warp as wp

from sceniris_gym.config.loader import shipped
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.scene_cache import cache_folder
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.training.task_scenes import spec_of


def compile_all(names: Sequence[str], num_envs: int, device: str | None, *, render: bool = False) -> dict[str, Any]:
    """Reset and step worlds of scenes and tasks once, so that everything is compiled. Return findings.

    Args:
        names: Shipped scenes, paths of scene files, and tasks as `spec_of` takes them.
        num_envs: Number of worlds.
        device: Warp's name of the device. None takes "cuda:0" if available, otherwise "cpu".
        render: Also compile the kernels of a task's `render`. The kernels of observed images are always compiled.
    """
    folder = Path(wp.config.kernel_cache_dir or "")
    kept = {*folder.iterdir()}
    for name in names:
        if name in shipped("envs", ".yaml") or Path(name).suffix in (".yaml", ".yml"):
            compiled = compile_scene(name, device)
            batch = Batch(compiled.scene, num_envs, compiled.device)
            ResetRandomizer.of_batch(batch, compiled).reset()
            batch.step()
            continue
        options: Any = {"num_envs": num_envs, "device": device, "render_mode": "rgb_array" if render else None}
        envs = gymnasium.make_vec(spec_of(name), **options)
        envs.reset(seed=0)
        envs.step(envs.action_space.sample())
        envs.render()
        envs.close()
    made = len({*folder.iterdir()} - kept)
    return {"names": [*names], "kernels": made, "kernel_cache": str(folder), "scene_cache": str(cache_folder())}
