"""The public names. Each is imported from its module on first use."""

from . import errors as errors
from .config.scene import SceneConfig as SceneConfig
from .dataset.reader import LayoutDataset as LayoutDataset
from .errors import ScenirisError as ScenirisError
from .errors import ScenirisWarning as ScenirisWarning
from .importers.libero.reader import read_bddl as read_bddl
from .layout.compile import compile_scene as compile_scene
from .layout.generate import LayoutGenerator as LayoutGenerator
from .layout.layouts import Layouts as Layouts
from .layout.source import LayoutSource as LayoutSource
from .layout.stored import StoredLayouts as StoredLayouts
from .program.compiled import CompiledScene as CompiledScene
from .scene.adopt import edit_spec as edit_spec
from .scene.build import build_model as build_model
from .scene.layout_table import LayoutTable as LayoutTable
from .scene.model import SceneModel as SceneModel
from .sim.model_fields import put_model as put_model
from .sim.randomizer import ResetRandomizer as ResetRandomizer
from .vector.arm_controller import ArmController as ArmController
from .vector.bodies import Bounds as Bounds
from .vector.bodies import ContactSensor as ContactSensor
from .vector.evaluation import EpisodeResult as EpisodeResult
from .vector.evaluation import evaluate as evaluate
from .vector.libero_goal import LiberoGoal as LiberoGoal
from .vector.state import State as State
from .vector.task import Task as Task
from .vector.vector_env import SceneVectorEnv as SceneVectorEnv

__all__: list[str]
__version__: str
