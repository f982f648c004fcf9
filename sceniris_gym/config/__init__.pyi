"""The public names of this module. Each is imported on first use."""

from .groups import GroupConfig as GroupConfig
from .groups import HeapConfig as HeapConfig
from .groups import StackConfig as StackConfig
from .objects import JointConfig as JointConfig
from .objects import ObjectConfig as ObjectConfig
from .objects import RegionConfig as RegionConfig
from .orientation import Orientation as Orientation
from .orientation import Stable as Stable
from .randomize import DrawConfig as DrawConfig
from .randomize import SceneDraws as SceneDraws
from .relations import Beside as Beside
from .relations import Between as Between
from .relations import Connection as Connection
from .relations import Direction as Direction
from .relations import Distance as Distance
from .relations import Joined as Joined
from .relations import Near as Near
from .robot import RobotConfig as RobotConfig
from .robot import TcpConfig as TcpConfig
from .scene_words import CameraConfig as CameraConfig
from .scene_words import Floor as Floor

__all__: list[str]
