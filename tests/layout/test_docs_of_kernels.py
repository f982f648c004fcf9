"""Docstrings list the arrays of a batch and of a CompiledScene: every name, in the order of the fields."""

import inspect
import re

import pytest

from sceniris_gym.device.tensors import TensorView
from sceniris_gym.geometry.colliders import Collider
from sceniris_gym.geometry.pieces import Piece
from sceniris_gym.geometry.supports import SupportSurface
from sceniris_gym.layout.layouts import Layouts, LayoutsView
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.plan import PlacedObject, Plan
from sceniris_gym.scene.model import SceneModel


def _documented(cls: type) -> list[str]:
    """The names under "Attributes:" in a class's docstring, in order."""
    text = (cls.__doc__ or "").split("Attributes:")[1]
    listed = re.findall(r"^ {8}([\w, ]+): ", text, re.MULTILINE)
    return [name.strip() for line in listed for name in line.split(",")]


@pytest.mark.parametrize("cls", [Collider, Piece, PlacedObject, Plan, SceneModel, SupportSurface, CompiledScene])
def test_a_docstring_lists_the_fields_in_their_order(cls: type):
    """All of them, and no other."""
    assert _documented(cls) == [*inspect.get_annotations(cls)]


def test_layouts_are_documented_in_the_order_of_the_view():
    """Every public array is a descriptor, is documented with its shape, and comes in the order of the device struct."""
    public = [name for name, value in vars(Layouts).items() if isinstance(value, property | TensorView)]
    public = [name for name in public if name not in ("nworld", "reaching")]
    assert [name for name in LayoutsView.vars if name in public] == public  # pyrefly: ignore[missing-attribute]
    assert _documented(Layouts) == ["compiled", "view", "params", *public]
    for name in public:
        line = re.search(rf"^ {{8}}{name}: (.*(?:\n {{12}}.*)*)", Layouts.__doc__ or "", re.MULTILINE)
        assert line is not None
        assert "shape (" in line.group(1)
