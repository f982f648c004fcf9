"""Find tasks of this package and your tasks by name, and make their scenes and environments."""

import ast
import hashlib
import os
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import gymnasium
from gymnasium.envs.registration import EnvSpec

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, check_names
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.vector.arguments import as_task
from sceniris_gym.vector.task import Task
from sceniris_gym.vector.vector_env import SceneVectorEnv

NAMESPACE = "sceniris_gym/"
"""Namespace of this package's ids. Names of tasks omit this namespace."""

SEED_SPACING = 1 << 20
"""Least spacing between the seeds of experiments, so that their worlds do not share layouts."""


def import_here(module: str) -> Any:
    """Import a module, also from the working directory, where an installed program would not look for modules."""
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    return import_module(module)


def spec_of(task: str, where: str = "registered tasks (yours: MODULE:ID)") -> EnvSpec:
    """Return Gymnasium's spec of a task.

    Args:
        task: A registered id, or MODULE:ID, to import MODULE by `import_here` first. The namespace of this package is
            optional.
        where: The beginning of the error for an unknown task.

    Raises:
        ArgumentError: The module cannot be imported.
        UnknownNameError: No environment that has a task is registered under this id.
    """
    module, _, name = task.rpartition(":")
    if module:
        try:
            import_here(module)
        except ImportError as error:
            raise ArgumentError(f"{task}: '{module}' should be a module that Python can import: {error}.") from None
    tasks = {key.removeprefix(NAMESPACE): spec for key, spec in gymnasium.registry.items() if "task" in spec.kwargs}
    check_names("task", [name.removeprefix(NAMESPACE)], where, tasks)
    return tasks[name.removeprefix(NAMESPACE)]


def scene_of(task: str, *, reachable: bool) -> SceneConfig:
    """Return the scene of a task.

    If `reachable` is false, the result is a changed scene: no object needs to be reachable, and kinds of start with a
    target object (`of`) are left out.
    """
    kwargs = spec_of(task).kwargs
    scene = SceneConfig.load(kwargs.get("scene") or as_task(kwargs["task"]).scene, kwargs.get("overrides"))
    if reachable:
        return scene
    changes = {f"objects.{name}.reachable": False for name, part in scene.objects.items() if part.reachable}
    return SceneConfig.load(scene, {"start": [kind for kind in scene.start if kind.of is None], **changes})


def hashes_of(task: str, scene: SceneModel) -> dict[str, str]:
    """Return the hash of a task's scene, and a hash of the code of its class and base classes up to `Task`."""
    kinds = [kind for kind in type(as_task(spec_of(task).kwargs["task"])).__mro__ if kind not in Task.__mro__]
    return {"scene": scene.hash, "task": hashlib.sha256("".join(map(_code_of, kinds)).encode()).hexdigest()[:16]}


def _code_of(kind: type) -> str:
    """Return the code of a class, and of the constants, functions and classes of its file that this code uses."""
    file = getattr(sys.modules[kind.__module__], "__file__", None)  # None in a notebook
    statements = ast.parse(Path(file).read_bytes()).body if file else ()
    defined = {name: ast.unparse(statement) for statement in statements for name in _defined_by(statement)}
    names, code = [kind.__qualname__.partition(".")[0]], ""
    for name in names:  # it grows
        text = defined.pop(name, "")
        code, names[len(names) :] = code + text, re.findall(r"\w+", text)
    return code


def _defined_by(statement: ast.stmt) -> list[str]:
    """Return the names that a function, a class or an assignment defines."""
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return [statement.name]
    if not isinstance(statement, ast.Assign | ast.AnnAssign):
        return []
    targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
    named = [node for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)]
    return [node.id for node in named if isinstance(node.ctx, ast.Store)]


def make_env(task: str, num_envs: int, compiled: CompiledScene, **kwargs: Any) -> SceneVectorEnv:
    """Return the environment of a task on a CompiledScene.

    Raises:
        ArgumentError: The task is registered with an environment other than SceneVectorEnv.
    """
    envs = gymnasium.make_vec(spec_of(task), num_envs=num_envs, scene=compiled, overrides=None, **kwargs)
    if not isinstance(envs, SceneVectorEnv):
        entry = "vector_entry_point='sceniris_gym:SceneVectorEnv'"
        raise ArgumentError(f"task '{task}' should be registered with {entry}, but makes a {type(envs).__name__}.")
    return envs
