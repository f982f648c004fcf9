"""Fresh, collision-free scene layouts for every reset of batched MuJoCo-Warp environments.

Public names are imported on first use: `import sceniris_gym` loads neither torch, warp nor mujoco.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from sceniris_gym import registration

if TYPE_CHECKING:
    from sceniris_gym.config.scene import SceneConfig as SceneConfig
    from sceniris_gym.dataset.reader import LayoutDataset as LayoutDataset
    from sceniris_gym.errors import ArmError as ArmError
    from sceniris_gym.errors import AttemptsWarning as AttemptsWarning
    from sceniris_gym.errors import ContactBudgetError as ContactBudgetError
    from sceniris_gym.errors import CycleError as CycleError
    from sceniris_gym.errors import DatasetError as DatasetError
    from sceniris_gym.errors import ErodedSupportError as ErodedSupportError
    from sceniris_gym.errors import FallbackWarning as FallbackWarning
    from sceniris_gym.errors import GraspError as GraspError
    from sceniris_gym.errors import InfeasibleSceneError as InfeasibleSceneError
    from sceniris_gym.errors import KeysLeftOutWarning as KeysLeftOutWarning
    from sceniris_gym.errors import MapError as MapError
    from sceniris_gym.errors import MaskError as MaskError
    from sceniris_gym.errors import MaskTypeError as MaskTypeError
    from sceniris_gym.errors import MemoryLimitError as MemoryLimitError
    from sceniris_gym.errors import MeshError as MeshError
    from sceniris_gym.errors import ModelWarning as ModelWarning
    from sceniris_gym.errors import NoSupportError as NoSupportError
    from sceniris_gym.errors import NotSupportedError as NotSupportedError
    from sceniris_gym.errors import ReachWarning as ReachWarning
    from sceniris_gym.errors import SceneFileError as SceneFileError
    from sceniris_gym.errors import SceneKeyError as SceneKeyError
    from sceniris_gym.errors import SceneMismatchError as SceneMismatchError
    from sceniris_gym.errors import ScenirisError as ScenirisError
    from sceniris_gym.errors import SeedError as SeedError
    from sceniris_gym.errors import TaskError as TaskError
    from sceniris_gym.errors import UnknownNameError as UnknownNameError
    from sceniris_gym.importers.sceniris.reader import read_sceniris as read_sceniris
    from sceniris_gym.layout.compile import compile_scene as compile_scene
    from sceniris_gym.layout.generate import LayoutGenerator as LayoutGenerator
    from sceniris_gym.layout.layouts import Layouts as Layouts
    from sceniris_gym.layout.source import LayoutSource as LayoutSource
    from sceniris_gym.layout.stored import StoredLayouts as StoredLayouts
    from sceniris_gym.program.compiled import CompiledScene as CompiledScene
    from sceniris_gym.scene.adopt import place_on as place_on
    from sceniris_gym.scene.layout_table import LayoutTable as LayoutTable
    from sceniris_gym.scene.model import SceneModel as SceneModel
    from sceniris_gym.scene.model import build_model as build_model
    from sceniris_gym.sim.randomizer import ResetRandomizer as ResetRandomizer
    from sceniris_gym.vector.arm_controller import ArmController as ArmController
    from sceniris_gym.vector.bounds import Bounds as Bounds
    from sceniris_gym.vector.evaluation import EpisodeResult as EpisodeResult
    from sceniris_gym.vector.evaluation import evaluate as evaluate
    from sceniris_gym.vector.state import State as State
    from sceniris_gym.vector.task import Task as Task
    from sceniris_gym.vector.touch import Touch as Touch
    from sceniris_gym.vector.vector_env import SceneVectorEnv as SceneVectorEnv

__version__ = "0.1.0"

_HOME = {  # public name -> the module it lives in
    "SceneConfig": "config.scene",
    "SceneModel": "scene.model",
    "build_model": "scene.model",
    "place_on": "scene.adopt",
    "read_sceniris": "importers.sceniris.reader",
    "CompiledScene": "program.compiled",
    "compile_scene": "layout.compile",
    "Layouts": "layout.layouts",
    "LayoutGenerator": "layout.generate",
    "LayoutSource": "layout.source",
    "LayoutTable": "scene.layout_table",
    "StoredLayouts": "layout.stored",
    "ResetRandomizer": "sim.randomizer",
    "SceneVectorEnv": "vector.vector_env",
    "State": "vector.state",
    "Task": "vector.task",
    "LayoutDataset": "dataset.reader",
    "ArmController": "vector.arm_controller",
    "Bounds": "vector.bounds",
    "EpisodeResult": "vector.evaluation",
    "evaluate": "vector.evaluation",
    "Touch": "vector.touch",
    **dict.fromkeys(
        (
            "ScenirisError",
            "ArmError",
            "SceneFileError",
            "SceneKeyError",
            "NotSupportedError",
            "ReachWarning",
            "FallbackWarning",
            "AttemptsWarning",
            "ModelWarning",
            "UnknownNameError",
            "NoSupportError",
            "ErodedSupportError",
            "GraspError",
            "CycleError",
            "DatasetError",
            "MemoryLimitError",
            "MeshError",
            "ContactBudgetError",
            "InfeasibleSceneError",
            "KeysLeftOutWarning",
            "MapError",
            "MaskError",
            "MaskTypeError",
            "SeedError",
            "TaskError",
            "SceneMismatchError",
        ),
        "errors",
    ),
}

__all__ = ["__version__", *_HOME]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Import a public name on first use (PEP 562)."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names, imported or not."""
    return sorted({*globals(), *__all__})


registration.register_envs()
