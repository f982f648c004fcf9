"""Attributes that graphs hold on to: assigning another scene or source is refused, instead of having no effect."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sceniris_gym.device.fixed import Fixed
from sceniris_gym.errors import FixedError, ScenirisError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator

SCENE = {"floor": {"size": [1.0, 1.0]}, "objects": {"apple": {"asset": "apple", "on": "floor"}}, "bank": 1}


class Kept(Fixed):
    """Has one attribute that is fixed, one that is not, and an argument."""

    FIXED = ("scene",)
    ARGUMENTS = ("seed",)

    def __init__(self, scene: str, seed: int) -> None:
        self.scene, self.other = scene, seed


def test_attributes_are_set_once():
    """By the constructor; others as often as wanted."""
    kept = Kept("a", 3)
    kept.other = 4
    with pytest.raises(FixedError, match=r"Kept\.scene cannot be changed.*Make another Kept with the other 'scene'"):
        kept.scene = "b"
    with pytest.raises(FixedError):
        del kept.scene
    del kept.other
    assert kept.scene == "a"


def test_arguments_that_are_no_attributes_cannot_become_some():
    """They would have no meaning."""
    with pytest.raises(FixedError, match=r"Kept\.seed"):
        Kept("a", 3).seed = 5  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ["compiled", "split", "size", "layouts", "seed", "nworld"])
def test_a_generator_keeps_what_its_graph_was_captured_with(name: str):
    """After a graph was captured, its layouts go on as before."""
    compiled = compile_scene(SCENE, "cpu")
    generator, other = (LayoutGenerator(compiled, 4) for _ in range(2))
    for _ in range(2):
        generator.generate()
        other.generate()
    value: Any = getattr(other, name, 7)
    with pytest.raises(ScenirisError, match="cannot be changed"):
        setattr(generator, name, value)
    generator.generate()
    other.generate()
    assert np.array_equal(generator.layouts.qpos.numpy(), other.layouts.qpos.numpy())
