"""Prove that a robot touches nothing along pieces of a polyline in joint space.

An *entry* is a pair of colliders with one node from the box tree of each, as in `collide.boxes`, and an interval of a
piece. If the distance of the two nodes in the middle of the interval exceeds the pair's motion from there to the ends,
the entry is free. Otherwise, entries with child nodes or with half the interval replace it. If two leaves are nearer
than the margin, the piece is not free. So what is found does not depend on the order of entries. Each lane of a block
takes one entry at a time from the stacks that the block shares.

The robot is posed in the pre-grasp. A joint turns or moves everything beyond it about its axis in that pose, so a
link's displacement from the pre-grasp is a product of such motions (the product of exponentials of R. Brockett, 1984).
For a pair, only the joints between its two bodies count.
"""

from typing import Any

import warp as wp

from sceniris_gym.collide.boxes import next_step
from sceniris_gym.collide.leaves import PairPoses, inner_boxes_touch, leaves_touch, margin_of, pair_poses
from sceniris_gym.device.blocks import block_any
from sceniris_gym.device.transforms import axis_angle_quat, compose, mul_quat, pose_of, relative, rot_vec_quat
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.search import ReachSearch, pose_index
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.reach.solve import frames

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

NODE_STACK = 1024
"""Capacity of the stack of entries: one per lane and level of both trees, and per lane and level of halving."""
LEAF_STACK = 64
"""Capacity of the stack of entries with two leaves, for up to 32 lanes. Entries wait until each lane has one."""
APPROACH = 3
"""Number of the piece from the pre-grasp to the grasp, the last of a path."""
HAND_MARGIN = 0.0005
"""Least distance [m] of the hand from the layout, except for the target, on the way from the pre-grasp to the grasp."""

# An interval is a piece, a level and a number, in this order of bits. Its half width is 2^-level of the piece, and its
# middle is at (2 number + 1) 2^-level. At level 0, the middle is the end of the piece.
_LEVEL_BITS = wp.constant(16)
_PIECE_BITS = wp.constant(21)
_SAMPLE = wp.constant(1 << 24)  # of an interval: only the middle counts
_DEEPEST = wp.constant(17)
# First, the ends of the pieces and three poses of each are tested, because most pieces that are not free touch there.
_SAMPLES = wp.constant(4)


@wp.struct
class Swept:
    """A pair in the middle of an interval."""

    poses: PairPoses
    motion: float  # upper bound of how far [m] points of the two bodies move relative to each other until the ends


@wp.struct
class Next:
    """The result of a test of an entry: the piece is not free, leaves remain to test, or two entries replace it."""

    blocked: bool
    leaf: bool
    split: bool
    left: wp.vec4i
    right: wp.vec4i


@wp.func
def write_joints(reach: Reach, layouts: LayoutsView, reach_search: ReachSearch, c: int, block: int):
    """Write the origins [m] and axes of the arm's joints in a candidate's pre-grasp, in the world, for a block."""
    row = reach_search.row[c]
    _pos, _quat, origin, axis = frames(reach.arm, reach_search.pregrasp_qpos[c])
    base_pos = layouts.body_pos[row, reach.base_body]
    base_quat = layouts.body_quat[row, reach.base_body]
    for j in range(MAX_JOINTS):
        at = wp.vec3(origin[j, 0], origin[j, 1], origin[j, 2])
        reach_search.joint_pos[block, j] = base_pos + rot_vec_quat(at, base_quat)
        reach_search.joint_axis[block, j] = rot_vec_quat(wp.vec3(axis[j, 0], axis[j, 1], axis[j, 2]), base_quat)


