"""Containment test of a wave's candidates against the objects placed before in their rows; for `geometry: visual`."""

import warp as wp

from sceniris_gym.collide.containment import in_bounds, in_solid
from sceniris_gym.device.transforms import Pose, relative
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.posing import candidate_poses
from sceniris_gym.layout.wave.search import Search, Workspace, candidate_num
from sceniris_gym.program.device import Cause, Program

wp.set_module_options({"enable_backward": False})


@wp.func
def _queue_points(program: Program, search: Search, c: int, a: int, b: int, rel: Pose):
    """Queue a point of each component of collider a that is in b's bounding box. `rel` is b's pose in a's frame."""
    at = wp.transpose(rel.rot)
    for i in range(program.collider_pointnum[a]):
        p = at * (program.point[program.collider_pointadr[a] + i] - rel.pos)
        if in_bounds(program, b, p):
            slot = wp.atomic_add(search.enclosed, 0, 1)
            if slot >= 0 and slot < search.enclosed_point.shape[0]:
                search.enclosed_candidate[slot] = c
                search.enclosed_by[slot] = b
                search.enclosed_point[slot] = p
            elif in_solid(program, b, p):  # the queue is full
                search.cause[c] = Cause.COLLISION


@wp.kernel(module="unique", enable_backward=False, grid_stride=False)
def _queue_enclosed(
    program: Program,
    lanes: int,
    parts: int,
    # Layouts in: body_pos, body_quat
    layouts: LayoutsView,
    # Search in: candidates, enclosed, row, obj, cause, body_pos, body_quat
    # Search out: enclosed, cause, enclosed_candidate, enclosed_by, enclosed_point
    search: Search,
):
    for i in range(wp.tid(), parts * candidate_num(search), lanes):
        c = i // parts
        row = search.row[c]
        obj = search.obj[c]
        adr = program.obj_pairadr[obj]
        for pair in range(adr + i % parts, adr + program.obj_pairnum[obj], parts):
            a = program.pair_a[pair]
            b = program.pair_b[pair]
            if search.cause[c] == Cause.NONE and program.collider_plane[b] < 0:
                poses = candidate_poses(program, layouts, search, c, row, pair)
                _queue_points(program, search, c, a, b, relative(poses.a, poses.b))
                _queue_points(program, search, c, b, a, relative(poses.b, poses.a))


@wp.kernel(module="unique", enable_backward=False, grid_stride=False)
def _test_enclosed(
    program: Program,
    lanes: int,
    # Search in: enclosed, cause, enclosed_candidate, enclosed_by, enclosed_point
    # Search out: cause
    search: Search,
):
    for i in range(wp.tid(), wp.min(search.enclosed[0], search.enclosed_point.shape[0]), lanes):
        c = search.enclosed_candidate[i]
        if search.cause[c] == Cause.NONE:
            if in_solid(program, search.enclosed_by[i], search.enclosed_point[i]):
                search.cause[c] = Cause.COLLISION  # all lanes write the same value


KERNELS = [_queue_enclosed, _test_enclosed]
"""The kernels of the containment test."""


def launch_test_containment(work: Workspace) -> None:
    """Reject candidates that enclose a placed object or are enclosed by one."""
    program, lanes = work.program, work.size.lanes
    work.launch(_queue_enclosed, lanes, [program, lanes, work.size.parts, work.layouts, work.search])
    work.launch(_test_enclosed, lanes, [program, lanes, work.search])
