"""Least distances of pairs of colliders, world by world, where clearances are knobs."""

from __future__ import annotations

import numpy as np
import warp as wp

from sceniris_gym.layout.knobs import KnobTable
from sceniris_gym.layout.scene_knobs import clearances_of_pairs
from sceniris_gym.program.compiled import CompiledScene

wp.set_module_options({"enable_backward": False})


@wp.kernel
def _write_margins(
    # In:
    mask: wp.array[wp.bool],
    knob: wp.array2d[float],
    columns: wp.array[wp.vec2i],
    nominal: wp.array2d[float],
    # Out:
    margin: wp.array2d[float],
):
    worldid, pair = wp.tid()
    if mask:
        if not mask[worldid]:
            return
    least = nominal[0, pair]
    for k in range(2):
        column = columns[pair][k]
        if column >= 0:
            least = wp.max(least, knob[worldid, column])
    margin[worldid, pair] = least


class Margins:
    """The least distances of all pairs in all worlds.

    Args:
        compiled: The scene.
        table: The knobs of the worlds.
        margin: The distances [m], shape (nworld, npair), float32: `Program.pair_margin`.
    """

    def __init__(self, compiled: CompiledScene, table: KnobTable, margin: wp.array) -> None:
        names = [[table.first.get(name, -1) for name in (*pair, "", "")[:2]] for pair in clearances_of_pairs(compiled)]
        self._columns = wp.array(np.array(names), dtype=wp.vec2i, device=margin.device)
        self._nominal, self._margin = compiled.program.pair_margin, margin

    def launch(self, mask: wp.array | None, knob: wp.array) -> None:
        """Write the distances of the masked worlds by the numbers of their knobs, shape (nworld, nvalue)."""
        inputs = [mask, knob, self._columns, self._nominal]
        wp.launch(_write_margins, self._margin.shape, inputs=inputs, outputs=[self._margin], device=knob.device)
