"""The public names. Each is imported from its module on first use."""

from . import adapters as adapters
from . import cli as cli
from . import config as config
from . import errors as errors
from . import levels as levels
from . import libero as libero
from . import pictures as pictures
from . import reach as reach
from . import training as training
from .builders.furniture import furniture as furniture
from .config.scene import SceneConfig as SceneConfig
from .dataset.reader import LayoutDataset as LayoutDataset
from .errors import ScenirisError as ScenirisError
from .errors import ScenirisWarning as ScenirisWarning
from .layout.ahead import Ahead as Ahead
from .layout.compile import compile_scene as compile_scene
from .layout.generate import LayoutGenerator as LayoutGenerator
from .layout.layouts import Layouts as Layouts
from .layout.layouts import LayoutStatus as LayoutStatus
from .layout.pipeline import Chooser as Chooser
from .layout.pipeline import LayoutPipeline as LayoutPipeline
from .layout.source import LayoutSource as LayoutSource
from .layout.stored import StoredLayouts as StoredLayouts
from .levels.curriculum import ADR as ADR
from .levels.curriculum import LevelReplay as LevelReplay
from .program.compiled import CompiledScene as CompiledScene
from .scene.adopt import edit_spec as edit_spec
from .scene.build import build_model as build_model
from .scene.layout_table import LayoutTable as LayoutTable
from .scene.model import SceneModel as SceneModel
from .sim.fit import make_worlds as make_worlds
from .sim.randomizer import ResetRandomizer as ResetRandomizer
from .sim.snapshot import Snapshot as Snapshot
from .vector.arm_controller import ArmController as ArmController
from .vector.bodies import Bounds as Bounds
from .vector.bodies import ContactSensor as ContactSensor
from .vector.evaluation import EpisodeResult as EpisodeResult
from .vector.evaluation import evaluate as evaluate
from .vector.observer import as_channels as as_channels
from .vector.sensing import Sensing as Sensing
from .vector.settings import ImageConfig as ImageConfig
from .vector.settings import RenderConfig as RenderConfig
from .vector.settings import SimConfig as SimConfig
from .vector.state import State as State
from .vector.statistics import EpisodeStatistics as EpisodeStatistics
from .vector.task import Task as Task
from .vector.vector_env import SceneVectorEnv as SceneVectorEnv

__all__: list[str]
__version__: str
