"""The `evaluate` command: judges the policy of a training on layouts that it has not seen."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sceniris_gym.errors import SceneMismatchError
from sceniris_gym.files import as_json, write_text
from sceniris_gym.scene.build import build_model
from sceniris_gym.training.judging import judge, judges_of
from sceniris_gym.training.records import MODEL, read_config, scene_of_run, share, without_layouts
from sceniris_gym.training.runner import runner_of
from sceniris_gym.training.task_scenes import scene_of


def evaluate(folder: Path, layouts: int, device: str | None, out: Path | None = None) -> dict[str, Any]:
    """Judge the policy in the folder of a run, and return what was found by the kind of layouts; see `judge`.

    Args:
        folder: The folder, as `train` made it.
        layouts: Number of layouts of each kind.
        device: Warp's name of the device; None takes "cuda:0" if there is one, else "cpu".
        out: JSON file to write, with the verdict on each layout.

    Raises:
        ArgumentError: The folder is not that of a run.
        SceneMismatchError: It is of a version with other layouts of the scene.
        ScenirisError: There is no such task, or its scene cannot be compiled.
    """
    task, settings = read_config(folder)
    scene = build_model(scene_of(task, reachable=True))
    if scene.former_hash is not None and scene_of_run(folder) in (None, scene.former_hash):
        raise SceneMismatchError(f"{folder}: this policy {scene.mismatch(scene.former_hash, '')}")
    found = {}
    for name, env in judges_of(task, layouts, device).items():
        runner = runner_of(env, settings, 0)
        runner.load(str(folder / MODEL), map_location=str(env.device))
        found[name] = judge(runner.get_inference_policy(str(env.device)), env, task, layouts)
    if out is not None:
        write_text(out, as_json(found))
    return without_layouts(found)


def report(found: Mapping[str, Any]) -> str:
    """Return the shares of successes as text, a line for each kind of layouts."""
    return "\n".join(f"{name}: {share(one)} of {one['layouts']:,} layouts" for name, one in found.items())
