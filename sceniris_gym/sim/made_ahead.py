"""`MadeAhead`: rows of fields that were made with the next layouts, for resets to copy."""

from __future__ import annotations

import numpy as np
import warp as wp

wp.set_module_options({"enable_backward": False})

_LANES = 128
"""Lanes that copy the rows of a world."""


@wp.struct
class Rows:
    """A field of floats: first elements of what was made and of what is served, and the width of a row."""

    made: wp.uint64
    served: wp.uint64
    width: int


@wp.kernel
def _serve_rows(
    mask: wp.array[wp.bool],
    in_place: wp.array[wp.bool],
    written: wp.array[int],
    rows: wp.array[Rows],
    # Out:
    stale_out: wp.array[wp.bool],
):
    worldid, lane = wp.tid()
    is_stale = in_place[worldid] or written[0] != 0
    stale_out[worldid] = mask[worldid] and is_stale
    if is_stale or not mask[worldid]:
        return
    for i in range(rows.shape[0]):
        first = worldid * rows[i].width
        end = first + rows[i].width
        made = wp.array(ptr=rows[i].made, shape=(end,), dtype=float)
        served = wp.array(ptr=rows[i].served, shape=(end,), dtype=float)
        for k in range(first + lane, end, wp.block_dim()):
            served[k] = made[k]


class MadeAhead:
    """Fields of the next layouts of all worlds.

    Args:
        copied: Pairs of arrays of floats, shape (nworld, ...): what was made, and what is served.
        in_place: Worlds whose present layouts were not made ahead, shape (nworld,), bool.

    Attributes:
        written: 1 if somebody else writes to what these fields follow from, shape (1,), int32.
    """

    def __init__(self, copied: list[tuple[wp.array, wp.array]], in_place: wp.array) -> None:
        rows = [(made.ptr, served.ptr, served.strides[0] // 4) for made, served in copied]
        self._kept, self._in_place = copied, in_place  # they own the memory
        with wp.ScopedDevice(in_place.device):
            self._rows = wp.array(np.array(rows, Rows.numpy_dtype()), dtype=Rows)
            self._stale, self.written = wp.zeros_like(in_place), wp.zeros(1, dtype=int)

    def launch(self, mask: wp.array) -> wp.array:
        """Copy the rows of the masked worlds, and return those of them in which fields are to be found anew."""
        inputs, words = [mask, self._in_place, self.written, self._rows], {"block_dim": _LANES, "device": mask.device}
        wp.launch_tiled(_serve_rows, dim=[len(mask)], inputs=inputs, outputs=[self._stale], **words)
        return self._stale