@wp.func
def sweep_pair(
    program: Program,
    reach: Reach,
    layouts: LayoutsView,
    reach_search: ReachSearch,
    c: int,
    block: int,
    pair: int,
    interval: int,
) -> Swept:
    """Return a pair in the middle of an interval of the path whose corners are in `ReachSearch.corner`."""
    row = reach_search.row[c]
    at = pose_index(reach_search, c, 1)
    swept = Swept()  # pyrefly: ignore[missing-argument]
    poses = pair_poses(
        program,
        pair,
        reach_search.body_pos[at],
        reach_search.body_quat[at],
        layouts.body_pos[row],
        layouts.body_quat[row],
    )
    piece = (interval >> _PIECE_BITS) & 7
    half = 1.0 / float(1 << ((interval >> _LEVEL_BITS) & 31))
    share = float(2 * (interval & 0xFFFF) + 1) * half
    if interval >= _SAMPLE:
        half = 0.0
    a = program.pair_bodies[pair][0]
    b = program.pair_bodies[pair][1]
    first = reach.arm_link[a]
    last = reach.arm_link[b]
    far = wp.where(first > last, a, b)
    pos = wp.vec3(0.0)
    quat = wp.vec4(1.0, 0.0, 0.0, 0.0)
    for j in range(wp.min(first, last), wp.max(first, last)):
        joint = reach_search.corner[block, piece, j]
        change = reach_search.corner[block, piece + 1, j] - joint
        swept.motion += half * wp.abs(change) * reach.arm_moves[far, j]
        change = joint + share * change - reach_search.corner[block, wp.static(APPROACH), j]
        axis = reach_search.joint_axis[block, j]
        if reach.arm.slide[j] != 0:
            pos += rot_vec_quat(change * axis, quat)
        else:
            origin = reach_search.joint_pos[block, j]
            turn = axis_angle_quat(axis, change)
            pos += rot_vec_quat(origin - rot_vec_quat(origin, turn), quat)
            quat = wp.normalize(mul_quat(quat, turn))
    displacement = pose_of(pos, quat)
    if first > last:
        poses.a = compose(displacement, poses.a)
    else:
        poses.b = compose(displacement, poses.b)
    poses.rel = relative(poses.a, poses.b)
    swept.poses = poses
    return swept


@wp.func
def _root(program: Program, reach: Reach, column: int, turn: int, piece: int, number: int) -> wp.vec4i:
    """Return the first entry of a pair and a piece in a turn: at a sample, and in the last turn the whole piece.

    `number` counts the pairs of the robot with itself, with the layout, and with its target.
    """
    interval = (piece << _PIECE_BITS) + (1 << _LEVEL_BITS)
    if turn < _SAMPLES:  # at levels 0, 1, 2 and 2
        interval = (piece << _PIECE_BITS) + (wp.min(turn, 2) << _LEVEL_BITS) + turn // 3 + _SAMPLE
    pairs = reach.arm_self[column]
    i = int(number)
    if i >= reach.arm_broadnum[pairs]:
        i -= reach.arm_broadnum[pairs]
        pairs = reach.arm_scene[column]
        if i >= reach.arm_broadnum[pairs]:
            i -= reach.arm_broadnum[pairs]
            pairs = reach.arm_target[column]
    roots = program.broad_pair[reach.arm_broadadr[pairs] + i]
    return wp.vec4i(roots[0], roots[1], roots[2], interval)


@wp.func
def _finest(program: Program, reach: Reach, column: int, entry: wp.vec4i) -> float:
    """Return the least distance [m] of a pair, which is also the motion of an interval that is not halved."""
    bodies = program.pair_bodies[entry[0]]
    is_hand = wp.max(reach.arm_link[bodies[0]], reach.arm_link[bodies[1]]) == reach.arm.njoint
    if is_hand and (entry[3] >> _PIECE_BITS) & 7 == wp.static(APPROACH):
        return wp.static(HAND_MARGIN)
    return reach.reach_margin[column]


