"""Stored layouts as a reset writes them, checked against the scene."""

from __future__ import annotations

import warp as wp

from sceniris_gym.errors import SceneMismatchError
from sceniris_gym.layout.layouts import Layouts, LayoutsView
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import fill_struct
from sceniris_gym.scene.layout_table import LayoutTable

_PARTS = ("qpos", "mocap_pos", "mocap_quat", "present", "start", "seed", "episode")
"""The parts of layouts that a reset writes."""


def stored_rows(layouts: Layouts | LayoutTable, compiled: CompiledScene, device: str) -> LayoutsView:
    """Return layouts of a scene that are stored anywhere, with the parts that a reset writes.

    Raises:
        SceneMismatchError: They are of another scene, or their sizes are not those of its model.
    """
    scene = layouts.scene if isinstance(layouts, LayoutTable) else layouts.compiled.hash
    if scene not in ("", compiled.hash):
        mismatch = compiled.scene.mismatch(scene, "Give layouts of this scene.")
        raise SceneMismatchError(f"layouts: each of them {mismatch}")
    m, nrow = compiled.mjm, layouts.qpos.shape[0]
    # without a mocap body Layouts have one unused column
    nmocap = layouts.mocap_pos.shape[1] if m.nmocap == 0 else m.nmocap
    columns = (("qpos", (m.nq,), wp.float32), ("mocap_pos", (nmocap, 3), wp.vec3), ("mocap_quat", (nmocap, 4), wp.quat))
    for name, shape, dtype in columns:
        array = getattr(layouts, name)
        # a Warp array of vectors has no axis for their elements
        found = (*array.shape, *shape[1:]) if array.dtype is dtype else tuple(array.shape)
        if found != (nrow, *shape):
            raise SceneMismatchError(
                f"layouts.{name} has shape {found} and should have shape {(nrow, *shape)}. Give layouts of this scene."
            )

    view = LayoutsView()
    for name in _PARTS:
        array = getattr(layouts, name)
        if isinstance(array, wp.array):
            setattr(view, name, array.to(device))
        else:
            fill_struct(LayoutsView, view, {name: array}, device)
    return view
