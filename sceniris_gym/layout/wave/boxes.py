"""Draw points anew in the worlds in which a knob narrows the region of an object to a box.

The region's triangles are clipped to the box, and a point is uniform by area in what is left of them; a box in space
takes the place of the one in the scene file.
"""

import warp as wp

from sceniris_gym.config.limits import MAX_CORNERS
from sceniris_gym.device.random import uniforms
from sceniris_gym.device.transforms import apply, pose_of
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.posing import pose_candidate
from sceniris_gym.layout.wave.search import Search, Workspace, candidate_num, stream_of, trial_of
from sceniris_gym.placement.polygons import area, clip, draw_in_polygon, half_plane, set_triangle
from sceniris_gym.program.device import Cause, Program

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Number of the draw of a trial; joints have those before it, and regions that relations cut those behind it.
_DRAW = wp.constant(1 << 15)


@wp.func
def _clipped(program: Program, tri: int, box: wp.vec4, polygon: wp.array[wp.vec2]) -> int:
    """Write the part of a triangle inside of a box (low x, low y, high x, high y); return its number of corners."""
    num = set_triangle(polygon, program.tri_a[tri], program.tri_b[tri], program.tri_c[tri])
    low = wp.vec2(box[0], box[1])
    high = wp.vec2(box[2], box[3])
    num = clip(polygon, num, half_plane(wp.vec2(-1.0, 0.0), low, 0.0))
    num = clip(polygon, num, half_plane(wp.vec2(0.0, -1.0), low, 0.0))
    num = clip(polygon, num, half_plane(wp.vec2(1.0, 0.0), high, 0.0))
    return clip(polygon, num, half_plane(wp.vec2(0.0, 1.0), high, 0.0))


@wp.func
def _draw_on_support(
    program: Program, layouts: LayoutsView, search: Search, c: int, row: int, obj: int, box: wp.vec4, u: wp.vec4
):
    """Draw a point of the support's triangles in a box, in two passes: the sum of their areas, then the share `u`."""
    variant = search.turn[c].variant
    adr = program.variant_triadr[variant]
    polygon = wp.zeros(shape=(MAX_CORNERS,), dtype=wp.vec2)
    total = float(0.0)
    for tri in range(adr, adr + program.variant_trinum[variant]):
        total += area(polygon, _clipped(program, tri, box, polygon))
    left = u[0] * total
    chosen = int(-1)
    for tri in range(adr, adr + program.variant_trinum[variant]):
        size = area(polygon, _clipped(program, tri, box, polygon))
        if size > 0.0 and (left >= 0.0 or chosen < 0):
            chosen = tri
        left -= size
    if chosen < 0:
        search.cause[c] = Cause.EMPTY
        return
    at = draw_in_polygon(polygon, _clipped(program, chosen, box, polygon), u[1], u[2], u[3])
    ground = program.obj_ground[obj]
    frame = pose_of(layouts.body_pos[row, ground], layouts.body_quat[row, ground])
    surface = program.tri_surface[chosen]
    search.surface[c] = surface
    search.point[c] = apply(frame, wp.vec3(at[0], at[1], program.surface_height[surface]))


@wp.kernel(module="unique", enable_backward=False, grid_stride=False)
def _draw_in_boxes(
    program: Program,
    split: wp.uint32,
    lanes: int,
    columns: wp.array[int],
    # Layouts in: present, pending_seed, pending_episode, pending_knob, default_knob, place, body_pos, body_quat
    layouts: LayoutsView,
    # Search in: row_world, row_restart, candidates, row, obj, trial, cause, turn, heading, point, qpos, body_pos,
    #   body_quat
    # Search out: cause, point, surface, place, bounds, grasp, covered, overhanging, body_pos, body_quat
    search: Search,
):
    for c in range(wp.tid(), candidate_num(search), lanes):
        obj = search.obj[c]
        first = columns[obj]
        if first < 0 or search.cause[c] != Cause.NONE:
            continue
        row = search.row[c]
        worldid = search.row_world[row]
        numbers = int(6)
        if program.obj_ground[obj] >= 0:
            numbers = 4
        differs = bool(False)
        for k in range(first, first + numbers):
            if layouts.pending_knob[worldid, k] != layouts.default_knob[k]:
                differs = True
        if not differs:
            continue
        knob = layouts.pending_knob[worldid]
        seed, episode = layouts.pending_seed[worldid], layouts.pending_episode[worldid]
        u = uniforms(seed, episode, stream_of(program, split, obj), trial_of(program, search, c), _DRAW)
        if numbers == 4:
            box = wp.vec4(knob[first], knob[first + 1], knob[first + 2], knob[first + 3])
            _draw_on_support(program, layouts, search, c, row, obj, box, u)
        else:
            low = wp.vec3(knob[first], knob[first + 1], knob[first + 2])
            high = wp.vec3(knob[first + 3], knob[first + 4], knob[first + 5])
            search.point[c] = low + wp.cw_mul(wp.vec3(u[0], u[1], u[2]), high - low)
        if search.cause[c] == Cause.NONE:
            pose_candidate(program, layouts, search, c, row, obj)


def launch_draw_in_boxes(work: Workspace, columns: wp.array) -> None:
    """Draw the points of this wave's candidates anew where a knob narrows their region.

    Args:
        work: The arrays of the generator.
        columns: First column of each object's box in a row of knobs, -1 for none, shape (nobject,), int32.
    """
    lanes = work.size.lanes
    work.launch(_draw_in_boxes, lanes, [work.program, work.split, lanes, columns, work.layouts], work.search)
