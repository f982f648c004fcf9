"""Parts of a scene: which objects can be placed alone, and what the program of these knows of the others."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.part import chosen_objects, part_of
from tests.layout.scenes import compile_on_cpu


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
    with pytest.raises(ArgumentError, match=r"'cabinet/upper_drawer' carries 'banana'\. Name 'banana'"):
        chosen_objects(hard, ["cabinet"], "replace")
    with pytest.raises(ArgumentError, match="should name one object at least"):
        chosen_objects(hard, [], "replace")


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