@wp.func
def _test(
    program: Program,
    reach: Reach,
    layouts: LayoutsView,
    reach_search: ReachSearch,
    c: int,
    block: int,
    column: int,
    entry: wp.vec4i,
    narrow: bool,
) -> Next:
    """Test an entry, and its leaves if `narrow`. Pairs that touch in the model's start pose have no margin."""
    swept = sweep_pair(program, reach, layouts, reach_search, c, block, entry[0], entry[3])
    margin = margin_of(program, 0, entry[0], -1)
    finest = _finest(program, reach, column, entry)
    following = Next()  # pyrefly: ignore[missing-argument]
    couple = wp.vec3i(entry[0], entry[1], entry[2])
    room = wp.max(margin, 0.0) + wp.max(swept.motion, finest)
    near = bool(False)
    if narrow:
        least = wp.where(margin > 0.0, margin + finest, margin)
        trial = float(room)
        while trial >= least:  # with room for the motion, and if that is too much, without
            touches = inner_boxes_touch(program, couple, swept.poses, trial)
            if not touches:
                touches = leaves_touch(program, couple, swept.poses, trial)
            near = near or touches
            following.blocked = touches and trial == least
            trial = wp.where(touches and trial > least, least, least - 1.0)
    else:
        step = next_step(program, couple, swept.poses, room)
        following.leaf = step.leaf
        following.split = step.inner
        following.left = wp.vec4i(step.left[0], step.left[1], step.left[2], entry[3])
        following.right = wp.vec4i(step.right[0], step.right[1], step.right[2], entry[3])
        # time is halved first, as long as the motion exceeds the boxes
        extent = wp.max(wp.max(program.node_half[entry[1]]), wp.max(program.node_half[entry[2]]))
        near = step.inner and swept.motion > extent
    if near and swept.motion > finest and (entry[3] >> _LEVEL_BITS) & 31 == _DEEPEST:
        following.blocked = True
    elif near and swept.motion > finest:
        later = entry[3] + (1 << _LEVEL_BITS) + (entry[3] & 0xFFFF)
        following.split = True
        following.left = wp.vec4i(entry[0], entry[1], entry[2], later)
        following.right = wp.vec4i(entry[0], entry[1], entry[2], later + 1)
    return following


@wp.func
def sweep_touches(
    program: Program,
    reach: Reach,
    layouts: LayoutsView,
    reach_search: ReachSearch,
    nodes: Any,
    leaves: Any,
    c: int,
    block: int,
    first: int,
    pieces: int,
    lane: int,
) -> bool:
    """Test whether the robot touches itself, the layout or its target on some pieces of a candidate's path.

    All lanes of a block call this function together. The stacks are empty at the start and at the end. On the piece
    APPROACH, the hand may touch the target.
    """
    column = reach_search.column[reach_search.row[c]]
    pairs = reach.arm_broadnum[reach.arm_self[column]] + reach.arm_broadnum[reach.arm_scene[column]]
    if first != wp.static(APPROACH):
        pairs += reach.arm_broadnum[reach.arm_target[column]]
    turn = int(0)
    base = int(0)  # number of pairs and pieces that have begun in this turn
    while turn <= _SAMPLES:
        narrow = bool(False)
        taken = bool(False)
        entry = wp.vec4i(0, 0, 0, 0)
        if wp.tile_stack_count(leaves) >= wp.block_dim() or (
            wp.tile_stack_count(nodes) == 0 and base >= pieces * pairs
        ):
            narrow = True
            popped, slot = wp.tile_stack_pop(leaves)
            taken = slot >= 0
            entry = popped
        elif wp.tile_stack_count(nodes) > 0:
            popped, slot = wp.tile_stack_pop(nodes)
            taken = slot >= 0
            entry = popped
        else:
            taken = base + lane < pieces * pairs
            if taken:
                entry = _root(program, reach, column, turn, first + (base + lane) // pairs, (base + lane) % pairs)
            base += wp.block_dim()
        following = Next()  # pyrefly: ignore[missing-argument]
        if taken:
            following = _test(program, reach, layouts, reach_search, c, block, column, entry, narrow)
        at_left = wp.tile_stack_push(nodes, following.left, following.split)
        at_right = wp.tile_stack_push(nodes, following.right, following.split)
        at_leaf = wp.tile_stack_push(leaves, entry, following.leaf)
        if (following.split and wp.min(at_left, at_right) < 0) or (following.leaf and at_leaf < 0):
            following.blocked = True
        if block_any(int(following.blocked)) != 0:
            wp.tile_stack_clear(nodes)
            wp.tile_stack_clear(leaves)
            return True
        if narrow and base >= pieces * pairs and wp.tile_stack_count(nodes) + wp.tile_stack_count(leaves) == 0:
            turn += 1
            base = 0
    return False
