"""Containment test of a wave's candidates against the objects placed before in their rows, for `geometry: visual`."""

import warp as wp

from sceniris_gym.collide.containment import is_one_inside
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.posing import candidate_poses
from sceniris_gym.layout.wave.search import Search, Workspace, candidate_num
from sceniris_gym.program.device import Cause, Program

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel(grid_stride=False)
def _test_containment(
    lanes: int,
    program: Program,
    parts: int,
    # Layouts in: bodies*
    layouts: LayoutsView,
    # Search in: candidates, row, obj, body_pos, body_quat; both: cause
    search: Search,
):
    for i in range(wp.tid(), parts * candidate_num(search), lanes):
        c = i // parts
        adr = program.obj_pairadr[search.obj[c]]
        for pair in range(adr + i % parts, adr + program.obj_pairnum[search.obj[c]], parts):
            if search.cause[c] == Cause.NONE:
                if is_one_inside(program, pair, candidate_poses(program, layouts, search, c, search.row[c], pair)):
                    search.cause[c] = Cause.COLLISION  # all lanes write the same value


def launch_test_containment(work: Workspace) -> None:
    """Reject candidates that enclose a placed object or are enclosed by one."""
    work.launch_lanes(_test_containment, [work.program, work.size.parts, work.layouts], work.search)
