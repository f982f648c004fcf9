"""Draw candidates. For each trial of a row's object, one lane draws joints, then an orientation, then a point.

If the region differs between worlds because of relations, `points.py` draws the point.
"""

import warp as wp

from sceniris_gym.device.random import uniforms
from sceniris_gym.device.transforms import angle_of, apply, mul_quat, pose_of, quat_mat, quat_z
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.points import draw_in_triangle, draw_triangle
from sceniris_gym.layout.wave.posing import pose_candidate
from sceniris_gym.layout.wave.search import MANY_ROWS, Search, Workspace, numbered_stream, stream_of, trial_of
from sceniris_gym.layout.wave.sides import Regions
from sceniris_gym.placement.kinematics import draw_joints, pose_bodies
from sceniris_gym.placement.measure import bounds_of, draw_stable, heading_of, measure
from sceniris_gym.placement.placed import is_there
from sceniris_gym.placement.relations import turn_to_sites
from sceniris_gym.program.device import Cause, Measure, ObjectKind, OrientationType, Program

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def _draw_static(program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int):
    """Pose a static object at its place in the model, with its joints drawn."""
    pose_bodies(program, obj, 0, search.qpos[c], search.body_pos[c], search.body_quat[c])
    if program.obj_measured[obj] == Measure.WHOLE:
        pivot_pose = layouts.pivot_pose[row, program.obj_column[obj]]
        search.bounds[c] = bounds_of(program, obj, pivot_pose, search.body_pos[c], search.body_quat[c])


@wp.func
def _draw_point(program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, u: wp.vec4):
    """Draw the heading. If the region is the same in all worlds, also draw the point under the pivot."""
    drawn = search.stable_draw[c]
    ground = program.obj_ground[obj]
    worldid = search.row_world[row]
    box = program.obj_box_upper[worldid, obj] - program.obj_box_lower[worldid, obj]
    search.point[c] = program.obj_box_lower[worldid, obj] + wp.cw_mul(wp.vec3(u[1], u[2], u[3]), box)
    other = program.obj_with[obj]
    is_joined = False
    if other >= 0:
        is_joined = is_there(layouts.present[row], other)
    search.heading[c] = drawn.yaw
    if is_joined:
        turn = turn_to_sites(program, obj, layouts.present[row])
        search.heading[c] = drawn.yaw + layouts.pivot_pose[row, other][3] + turn
    if ground < 0:
        return
    frame = pose_of(layouts.body_pos[row, ground], layouts.body_quat[row, ground])
    if program.obj_orientation[obj] != OrientationType.ANY and not is_joined:
        search.heading[c] = drawn.yaw + angle_of(frame.rot[0, 0], frame.rot[1, 0])
    if program.obj_cutnum[obj] > 0:
        return
    if program.stable_trinum[drawn.stable] == 0:
        search.cause[c] = Cause.EMPTY
        return
    tri = draw_triangle(program, drawn.stable, u[1])
    at = draw_in_triangle(program, tri, u[2], u[3])
    surface = program.tri_surface[tri]
    search.surface[c] = surface
    search.point[c] = apply(frame, wp.vec3(at[0], at[1], program.surface_height[surface]))


@wp.func
def _draw_from_heap(program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, u: float):
    """Pose an object of a heap relative to the container, as in one of the settled arrangements of the heap.

    All objects of the heap take the same arrangement, which is drawn once per restart, not once per trial.
    """
    heap = program.obj_heap[obj]
    settled = program.heap_pose[heap[0] + wp.min(int(u * float(heap[1])), heap[1] - 1)]
    settled_quat = wp.vec4(settled[3], settled[4], settled[5], settled[6])
    ground = program.obj_ground[obj]
    frame = pose_of(layouts.body_pos[row, ground], layouts.body_quat[row, ground])
    if frame.rot[2, 2] < program.obj_upright[obj]:
        search.cause[c] = Cause.EMPTY
        return
    quat = wp.normalize(mul_quat(layouts.body_quat[row, ground], settled_quat))
    drawn = search.stable_draw[c]
    drawn.yaw = heading_of(quat)
    drawn.quat = mul_quat(quat_z(-drawn.yaw), quat)
    if program.obj_measured[obj] != 0:
        drawn = measure(program, obj, drawn, search.qpos[c], search.body_pos[c], search.body_quat[c])
    search.stable_draw[c] = drawn
    search.heading[c] = drawn.yaw
    search.point[c] = apply(frame, wp.vec3(settled[0], settled[1], settled[2])) + quat_mat(quat) * drawn.pivot
    search.surface[c] = program.tri_surface[program.stable_triadr[drawn.stable]]
    pose_candidate(program, layouts, search, c, row, obj)


