"""Pickling: a CompiledScene is compiled again in the other process; an object that holds memory is refused."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import pytest

from sceniris_gym.errors import NotSupportedError
from sceniris_gym.layout.ahead import Ahead
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.layout.tables import read_table
from tests.layout.scenes import FLOOR, box_mjcf, compile_on_cpu, make


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
    with pytest.raises(NotSupportedError, match=r"LayoutGenerator holds memory .* Send its CompiledScene"):
        send(LayoutGenerator(compiled, 1))  # type: ignore[operator]


@pytest.mark.parametrize("send", [pickle.dumps, copy.deepcopy])
def test_layouts_and_all_their_sources_say_what_to_send(tmp_path: Path, send: object):
    """Of layouts their rows: it was an error about a local object of Warp's."""
    crate = box_mjcf(tmp_path, "crate", 0.1, 0.1, 0.05)
    compiled = compile_on_cpu({"floor": FLOOR, "objects": {"crate": {"asset": crate, "on": "floor"}}}, bank=1)
    generator = LayoutGenerator(compiled, 1)
    generator.generate()
    stored = StoredLayouts(compiled, read_table(generator), 1)
    for kept, advice in (
        (generator.layouts, r"Layouts holds memory .* Send its arrays as copies on the host"),
        (stored, r"StoredLayouts holds memory .* Send its CompiledScene"),
        (Ahead(generator), r"Ahead holds memory .* Send its CompiledScene"),
    ):
        with pytest.raises(NotSupportedError, match=advice):
            send(kept)  # type: ignore[operator]
