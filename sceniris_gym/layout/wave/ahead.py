"""Objects drawn ahead: the leading ones of which no candidate failed while the scene was compiled.

They are drawn and placed as a round begins, and tested in its first wave beside the trials of the next object, so that
they need no waves of their own. If one of them fails, its row goes back to it.
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
    """Return the number of objects that are drawn ahead, all of them before the last object and every reach target.

    None has a region that differs between worlds, and no start places one at a marker. One lane, which a CPU is, has
    nothing to gain, and no effort is known before there is a bank.
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
    # Layouts in: present, pending*; out: state*, grasp, stable, bounds; both: place, bodies*
    layouts: LayoutsView,
    # Search in: restarts*, queue, row_first, row_ahead, rows_left, source, trials*, free; out: row_free, placed*,
    #   overflowed, flags*; both: cause, stable_draw, heading, point, surface, grasp, places*, poses*
    search: Search,
):
    for i in range(wp.tid(), search.rows_left[0], lanes):
        row = search.queue[1 - search.source[0], i]
        for c in range(search.row_first[row] - search.row_ahead[row], search.row_first[row]):
            draw_candidate(program, split, layouts, search, c)
            place(program, reach, layouts, search, c, row, search.obj[c], 0, 1)


def launch_draw_ahead(work: Workspace) -> None:
    """Draw and place the objects ahead of the queued rows, which have placed nothing."""
    work.launch_lanes(_draw_ahead, [work.program, work.reach, work.split, work.layouts], work.search)
