"""Stored layouts as a reset writes them, checked against the scene."""

from __future__ import annotations

import warp as wp

from sceniris_gym.errors import ArgumentTypeError, SceneMismatchError
from sceniris_gym.layout.columns import columns
from sceniris_gym.layout.layouts import Layouts, LayoutsView
from sceniris_gym.layout.stored import check_table
from sceniris_gym.program.device import fill_struct
from sceniris_gym.scene.layout_table import LayoutTable


def stored_rows(layouts: Layouts | LayoutTable, own: Layouts, device: str) -> LayoutsView:
    """Return layouts that are stored anywhere, with the parts that a reset writes.

    Args:
        layouts: The layouts.
        own: Layouts of the worlds that they are written into.
        device: The device of the result.

    Raises:
        ArgumentTypeError: They are no layouts.
        SceneMismatchError: They are of another scene, or have rows that no layout of it has. Or their physics or looks
            were drawn with knobs that the worlds do not have.
        UnknownNameError, ArgumentError: They have knobs, or numbers of them, that the scene does not have.
    """
    if not isinstance(layouts, Layouts | LayoutTable):
        raise ArgumentTypeError(f"layouts should be Layouts or a LayoutTable, got {type(layouts)}.")
    compiled, known = own.compiled, own.knobs.names
    if isinstance(layouts, LayoutTable):
        check_table(compiled, layouts, "layouts")
        knobs = layouts.knobs
    else:
        compiled.scene.check_hash(layouts.compiled.hash, "layouts: each of them", "Give layouts of this scene.")
        knobs = layouts.knobs.names
    if knobs != known and {*knobs, *known} & set(own.knobs.of_draws.values()):
        raise SceneMismatchError(
            f"layouts: were drawn with the knobs {list(knobs)}, and these worlds have {list(known)}. Make the "
            f"randomizer with knobs={list(knobs)}."
        )
    view = LayoutsView()
    for name in ("knob", *columns("draw", "pose")) if knobs == known else columns("draw", "pose"):
        array = getattr(layouts, name)
        if isinstance(array, wp.array):
            setattr(view, name, array.to(device))
        else:
            fill_struct(LayoutsView, view, {name: array}, device)
    return view
