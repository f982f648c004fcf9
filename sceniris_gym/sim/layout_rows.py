"""Stored layouts as a reset writes them, checked against the scene."""

from __future__ import annotations

import warp as wp

from sceniris_gym.errors import SceneMismatchError
from sceniris_gym.layout.columns import columns
from sceniris_gym.layout.layouts import Layouts, LayoutsView
from sceniris_gym.program.device import fill_struct
from sceniris_gym.scene.layout_table import LayoutTable


def stored_rows(layouts: Layouts | LayoutTable, own: Layouts, device: str) -> LayoutsView:
    """Return layouts that are stored anywhere, with the parts that a reset writes.

    Args:
        layouts: The layouts.
        own: Layouts of the worlds that they are written into.
        device: The device of the result.

    Raises:
        SceneMismatchError: They are of another scene, or their sizes do not fit its model. Or their physics or looks
            were drawn with knobs that the worlds do not have.
    """
    compiled, known = own.compiled, own.knobs.names
    stored = isinstance(layouts, LayoutTable)
    scene, knobs = (layouts.scene, layouts.knobs) if stored else (layouts.compiled.hash, layouts.knobs.names)
    compiled.scene.check_hash(scene, "layouts: each of them", "Give layouts of this scene.")
    if knobs != known and {*knobs, *known} & set(own.knobs.of_draws.values()):
        raise SceneMismatchError(
            f"layouts: were drawn with the knobs {list(knobs)}, and these worlds have {list(known)}. Make the "
            f"randomizer with knobs={list(knobs)}."
        )
    m, nrow = compiled.mjm, layouts.qpos.shape[0]
    # without a mocap body Layouts have one unused column
    nmocap = layouts.mocap_pos.shape[1] if m.nmocap == 0 else m.nmocap
    shapes = (("qpos", (m.nq,), wp.float32), ("mocap_pos", (nmocap, 3), wp.vec3), ("mocap_quat", (nmocap, 4), wp.quat))
    for name, shape, dtype in shapes:
        array = getattr(layouts, name)
        # a Warp array of vectors has no axis for their elements
        found = (*array.shape, *shape[1:]) if array.dtype is dtype else tuple(array.shape)
        if found != (nrow, *shape):
            raise SceneMismatchError(
                f"layouts.{name} has shape {found} and should have shape {(nrow, *shape)}. Give layouts of this scene."
            )

    view = LayoutsView()
    for name in ("knob", *columns("draw", "pose")) if knobs == known else columns("draw", "pose"):
        array = getattr(layouts, name)
        if isinstance(array, wp.array):
            setattr(view, name, array.to(device))
        else:
            fill_struct(LayoutsView, view, {name: array}, device)
    return view
