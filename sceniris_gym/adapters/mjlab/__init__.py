"""Adapter for mjlab: layouts as a reset event, redraws as a command, and a curriculum of params."""

from sceniris_gym.adapters.mjlab.commands import RedrawObjects, RedrawObjectsCfg
from sceniris_gym.adapters.mjlab.terms import (
    KeepLayouts,
    PlaceLayouts,
    PlaceLayoutsCfg,
    keep_layouts,
    layouts_term,
    scene_param_stages,
)
from sceniris_gym.errors import refuses_old_imports

__all__ = [
    "KeepLayouts",
    "PlaceLayouts",
    "PlaceLayoutsCfg",
    "RedrawObjects",
    "RedrawObjectsCfg",
    "keep_layouts",
    "layouts_term",
    "scene_param_stages",
]
__getattr__ = refuses_old_imports(__name__)
