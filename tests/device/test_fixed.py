"""Attributes that graphs hold on to: assigning another scene or source is refused, instead of having no effect."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.device.fixed import Fixed
from sceniris_gym.errors import FixedError, NotSupportedError, ScenirisError
from sceniris_gym.layout.ahead import Ahead
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.stored import StoredLayouts
from tests.layout.scenes import FLOOR, box_mjcf, compile_on_cpu, make

SCENE = {"floor": {"size": [1.0, 1.0]}, "objects": {"apple": {"asset": "apple", "on": "floor"}}, "bank": 1}


class Kept(Fixed):
    """Has one attribute that is fixed, one that is not, and an argument."""

    _FIXED = ("scene",)
    _ARGUMENTS = ("seed",)

    def __init__(self, scene: str, seed: int) -> None:
        self.scene, self.other = scene, seed


def test_attributes_are_set_once():
    """By the constructor; others as often as wanted."""
    kept = Kept("a", 3)
    kept.other = 4
    with pytest.raises(FixedError, match=r"Kept\.scene cannot be changed.*Make a new Kept with the new 'scene'"):
        kept.scene = "b"
    with pytest.raises(FixedError):
        del kept.scene
    del kept.other
    assert kept.scene == "a"


def test_arguments_that_are_no_attributes_cannot_become_some():
    """They would have no meaning."""
    with pytest.raises(FixedError, match=r"Kept\.seed"):
        Kept("a", 3).seed = 5


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


def test_a_compiled_scene_arrives_with_the_same_layouts(tmp_path: Path):
    """Its bank as well, since it is compiled from the same words."""
    crate = box_mjcf(tmp_path, "crate", 0.1, 0.1, 0.05)
    objects = {f"crate_{i}": {"asset": crate, "on": "floor"} for i in range(3)}
    sent = compile_on_cpu({"floor": FLOOR, "objects": objects, "attempts": 1, "restarts": 0}, bank=4)
    arrived = pickle.loads(pickle.dumps(sent))
    assert arrived.hash == sent.hash
    assert arrived.device == sent.device
    assert make(arrived, 64).bits() == make(sent, 64).bits()


@pytest.mark.parametrize("send", [pickle.dumps, copy.deepcopy])
def test_what_holds_memory_of_a_device_says_what_to_send(tmp_path: Path, send: object):
    """It was a TypeError about MuJoCo's specification."""
    crate = box_mjcf(tmp_path, "crate", 0.1, 0.1, 0.05)
    compiled = compile_on_cpu({"floor": FLOOR, "objects": {"crate": {"asset": crate, "on": "floor"}}}, bank=1)
    with pytest.raises(NotSupportedError, match=r"LayoutGenerator holds device memory .* Send its CompiledScene"):
        send(LayoutGenerator(compiled, 1))  # pyrefly: ignore[not-callable]


@pytest.mark.parametrize("send", [pickle.dumps, copy.deepcopy])
def test_layouts_and_all_their_sources_say_what_to_send(tmp_path: Path, send: object):
    """Of layouts their rows: it was an error about a local object of Warp's."""
    crate = box_mjcf(tmp_path, "crate", 0.1, 0.1, 0.05)
    compiled = compile_on_cpu({"floor": FLOOR, "objects": {"crate": {"asset": crate, "on": "floor"}}}, bank=1)
    generator = LayoutGenerator(compiled, 1)
    generator.generate()
    stored = StoredLayouts(compiled, generator.table(), 1)
    for kept, advice in (
        (generator.layouts, r"Layouts holds device memory .* Send its arrays as copies on the host"),
        (stored, r"StoredLayouts holds device memory .* Send its CompiledScene"),
        (Ahead(generator), r"Ahead holds device memory .* Send its CompiledScene"),
    ):
        with pytest.raises(NotSupportedError, match=advice):
            send(kept)  # pyrefly: ignore[not-callable]
