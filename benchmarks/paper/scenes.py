"""The scenes of the paper in our words: its levels, with meshes as fine as its own, and an arm before the first."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import FallbackWarning
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene

Scene = tuple[str, Mapping[str, Any]]
"""A shipped scene, and what of it is changed."""

_FINE = {"geometry": "visual", "objects.apple.asset": "apple_16k", "objects.banana.asset": "banana_16k"}
_ORANGE = {"objects.orange.asset": "orange_16k"}

MID: Scene = ("mid_16k", {})
PHYSICS: Scene = ("mid", {})
HARD: Scene = ("hard", {**_FINE, **_ORANGE})
HARD_PLUS: Scene = ("hard_plus", {**_FINE, **_ORANGE, "objects.mug.asset": "mug_16k"})
ARM: Scene = ("mid_16k", {"robot": {"asset": "panda", "base": [0.0, -0.6, 0.0], "yaw": 90}})
ARM_REACHES: Scene = (
    "mid_16k",
    {**ARM[1], "objects.apple.reachable": "map", "objects.cabinet.reachable": "map"},
)
LEVELS: Mapping[str, Scene] = {"Hard": HARD, "Hard+": HARD_PLUS}


def without_restarts(scene: Scene) -> Scene:
    """Return a scene as the paper counts it: ten attempts an object, and a layout that fails is invalid."""
    name, changes = scene
    return name, {**changes, "attempts": 10, "restarts": 0}


def compiled_scene(scene: Scene, device: str) -> CompiledScene:
    """Compile a scene; a warning that many layouts would come from the bank is no news here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FallbackWarning)
        return compile_scene(SceneConfig.load(*scene), device)
