"""`LayoutRows`: the parts of layouts that a reset writes, whether just made or stored."""

from __future__ import annotations

from typing import Any, NamedTuple

import warp as wp

from sceniris_gym.errors import SceneMismatchError
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.sim.write import Poses


class LayoutRows(NamedTuple):
    """Layouts on the device, a row for each.

    Attributes:
        poses: Their poses.
        present: Which objects are present, shape (nrow, nslot), int32.
        start: Kinds of start, shape (nrow,), int32.
        seed, episode: What they were made by, shape (nrow,), uint64 and int32.
        knob: Numbers of the knobs, shape (nrow, nvalue); None for those of the scene file.
    """

    poses: Poses
    present: wp.array
    start: wp.array
    seed: wp.array
    episode: wp.array
    knob: wp.array | None


def rows_of(layouts: Layouts) -> LayoutRows:
    """Return the layouts of worlds, in the memory that resets fill."""
    poses, own = Poses(layouts.qpos, layouts.mocap_pos, layouts.mocap_quat), layouts
    return LayoutRows(poses, own.present, own.start, own.seed, own.episode, own.knob)


def stored_rows(layouts: Layouts | LayoutTable, compiled: CompiledScene, device: wp.Device) -> LayoutRows:
    """Return layouts of a scene that are stored anywhere.

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

    def upload(name: str, dtype: Any, ndim: int) -> wp.array:
        array = getattr(layouts, name)
        return array.to(device) if isinstance(array, wp.array) else wp.array(array, dtype, ndim=ndim, device=device)

    return LayoutRows(
        Poses(*(upload(name, dtype, 2) for name, _, dtype in columns)),
        upload("present", int, 2),
        upload("start", int, 1),
        upload("seed", wp.uint64, 1),
        upload("episode", int, 1),
        layouts.knob if isinstance(layouts, Layouts) else None,
    )
