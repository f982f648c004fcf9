"""Draw points again in worlds where a param narrows the region of an object on a support to a box.

The region's triangles are clipped to the box, and the point is uniform by area in the clipped triangles.
"""

import warp as wp

from sceniris_gym.config.bounds import MAX_CORNERS
from sceniris_gym.device.random import uniforms
from sceniris_gym.device.transforms import apply, pose_of
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.posing import pose_candidate
from sceniris_gym.layout.wave.search import Search, Workspace, candidate_num, stream_of, trial_of
from sceniris_gym.placement.polygons import HalfPlane, area, clip, draw_in_polygon, set_triangle
from sceniris_gym.program.device import Cause, Program

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Number of this draw within a trial. Lower numbers belong to joints, higher numbers to regions cut by relations.
_DRAW = wp.constant(1 << 15)


@wp.func
def _clipped(program: Program, tri: int, box: wp.array[float], first: int, polygon: wp.array[wp.vec2]) -> int:
    """Clip a triangle to a box, write the result to `polygon`, and return its number of corners.

    The box is low x, low y, high x and high y [m], in four elements of `box` from index `first` on.
    """
    num = set_triangle(polygon, program.tri_a[tri], program.tri_b[tri], program.tri_c[tri])
    for k in range(4):
        corner = wp.vec2(box[first + 2 * (k // 2)], box[first + 1 + 2 * (k // 2)])
        outwards = wp.vec2(0.0)
        outwards[k % 2] = float(2 * (k // 2) - 1)
        num = clip(polygon, num, HalfPlane(outwards, corner, 0.0))
    return num


@wp.func
def _choose_triangle(
    program: Program, stable: int, box: wp.array[float], first: int, polygon: wp.array[wp.vec2], u: float
) -> int:
    """Choose a triangle of a stable pose's region. Its probability is proportional to its area inside a box.

    Return -1 if no triangle overlaps the box. The box is as in `_clipped`, and `u` is a uniform number. The first pass
    adds up the areas, and the second pass finds the triangle.
    """
    left = float(0.0)
    chosen = int(-1)
    adr = program.stable_triadr[stable]
    num = program.stable_trinum[stable]
    for i in range(2 * num):
        size = area(polygon, _clipped(program, adr + i % num, box, first, polygon))
        if i == num:
            left = -u * left
        if i >= num and size > 0.0 and (left <= 0.0 or chosen < 0):
            chosen = adr + i - num
        left += size
    return chosen


@wp.func
def _is_narrowed(layouts: LayoutsView, worldid: int, first: int) -> bool:
    """Return True if a world's box, its four param values from index `first` on, differs from the scene file."""
    narrowed = bool(False)
    for k in range(first, first + 4):
        if layouts.next_param[worldid, k] != layouts.default_param[k]:
            narrowed = True
    return narrowed


@wp.kernel(module="unique", module_options={"enable_backward": False, "fuse_fp": False}, grid_stride=False)
def _draw_in_boxes(
    lanes: int,
    program: Program,
    split: wp.uint32,
    columns: wp.array[int],
    # Layouts in: present, pending*, next_param, default_param, pivot_pose, bodies*
    layouts: LayoutsView,
    # Search in: restarts*, candidates, trials*, stable_draw, heading, qpos; out: surface, grasp, pivots*, flags*; both:
    #   cause, point, body_pos, body_quat
    search: Search,
):
    polygon = wp.zeros(shape=(MAX_CORNERS,), dtype=wp.vec2)
    for c in range(wp.tid(), candidate_num(search), lanes):
        obj = search.obj[c]
        first = columns[obj]
        row = search.row[c]
        worldid = search.row_world[row]
        if first < 0 or search.cause[c] != Cause.NONE:
            continue
        if not _is_narrowed(layouts, worldid, first):
            continue
        seed, episode = layouts.pending_seed[worldid], layouts.pending_episode[worldid]
        u = uniforms(seed, episode, stream_of(program, split, obj), trial_of(program, search, c), _DRAW)
        box = layouts.next_param[worldid]
        tri = _choose_triangle(program, search.stable_draw[c].stable, box, first, polygon, u[0])
        if tri < 0:
            search.cause[c] = Cause.EMPTY
            continue
        at = draw_in_polygon(polygon, _clipped(program, tri, box, first, polygon), u[1], u[2], u[3])
        ground = program.obj_ground[obj]
        frame = pose_of(layouts.body_pos[row, ground], layouts.body_quat[row, ground])
        search.surface[c] = program.tri_surface[tri]
        search.point[c] = apply(frame, wp.vec3(at[0], at[1], program.surface_height[program.tri_surface[tri]]))
        pose_candidate(program, layouts, search, c, row, obj)


def launch_draw_in_boxes(work: Workspace, columns: wp.array) -> None:
    """Draw the points of this wave's candidates again if a param narrows their region.

    Args:
        work: The arrays of the generator.
        columns: First column of each object's box in a row of param values, -1 for an object without a box, shape
            (nobject,), int32.
    """
    work.launch_lanes(_draw_in_boxes, work.program, work.split, columns, work.layouts, work.search)
