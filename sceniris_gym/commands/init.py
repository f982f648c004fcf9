"""The `init` command: writes a first scene file for a model or a LIBERO problem file, once layouts are found."""

import gc
import io
import re
import sys
import warnings
import zipfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from sceniris_gym.commands.answer import OK, verdict
from sceniris_gym.commands.approach import add_reach
from sceniris_gym.config.fields import ROBOT
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import InfeasibleSceneError, ModelWarning, NotSupportedError, SceneFileError, ScenirisError
from sceniris_gym.files import check_new, write_text
from sceniris_gym.importers.libero.reader import LiberoTask, read_bddl
from sceniris_gym.importers.models.first_scene import FirstScene, first_scene, flow
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.model_files import zipped

_BANK = 8  # layouts, a small bank is enough to show that the scene has layouts
_OBJECT = re.compile(r"objects\.([A-Za-z_][A-Za-z0-9_-]*)|robot")


def init(model: Path, device: str | None = None) -> FirstScene:
    """Find a first scene of a model that compiles and has layouts.

    If an object does not fit entirely on its support, it may hang over the edge. If it falls over, it may lie. If it
    cannot be placed even so, it is commented out, with the reason.

    Args:
        model: An MJCF or URDF file.
        device: The device for trial layouts.

    Raises:
        ScenirisError: The model cannot be read, or no choice of objects gives a scene.
    """
    scene = first_scene(model)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("once", ModelWarning)
        compiled = _compiled(scene, device)
        if scene.robot is not None and not scene.robot.why:
            notes = scene.robot.notes
            if add_reach(scene, compiled):
                scene.robot.notes = notes
                add_reach(scene, _compiled(scene, device))
    return scene


def summary(scene: FirstScene, out: Path | None) -> dict[str, Any]:
    """Return the robot or None, the names of placed objects, and the commented-out objects with their reasons."""
    robot = None if scene.robot is None or scene.robot.why else scene.robot.words["in_model"]
    placed = [entry.name for entry in scene.objects if not entry.why]
    left = {entry.name: entry.why for entry in scene.objects if entry.why}
    return {"scene": None if out is None else str(out), "robot": robot, "placed": placed, "commented_out": left}


def report(found: dict[str, Any]) -> str:
    """Return a summary as text."""
    robot = "no robot" if found["robot"] is None else f"robot '{found['robot']}'"
    commented = f"; commented out, with reasons: {', '.join(left)}" if (left := found["commented_out"]) else ""
    return f"{found['scene']}: {robot}; placed: {', '.join(found['placed']) or 'nothing'}{commented}"


def write_task(task: LiberoTask, out: Path, device: str | None = None) -> dict[str, Any]:
    """Write the scene file of a LIBERO problem, and its model into the folder `NAME_model` next to the scene file.

    Returns:
        The scene file, the folder, the names of placed objects, and the goal.

    Raises:
        ScenirisError: The scene cannot be made, the scene file exists, or a file cannot be written.
    """
    check_new(out, "init")
    compile_scene(task.scene, device, overrides={"bank": _BANK})
    folder, problem = out.with_name(f"{out.stem}_model"), task.problem
    goal = [str(predicate) for predicate in problem.goal]
    with zipfile.ZipFile(io.BytesIO(zipped(task.scene.model))) as archive:
        archive.extractall(folder)
    words = task.scene.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude={"name", "model"})
    lines = [
        f"# The scene of {problem.path.name}: {problem.language}.",
        f"# Goal: {' '.join(goal)}. LiberoGoal evaluates it.",
        f"model: {flow(f'{folder.name}/{task.scene.model.modelname}.xml')}",
        *(f"{word}: {flow(value)}" for word, value in words.items() if word != "objects"),
        "objects:",
        *(f"  {name}: {flow(part)}" for name, part in words["objects"].items()),
    ]
    write_text(out, "\n".join(lines) + "\n")
    return {"scene": str(out), "model": str(folder), "placed": list(words["objects"]), "goal": goal}


def write_problems(model: Path, out: Path | None, options: Mapping[str, Any], device: str | None) -> dict[str, Any]:
    """Write the scene of a problem file, by `write_task`, or the scenes of a folder of problem files, by `write_suite`.

    `options` are arguments of `read_bddl`.

    Raises:
        NotSupportedError: `out` is missing, or it is a scene file and `model` a folder.
        ScenirisError: As `write_task` or `write_suite`.
    """
    if out is None:
        give = "Give -o FILE.yaml, or -o FOLDER for a folder of problem files."
        raise NotSupportedError(f"init: a problem file becomes two files, a scene and its model. {give}")
    read = partial(read_bddl, **options)
    return write_suite(model, out, read, device) if model.is_dir() else write_task(read(model), out, device)


def write_suite(folder: Path, out: Path, read: Callable[[Path], LiberoTask], device: str | None) -> dict[str, Any]:
    """Write the scenes of all problem files below a folder, and print each file's result to stderr.

    Args:
        folder: The folder. Its subfolders become subfolders of `out`.
        out: The output folder.
        read: Reads a problem file.
        device: The device for trial layouts.

    Returns:
        The scene and the goal of each written problem file, the refused files with reasons, and the verdict.

    Raises:
        NotSupportedError: `out` is a scene file.
        SceneFileError: No problem file is below the folder.
        OSError: A file cannot be written.
    """
    if out.suffix in (".yaml", ".yml"):
        raise NotSupportedError(f"--out {out}: a folder of problem files becomes a folder of scenes. Give a folder.")
    files = sorted(file for file in folder.rglob("*") if file.suffix.lower() == ".bddl")
    if not files:
        raise SceneFileError(f"{folder}: contains no problem files. Give a folder that contains .bddl files.")
    written, refused = {}, {}
    for file in files:
        name, target = str(file.relative_to(folder)), (out / file.relative_to(folder)).with_suffix(".yaml")
        try:
            task = write_task(read(file), target, device)
            written[name] = {"scene": task["scene"], "goal": task["goal"]}
        except ScenirisError as error:
            refused[name] = f"{type(error).__name__}: {error}"
        print(f"{name}: {refused.get(name, 'written')}", file=sys.stderr, flush=True)
        gc.collect()  # models are in cycles of few objects, which are rarely collected but hold 100 MB each
    return {OK: not refused, "written": written, "refused": refused}


def report_of_suite(found: dict[str, Any]) -> str:
    """Return the result of a folder of problem files as text: the verdict, then a table with a row for each file."""
    rows = {name: f"{task['scene']}  {' '.join(task['goal'])}" for name, task in found["written"].items()}
    rows |= {name: f"refused: {why}" for name, why in found["refused"].items()}
    width = max(map(len, rows))
    head = verdict(found, f"{len(found['written'])} of {len(rows)} problem files written")
    return "\n".join([head, *(f"{name:<{width}}  {rows[name]}" for name in sorted(rows))])


def _compiled(scene: FirstScene, device: str | None) -> CompiledScene:
    """Compile the scene until it succeeds.

    If an error names an object, let the object lie or overhang its support, by `relax`, or else comment it out.
    """
    while True:
        words = scene.words()
        config = SceneConfig.load(words, {"bank": _BANK, "name": scene.model.stem})
        try:
            return compile_scene(config, device)
        except ScenirisError as error:
            blamed = _OBJECT.search(str(error))
            name = error.name if isinstance(error, InfeasibleSceneError) else blamed and (blamed.group(1) or ROBOT)
            if name not in (words if name == ROBOT else words["objects"]):
                raise
            if not scene.relax(name, error):
                scene.comment_out(name, str(error).removeprefix(f"{config.where}: "))
