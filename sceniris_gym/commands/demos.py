"""The `demos` command: writes demonstrations, by an arm that follows a path, grasps an object and lifts it."""

import time
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

import sceniris_gym
from sceniris_gym.commands.answer import OK, verdict
from sceniris_gym.commands.options import Demos
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.settings import read_changes
from sceniris_gym.dataset.lerobot import MANIFEST, convert, import_lerobot
from sceniris_gym.errors import ArgumentError, check_names
from sceniris_gym.files import as_json, check_new, replacing, write_text
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.progress import tell
from sceniris_gym.training.demonstrator import Demonstrator
from sceniris_gym.training.task_scenes import make_env, scene_of, spec_of
from sceniris_gym.vector.arguments import as_task
from sceniris_gym.vector.observer import GROUP, picture_names
from sceniris_gym.vector.vector_env import SceneVectorEnv

TRIES = 4
"""Number of episodes that are tried at most, for each demonstration."""


def demos(options: Demos) -> dict[str, Any]:
    """Write the first episodes that end in success, and return figures.

    Each part `demos-00000.npz` has episodes of one batch of worlds. Its arrays `action`, `reward`, `observation/GROUP`
    and `image/CAMERA/KIND` have a row for each step: the observation, then the action and its reward. Its arrays
    `length`, `id`, `seed` and `success` have a row for each episode. The manifest `demos.json` is written last.

    Raises:
        ArgumentError: The folder has demonstrations. The scene has no reachable object, or several and no `target`. The
            task has no `max_episode_steps`.
        MissingExtraError: The format is lerobot, and LeRobot is not installed.
        ScenirisError: The scene cannot be compiled, or its robot cannot be controlled.
    """
    folder, wanted = options.out, options.episodes
    check_new(folder / MANIFEST, "demos")
    if options.format == "lerobot":
        import_lerobot()
    scene = SceneConfig.load(scene_of(options.task, reachable=True), read_changes(options.changes))
    names = _targets(scene, options)
    parts = [name for name in scene.objects if scene.owners.get(name, name) in names]
    raised: dict[str, Any] = {f"objects.{n}.reachable": "path" for n in parts if scene.objects[n].reachable != "path"}
    raised |= {"start": []} if scene.start else {}
    compiled = compile_scene(SceneConfig.load(scene, raised), options.device)
    given: dict[str, Any] = {"split": options.split, "autoreset_mode": "Disabled", "sim_config": {"prefetch": False}}
    given |= {"images": {name: {"size": options.size} for name in options.camera} or None, "sensing": None}
    envs = make_env(options.task, min(options.num_envs, 2 * wanted), compiled, curriculum=None, params=(), **given)
    if envs.max_episode_steps is None:
        raise ArgumentError(f"demos: task '{options.task}' should be registered with max_episode_steps.")
    demonstrator, files, kept, tried, start = Demonstrator(envs, names), [], 0, 0, time.perf_counter()
    while kept < wanted and tried < TRIES * wanted + envs.num_envs:
        tell("demonstrations", kept, wanted)
        rows, number = _played(envs, demonstrator, (options.seed + tried) % (1 << 64), wanted - kept)
        tried, kept = tried + number, kept + len(rows["length"])
        files.append(f"demos-{len(files):05}.npz")
        with replacing(folder / files[-1]) as file, file.open("wb") as opened:
            np.savez(opened, **rows)
    rate = kept / (time.perf_counter() - start)
    changes = [*options.changes, *(f"{key}={as_json(value)}" for key, value in raised.items())]
    found = {OK: kept == wanted, "task": options.task, "scene": scene.name, "hash": compiled.hash, "set": changes}
    found |= {"episodes": kept, "tried": tried, "success": kept / tried, "episodes_per_second": rate}
    told = {"targets": names, "fps": envs.metadata["render_fps"], "language": envs.task.language, "files": files}
    told |= {"observations": envs.observation_names, "sceniris_gym": sceniris_gym.__version__}
    write_text(folder / MANIFEST, as_json(found | told, indent=1) + "\n")
    if options.format == "lerobot":
        convert(folder, folder / "lerobot")
    return found


def report(found: Mapping[str, Any]) -> str:
    """Return the figures as text."""
    rate = f"{found['success']:.1%} of {found['tried']:,} episodes succeeded, {found['episodes_per_second']:.1f} kept/s"
    line = verdict(found, f"{found['episodes']:,} demonstrations of {found['task']}: {rate}")
    return "\n".join([line, *(f"--set {change}" for change in found["set"])])


def _targets(scene: SceneConfig, options: Demos) -> tuple[str, ...]:
    """Return the names of the objects to grasp."""
    reachable = dict.fromkeys(scene.owners.get(name, name) for name, part in scene.objects.items() if part.reachable)
    chosen = getattr(as_task(spec_of(options.task).kwargs["task"]), "targets", None)
    names = (options.target,) if options.target else tuple(chosen or reachable)
    check_names("reachable object", names, f"demos: scene '{scene.name}'", reachable)
    if not names or (len(names) > 1 and not chosen):
        needed = f"one target. Add --target with one of {', '.join(names)}" if names else "an object with 'reachable'"
        raise ArgumentError(f"demos: the scene of task '{options.task}' should have {needed}.")
    return names


@torch.no_grad()
def _played(envs: SceneVectorEnv, demonstrator: Demonstrator, seed: int, most: int) -> tuple[dict[str, Any], int]:
    """Play an episode in each world. Return at most `most` demonstrations, and how many episodes were tried."""
    observation, info = envs.reset(seed=seed)
    ids, s, steps = np.array(envs.layout_ids(info)), envs.state, []
    running, seeds = s.layout_status == LayoutStatus.VALID, s.seed.clone()
    success, length = torch.zeros_like(running), torch.zeros_like(seeds)
    demonstrator.start()
    for _ in range(envs.max_episode_steps or 0):
        step = {f"observation/{name}": part for name, part in observation.items() if name != GROUP}
        # pictures of all steps would not fit on a device
        step |= {f"image/{name}": part.cpu() for name, part in picture_names(observation.get(GROUP, {})).items()}
        step["action"] = demonstrator.act()
        observation, step["reward"], terminated, truncated, info = envs.step(step["action"])
        steps.append(step)
        length += running
        ends = running & (terminated | truncated)
        success |= ends & info["success"]
        running &= ~ends
    worlds = success.nonzero()[:most, 0]
    number = int(worlds[-1]) + 1 if len(worlds) == most else envs.num_envs
    inside = torch.arange(len(steps), device=s.device) < length[worlds, None]
    rows = {"length": length, "seed": seeds, "success": success}
    rows: dict[str, Any] = {name: values[worlds].cpu().numpy() for name, values in rows.items()}
    rows["id"] = ids[worlds.cpu().numpy()]
    for name in steps[0]:
        values = torch.stack([step[name] for step in steps], dim=1)
        rows[name] = values[worlds.to(values.device)][inside.to(values.device)].cpu().numpy()
    return rows, number
