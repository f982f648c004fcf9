"""Clears constraint rows of worlds that are reset."""

import mujoco_warp as mjw
import warp as wp

wp.set_module_options({"enable_backward": False})

LANES = 32


@wp.kernel
def _clear_rows(mask: wp.array[wp.bool], j_out: wp.array3d[float], d_out: wp.array2d[float]):
    worldid, lane = wp.tid()
    if not mask[worldid]:
        return
    width = j_out.shape[2]
    for i in range(lane, j_out.shape[1] * width, LANES):
        j_out[worldid, i // width, i % width] = 0.0
    for i in range(lane, d_out.shape[1], LANES):
        d_out[worldid, i] = 0.0


def clear_constraints(d: mjw.Data, mask: wp.array) -> None:
    """Zero the Jacobian and the mass of all constraint rows of the worlds in `mask`, shape (nworld,), bool.

    The solver reads rows by tiles of 16, those behind the last constraint too. `mjw.reset_data` leaves them, so NaNs of
    a broken world would come back with the first constraint after its reset.
    """
    wp.launch(_clear_rows, (d.nworld, LANES), inputs=[mask], outputs=[d.efc.J, d.efc.D], device=mask.device)
