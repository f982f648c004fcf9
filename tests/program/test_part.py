"""Parts of a scene: which objects can be placed alone, and what the program of these knows of the others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.part import chosen_objects, part_of
from tests.layout.scenes import FLOOR, box_mjcf, compile_on_cpu


@pytest.fixture(scope="module")
def hard() -> CompiledScene:
    """The shipped scene `hard`: a cabinet with a banana in its drawer, an apple, and an orange between both."""
    return compile_on_cpu("hard", bank=2)


def test_names_come_in_placement_order(hard: CompiledScene):
    """A single name is a list of one; what stands on an object has to be named with it."""
    assert chosen_objects(hard, ["orange", "apple"], "replace") == ("apple", "orange")
    assert chosen_objects(hard, "orange", "replace") == ("orange",)
    assert chosen_objects(hard, ["banana", "cabinet"], "replace") == ("cabinet", "banana")
    assert chosen_objects(hard, "cabinet", "extend", present=["apple"]) == ("cabinet",)


def test_what_cannot_be_placed_alone_is_refused(hard: CompiledScene):
    """Errors name the nearest object, or what is missing."""
    with pytest.raises(UnknownNameError, match=r"replace: unknown placed object 'aple'\. Did you mean 'apple'\?"):
        chosen_objects(hard, ["aple"], "replace")
    with pytest.raises(ArgumentError, match=r"'cabinet/upper_drawer' carries 'banana', .*Also name 'banana'"):
        chosen_objects(hard, ["cabinet"], "replace")
    with pytest.raises(ArgumentError, match="should name at least one object"):
        chosen_objects(hard, [], "replace")


def test_what_is_to_be_named_as_well_has_the_name_that_the_scene_file_has(tmp_path: Path):
    """An object with variants, by its own name and not by that of one of them, which would be refused."""
    box = box_mjcf(tmp_path, "box", 0.3, 0.3, 0.04)
    load = {"asset": ["can", "tin"], "on": "box"}
    compiled = compile_on_cpu({"floor": FLOOR, "objects": {"box": {"asset": box, "on": "floor"}, "load": load}}, bank=2)
    with pytest.raises(ArgumentError, match=r"'box' carries 'load', which moves along\. Also name 'load'\."):
        chosen_objects(compiled, "box", "replace")
    assert chosen_objects(compiled, ["box", "load"], "replace") == ("box", "load/can", "load/tin")


def test_everything_else_is_an_obstacle(hard: CompiledScene):
    """Alone, the apple is kept from the orange, which follows it in the scene; supports that move have to be level."""
    part = part_of(hard, ("apple",)).program
    orange = set(hard.scene.subtree("orange"))
    assert int(part.nobject) == 1
    assert orange & {int(body) for pair in part.pair_bodies.numpy() for body in pair[:2]}
    assert not orange & {int(b) for pair in _pairs(hard, "apple") for b in pair[:2]}
    assert part_of(hard, ("banana",)).program.obj_cutnum.numpy().tolist() == [1]
    assert hard.program.obj_cutnum.numpy()[hard.placed.index("banana")] == 0


def _pairs(compiled: CompiledScene, name: str) -> np.ndarray:
    """Return the bodies of the pairs that an object is tested with."""
    program, number = compiled.program, compiled.placed.index(name)
    first = program.obj_pairadr.numpy()[number]
    return program.pair_bodies.numpy()[first : first + program.obj_pairnum.numpy()[number]]
