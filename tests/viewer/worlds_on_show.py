"""Worlds for the tests of the viewer: layouts of small scenes, as the layers see them."""

from __future__ import annotations

from functools import cache
from typing import Any

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.viewer.deck import LayoutDeck, Where
from sceniris_gym.viewer.shown import ShownWorld


@cache
def compiled_scene(name: str) -> CompiledScene:
    """Return a shipped scene, compiled once."""
    return compile_scene(name, "cpu")


def world_of(scene: str | dict[str, Any], seed: int = 0) -> ShownWorld:
    """Return the layout of a seed of a shipped scene, or of one that is given by its words."""
    compiled = compiled_scene(scene) if isinstance(scene, str) else compile_scene(SceneConfig.load(scene), "cpu")
    deck = LayoutDeck(compiled, 1)
    return ShownWorld(compiled, deck.make(Where(seed=seed)), stands=deck.stands("train"))
