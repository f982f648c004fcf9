"""Objects drawn ahead: the first objects in placement order, if their candidates never failed during compilation.

They are drawn and placed at the beginning of a round, and tested in its first wave together with the trials of the next
object. This saves one wave per object. If one of these objects fails, its row goes back to the failed object.
"""

import numpy as np
import warp as wp

from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.accept import place
from sceniris_gym.layout.wave.draw import draw_candidate
from sceniris_gym.layout.wave.search import Search, SearchSize, Workspace
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import UNASKED, Reach

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


def count_ahead(compiled: CompiledScene, size: SearchSize) -> int:
    """Return the number of objects to draw ahead.

    Drawing ahead ends before the last object. It also ends before an object that is tested for reach, that needed
    retries during compilation, whose region differs between worlds, or that a kind of start places at a marker. The
    number is 0 on a CPU, where a single lane does all the work and gains no time. It is also 0 before there is a bank,
    because the number of retries is still unknown.
    """
    program = compiled.program
    if size.busy == 1 or compiled.bank.ntrain == 0:
        return 0
    waits = (program.obj_effort.numpy() > 1.0) | (program.obj_cutnum.numpy() > 0)
    if compiled.reaching is not None:
        waits |= compiled.reaching.arms[0].view.obj_reach.numpy() != UNASKED
    if compiled.starts is not None:
        waits |= (compiled.starts.marker.numpy() >= 0).any(axis=0)
    return int(np.argmax(np.append(waits[:-1], True)))


@wp.kernel(grid_stride=False)
def _draw_ahead(
    lanes: int,
    program: Program,
    reach: Reach,
    split: wp.uint32,
    # Layouts in: present, pending*; out: state*, grasp, stable, bounds; both: pivot_pose, bodies*
    layouts: LayoutsView,
    # Search in: restarts*, queue, row_first, row_ahead, rows_left, source, trials*, free; out: row_free, placed*,
    #   overflowed, flags*; both: cause, stable_draw, heading, point, surface, grasp, pivots*, poses*
    search: Search,
):
    for i in range(wp.tid(), search.rows_left[0], lanes):
        row = search.queue[1 - search.source[0], i]
        for c in range(search.row_first[row] - search.row_ahead[row], search.row_first[row]):
            draw_candidate(program, split, layouts, search, c)
            place(program, reach, layouts, search, c, row, search.obj[c], 0, 1)


def launch_draw_ahead(work: Workspace) -> None:
    """In the queued rows, draw and place the objects drawn ahead. These rows have no placed object yet."""
    work.launch_lanes(_draw_ahead, work.program, work.reaches[0], work.split, work.layouts, work.search)