# Inlined, because a call on a CPU would copy the structs, which takes half as long as a draw.
@wp.func(inline=True)
def draw_candidate(program: Program, split: wp.uint32, layouts: LayoutsView, search: Search, c: int):
    """Draw a candidate's joints, orientation and point, and pose the candidate.

    If the region differs between worlds, this function draws only the joints and the orientation. `points.py` then
    draws the point and poses the candidate.
    """
    row = search.row[c]
    obj = search.obj[c]
    trial = trial_of(program, search, c)
    worldid = search.row_world[row]
    seed, episode = layouts.pending_seed[worldid], layouts.pending_episode[worldid]
    stream = stream_of(program, split, obj)
    search.cause[c] = Cause.NONE
    search.overflowed[c] = 0
    search.surface[c] = -1
    draw_joints(program, worldid, obj, seed, episode, stream, trial, search.qpos[c])
    if program.obj_kind[obj] == ObjectKind.STATIC:
        _draw_static(program, layouts, search, c, row, obj)
        return
    u = uniforms(seed, episode, stream, trial, 0)
    # Most objects need no second draw. Skipping it does not change other draws, because each has a number.
    w = wp.vec4(0.0)
    if program.obj_orientation[obj] == OrientationType.ANY or program.obj_stablenum[obj] > 1:
        w = uniforms(seed, episode, stream, trial, 1)
    drawn = draw_stable(program, worldid, obj, u, w)
    if program.obj_heap[obj][0] >= 0:
        search.stable_draw[c] = drawn
        of_heap = numbered_stream(split, program.obj_heap[obj][2])
        # one draw a restart, with the number of its first trial
        share = uniforms(seed, episode, of_heap, trial - search.trial[c], 0)[0]
        _draw_from_heap(program, layouts, search, c, row, obj, share)
        return
    if program.obj_measured[obj] != 0:
        drawn = measure(program, obj, drawn, search.qpos[c], search.body_pos[c], search.body_quat[c])
    search.stable_draw[c] = drawn
    _draw_point(program, layouts, search, c, row, obj, u)
    if program.obj_cutnum[obj] == 0 and search.cause[c] == Cause.NONE:
        pose_candidate(program, layouts, search, c, row, obj)


@wp.func
def begin_wave(search: Search):
    """Begin a wave with the queued rows. A single lane calls this after the rows have got their candidates."""
    search.candidates[0] = search.opened[0]
    search.rows_before[0] = search.rows[0]
    search.rows[0] = search.rows_left[0]
    search.many_rows[0] = int(search.rows_left[0] >= MANY_ROWS)
    search.rows_left[0] = 0
    search.source[0] = 1 - search.source[0]
    search.narrow_pairs[0] = 0
    search.hands[0] = 0
    search.any_overflowed[0] = 0


@wp.kernel(grid_stride=False)
def _draw(
    lanes: int,
    program: Program,
    split: wp.uint32,
    # Layouts in: present, pending*, pivot_pose, bodies*
    layouts: LayoutsView,
    # Regions out: counts*
    regions: Regions,
    # Search in: restarts*, row_first, opened, trials*; out: rows_before, many_rows, candidates, narrow_pairs, hands,
    #   any_overflowed, surface, grasp, overflowed, pivots*, flags*; both: rows_left, source, rows, cause, stable_draw,
    #   heading, point, poses*
    search: Search,
):
    if wp.tid() == 0:
        begin_wave(search)
        if regions.cuts:
            regions.cuts[0] = 0
            regions.regions[0] = 0
    for c in range(wp.tid(), wp.min(search.opened[0], search.cause.shape[0]), lanes):
        if c >= search.row_first[search.row[c]]:  # candidates before the first are drawn ahead
            draw_candidate(program, split, layouts, search, c)


def launch_draw(work: Workspace, regions: Regions) -> None:
    """Draw the candidates of this wave, except for points in regions that differ between worlds."""
    # A struct, since a CPU compiles a kernel with arrays among its arguments twice, and then inlines less.
    work.launch_lanes(_draw, work.program, work.split, work.layouts, regions, work.search)
