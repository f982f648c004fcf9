"""The public names of this module. Each is imported on first use."""

from .arm import SerialArm as SerialArm
from .build import build_map as build_map
from .lookup import map_verdict as map_verdict
from .map import ReachMap as ReachMap

__all__: list[str]
