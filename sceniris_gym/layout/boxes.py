"""Trees of boxes against each other: which leaves of a candidate come near what stands already?

A lane takes a pair of nodes with which the descent begins, and goes down both trees by itself. Leaves that come near
each other wait in a queue for lanes of their own; what does not fit into the queue is tested at once.
"""

import warp as wp

from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.leaves import PairPoses, leaves_touch, margin_of, over_plane, pair_poses, support_of
from sceniris_gym.layout.search import Search, list_of, row_of
from sceniris_gym.layout.transforms import Pose, apply, relative
from sceniris_gym.program.device import Cause, Program

wp.set_module_options({"enable_backward": False})

STACK = 64
"""Nodes that a descent may leave behind: one for each level of both trees."""
_STACK = wp.constant(STACK)
_NONE = wp.constant(int(Cause.NONE))
_COLLISION = wp.constant(int(Cause.COLLISION))


@wp.func
def boxes_separated(ca: wp.vec3, ha: wp.vec3, cb: wp.vec3, hb: wp.vec3, rel: Pose, margin: float) -> bool:
    """Is there a separating axis with a gap above `margin` between two boxes (centre, half extents)?

    Box b lies in the frame that `rel` places in a's. S. Gottschalk, M. Lin, D. Manocha, "OBBTree", SIGGRAPH 1996. The
    nine axes across edges are not normalised (their length is at most 1), which errs towards "not separated".
    """
    t = apply(rel, cb) - ca
    r = rel.rot
    f = wp.mat33(
        wp.abs(r[0, 0]), wp.abs(r[0, 1]), wp.abs(r[0, 2]),
        wp.abs(r[1, 0]), wp.abs(r[1, 1]), wp.abs(r[1, 2]),
        wp.abs(r[2, 0]), wp.abs(r[2, 1]), wp.abs(r[2, 2]),
    )  # fmt: skip
    ga = wp.vec3(wp.abs(t[0]), wp.abs(t[1]), wp.abs(t[2])) - ha - f * hb
    if wp.max(ga) > margin:
        return True
    tb = wp.transpose(r) * t
    gb = wp.vec3(wp.abs(tb[0]), wp.abs(tb[1]), wp.abs(tb[2])) - hb - wp.transpose(f) * ha
    if wp.max(gb) > margin:
        return True
    for i in range(3):
        i1 = (i + 1) % 3
        i2 = (i + 2) % 3
        for j in range(3):
            j1 = (j + 1) % 3
            j2 = (j + 2) % 3
            reach = ha[i1] * f[i2, j] + ha[i2] * f[i1, j] + hb[j1] * f[i, j2] + hb[j2] * f[i, j1]
            if wp.abs(t[i2] * r[i1, j] - t[i1] * r[i2, j]) - reach > margin:
                return True
    return False


@wp.func
def _nodes_separated(program: Program, pair: int, na: int, nb: int, poses: PairPoses, rel: Pose, margin: float) -> bool:
    """Are the boxes of two nodes of a pair further apart than `margin` [m]?"""
    center = program.node_center[na]
    half = program.node_half[na]
    plane = program.collider_plane[program.pair_b[pair]]
    if plane >= 0:
        over = over_plane(program, poses.a, poses.b, plane)
        n = over.normal
        reach = wp.abs(n[0]) * half[0] + wp.abs(n[1]) * half[1] + wp.abs(n[2]) * half[2]
        return over.height + wp.dot(n, center) - reach > margin
    return boxes_separated(center, half, program.node_center[nb], program.node_half[nb], rel, margin)


@wp.func
def _leave_to_queue(search: Search, c: int, pair: int, na: int, nb: int) -> bool:
    """Queue a pair of leaves; false if there is no room."""
    if search.leaf.shape[0] == 0:
        return False
    slot = wp.atomic_add(search.leaves, 0, 1)
    if slot >= search.leaf.shape[0]:
        return False
    search.leaf[slot] = wp.vec4i(c, pair, na, nb)
    return True


@wp.func
def _descend(program: Program, layouts: LayoutsView, search: Search, c: int, row: int, start: wp.vec3i, support: int):
    """Go down both trees from a pair of nodes, until all leaves below are apart, queued, or one of them touches."""
    pair = start[0]
    poses = pair_poses(program, layouts, search, c, row, pair)
    rel = relative(poses.a, poses.b)
    margin = margin_of(program, pair, support)
    stack = wp.zeros(shape=(_STACK,), dtype=wp.vec2i)
    stack[0] = wp.vec2i(start[1], start[2])
    count = int(1)
    while count > 0:
        count -= 1
        na = stack[count][0]
        nb = stack[count][1]
        if _nodes_separated(program, pair, na, nb, poses, rel, margin):
            continue
        child_a = program.node_child[na]
        child_b = program.node_child[nb]
        if child_a < 0 and child_b < 0:
            if not _leave_to_queue(search, c, pair, na, nb):
                if leaves_touch(program, pair, na, nb, poses, margin):
                    search.cause[c] = _COLLISION
                    return
            continue
        if child_b < 0 or (child_a >= 0 and wp.max(program.node_half[na]) > wp.max(program.node_half[nb])):
            stack[count] = wp.vec2i(child_a, nb)
            stack[count + 1] = wp.vec2i(child_a + 1, nb)
        else:
            stack[count] = wp.vec2i(na, child_b)
            stack[count + 1] = wp.vec2i(na, child_b + 1)
        count += 2


@wp.kernel
def _test_boxes(
    program: Program,
    lanes: int,
    lanes_each: int,
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    for i in range(wp.tid(), search.screened[0] * lanes_each, lanes):
        c = search.survivor[i // lanes_each]
        row = row_of(search, c)
        tests = list_of(search, row)
        adr = program.obj_startadr[tests]
        for s in range(adr + i % lanes_each, adr + program.obj_startnum[tests], lanes_each):
            if search.cause[c] == _NONE:
                _descend(program, layouts, search, c, row, program.start[s], support_of(program, tests))


def launch_test_boxes(
    program: Program, lanes: int, lanes_each: int, layouts: LayoutsView, search: Search, device: str
) -> None:
    """Test the candidates that passed the screen against all that stands."""
    inputs = [program, lanes, lanes_each, layouts]
    wp.launch(_test_boxes, dim=lanes, inputs=inputs, outputs=[search], device=device)
