"""Paths to a grasp, for the tier `path`: polylines in joint space without collisions, of the robot with itself too.

A path leads from the drawn start pose over at most two vias to the pre-grasp, and on to the grasp. First the straight
path is tried, then paths over a via behind the pre-grasp, then paths over drawn vias. Before the pre-grasp, drawn vias
lead to it, to a free via behind it, or to another drawn via. The first free path counts, so the result does not depend
on how many rows are tried in parallel.

A piece of a path is proven by halving. If all distances in the middle of an interval exceed the robot's motion from
there to the ends, the interval is free. Otherwise, its two halves are tested. An interval is not halved if all points
move by at most twice the margin: if a distance in its middle is below the margin, the path is not free.
"""

import warp as wp

from sceniris_gym.collide.boxes import OWN_STACK, leaves_below_touch
from sceniris_gym.collide.leaves import margin_of, pair_poses
from sceniris_gym.config.tier import Tier
from sceniris_gym.device.blocks import block_any, block_sync
from sceniris_gym.device.random import PATH_STREAM, uniforms
from sceniris_gym.device.transforms import z_axis
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.ik import nearest_turns
from sceniris_gym.layout.reaching.poses import in_base, open_gripper, pose_arm, take_joints
from sceniris_gym.layout.reaching.search import PREGRASP_DISTANCE, ReachSearch, ReachStep, pose_index
from sceniris_gym.layout.wave.search import Search, Workspace, numbered_stream
from sceniris_gym.placement.grasps import tcp_of
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.reach.solve import ITERATIONS, accepted, refine, vec8

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

PATHS = 128
"""Number of paths that are tried for a grasp."""
RETREATS = 3
"""Number of paths over a via behind the pre-grasp, after the straight path. Each via is 0.1 m further back."""
MOST_TRIED = 8
"""Maximum number of grasps with joints to search paths for, per object and restart."""
HAND_MARGIN = 0.0005
"""Least distance [m] of the hand from the layout, except for the target, on the way from the pre-grasp to the grasp."""

_RETREAT = wp.constant(0.1)
# First, 2^3 poses of a piece are tested, because most pieces that are not free fail there.
_COARSE = wp.constant(3)
_DEEPEST = wp.constant(16)
_mat58 = wp.types.matrix(shape=(5, MAX_JOINTS), dtype=float)
# Drawn vias spread by this about the straight path: hinges [rad], slides [m].
_SPREAD = wp.constant(0.6)
_SLIDE_SPREAD = wp.constant(0.2)


@wp.func
def _motion(reach: Reach, change: vec8, a: int, b: int) -> float:
    """Return an upper bound of how far [m] points of two bodies move relative to each other.

    `change` has the changes of the arm's joints. Only joints count that move one of the two bodies, and not the other.
    """
    moved = float(0.0)
    for j in range(MAX_JOINTS):
        if j < reach.arm.njoint:
            of_a = reach.arm_moves[a, j]
            of_b = reach.arm_moves[b, j]
            if (of_a > 0.0) != (of_b > 0.0):
                moved += wp.abs(change[j]) * (of_a + of_b)
    return moved


@wp.func
def _longest(reach: Reach, change: vec8) -> float:
    """Return an upper bound of how far [m] any point of the robot moves."""
    moved = float(0.0)
    for j in range(MAX_JOINTS):
        if j < reach.arm.njoint:
            moved += wp.abs(change[j]) * reach.arm_longest[j]
    return moved


@wp.func
def _touches(
    program: Program,
    reach: Reach,
    layouts: LayoutsView,
    reach_search: ReachSearch,
    c: int,
    joints: vec8,
    moved: vec8,
    hand_margin: float,
    lists: int,
    lane: int,
) -> bool:
    """Test the robot of a candidate at some joints, with the margins of its target and for motions of up to `moved`.

    The first `lists` of three lists of pairs are tested: the robot with itself, with the layout, and with its target.
    All lanes of a block call this function together. Pairs that touch in the model's start pose get no margins.
    """
    row = reach_search.row[c]
    column = reach_search.column[row]
    at = pose_index(reach_search, c, 1)
    own_pos = reach_search.body_pos[at]
    own_quat = reach_search.body_quat[at]
    pos = layouts.body_pos[row]
    quat = layouts.body_quat[row]
    wrist = reach.arm.njoint - 1
    block_sync()
    if lane == 0:
        pose_arm(program, reach, layouts, row, joints, reach_search.qpos[at], own_pos, own_quat)
    block_sync()
    hit = int(0)
    stack = wp.zeros(shape=(wp.static(OWN_STACK),), dtype=wp.vec3i)
    for part in range(lists):
        pairs = reach.arm_self[column]
        if part == 1:
            pairs = reach.arm_scene[column]
        elif part == 2:
            pairs = reach.arm_target[column]
        last = reach.arm_broadadr[pairs] + reach.arm_broadnum[pairs]
        for i in range(reach.arm_broadadr[pairs] + lane, last, wp.block_dim()):
            if hit == 0:
                entry = program.broad_pair[i]
                bodies = program.pair_bodies[entry[0]]
                margin = margin_of(program, 0, entry[0], -1)
                if margin > 0.0:
                    is_hand = reach.arm_moves[bodies[0], wrist] + reach.arm_moves[bodies[1], wrist] > 0.0
                    least = wp.where(is_hand, hand_margin, reach.reach_margin[column])
                    margin += wp.max(least, _motion(reach, moved, bodies[0], bodies[1]))
                poses = pair_poses(program, entry[0], own_pos, own_quat, pos, quat)
                if leaves_below_touch(program, entry, poses, margin, stack):
                    hit = 1
        hit = block_any(hit)
    return hit != 0


@wp.func
def _coarse_share(number: int) -> float:
    """Return the share of a piece for its first tests: 1, 1/2, 1/4, 3/4, 1/8, and so on."""
    share = float(0.0)
    digit = float(0.5)
    for bit in range(_COARSE):
        if (number >> bit) % 2 == 1:
            share += digit
        digit *= 0.5
    return wp.where(number == 0, 1.0, share)


@wp.func
def _is_free(
    program: Program,
    reach: Reach,
    layouts: LayoutsView,
    reach_search: ReachSearch,
    c: int,
    corners: _mat58,
    pieces: int,
    hand_margin: float,
    lists: int,
    lane: int,
) -> bool:
    """Prove that the first pieces of a polyline are free. Return False if one is not, or has too little margin."""
    proving = bool(False)  # after the coarse tests of all pieces
    piece = int(0)
    level = int(0)
    number = int(0)
    while piece < pieces:
        change = corners[piece + 1] - corners[piece]
        width = 1.0 / float(1 << level)
        share = (float(number) + 0.5) * width
        half = 0.5 * width
        if not proving:
            share = _coarse_share(number)
            half = 0.0
        joints = corners[piece] + share * change
        if _touches(program, reach, layouts, reach_search, c, joints, half * change, hand_margin, lists, lane):
            least = wp.min(hand_margin, reach.reach_margin[reach_search.column[reach_search.row[c]]])
            if not proving or half * _longest(reach, change) <= least or level == _DEEPEST:
                return False
            level += 1
            number *= 2
        elif proving:
            while level > 0 and number % 2 == 1:
                level -= 1
                number = number // 2
            number += 1
            if level == 0:
                number = 0
                piece += 1
        else:
            piece += 1
            if piece == pieces:
                piece = 0
                number += 1
            if number == 1 << _COARSE:
                number = 0
                proving = True
    return True


@wp.func
def _drawn_via(reach: Reach, seed: wp.uint64, episode: int, stream: wp.uint32, trial: int, k: int, a: vec8, b: vec8):
    """Draw a via about the piece from `a` to `b`. A sum of four uniform numbers is nearly normally distributed."""
    first = (MAX_JOINTS + 1) * k
    share = uniforms(seed, episode, stream, trial, first)[0]
    via = vec8()
    for j in range(MAX_JOINTS):
        if j < reach.arm.njoint:
            u = uniforms(seed, episode, stream, trial, first + 1 + j)
            spread = wp.where(reach.arm.slide[j] != 0, _SLIDE_SPREAD, _SPREAD)
            normal = 1.7320508 * (u[0] + u[1] + u[2] + u[3] - 2.0)
            via[j] = wp.clamp(a[j] + share * (b[j] - a[j]) + spread * normal, reach.arm.lower[j], reach.arm.upper[j])
    return via


@wp.func
def _find_path(
    program: Program,
    reach: Reach,
    split: wp.uint32,
    layouts: LayoutsView,
    search: Search,
    reach_search: ReachSearch,
    c: int,
    lane: int,
) -> bool:
    """Find the first free path to the grasp of a candidate, and write its corners. Freely turning joints turn least."""
    row = reach_search.row[c]
    column = reach_search.column[row]
    grasp = reach_search.grasp[c]
    start = vec8()
    for j in range(MAX_JOINTS):
        if j < reach.arm.njoint:
            start[j] = layouts.qpos[row, reach.arm_qposadr[j]]
    pregrasp, _near = nearest_turns(reach.arm, start, reach_search.pregrasp_qpos[c])
    there, _near = nearest_turns(reach.arm, pregrasp, reach_search.grasp_qpos[c])
    at = pose_index(reach_search, c, 1)
    if lane == 0:
        take_joints(program, reach.arm_body, layouts.qpos[row], reach_search.qpos[at])
        open_gripper(reach, grasp, reach_search.qpos[at])
    pos, quat = tcp_of(reach, grasp, layouts.body_pos[row], layouts.body_quat[row])
    pos, quat = in_base(reach, layouts, row, pos, quat)
    worldid = search.row_world[row]
    seed = layouts.pending_seed[worldid]
    episode = layouts.pending_episode[worldid]
    stream = numbered_stream(split, wp.static(PATH_STREAM))
    trial = search.row_restart[row] * layouts.grasp.shape[1] + column
    retreat = pregrasp
    ends = _mat58()  # the pre-grasp, and vias behind it from which the way to it is free
    ends[0] = pregrasp
    nend = int(1)
    for k in range(-1, wp.static(PATHS)):
        via = pregrasp
        end = pregrasp  # the second via
        pieces = int(1)  # that are not proven yet
        if k > 0 and k <= wp.static(RETREATS):
            back = wp.static(PREGRASP_DISTANCE) + float(k) * _RETREAT
            found = refine(reach.arm, pos - back * z_axis(quat), quat, retreat, wp.static(ITERATIONS))
            if not accepted(found):
                continue
            retreat, _near = nearest_turns(reach.arm, retreat, found.q)
            via = retreat
            ends[nend] = retreat
            back_on = _mat58()
            back_on[0] = retreat
            back_on[1] = pregrasp
            if not _is_free(program, reach, layouts, reach_search, c, back_on, 1, reach.reach_margin[column], 3, lane):
                continue
            nend += 1
        elif k > wp.static(RETREATS):
            end = ends[k % nend]
            pieces = 2
            if (k // nend) % 2 == 1:
                pieces = 3
                end = _drawn_via(reach, seed, episode, stream, trial, wp.static(PATHS) + k, start, end)
            via = _drawn_via(reach, seed, episode, stream, trial, k, start, end)
        corners = _mat58()
        corners[0] = wp.where(k < 0, pregrasp, start)
        corners[1] = wp.where(k < 0, there, via)
        corners[2] = end
        corners[3] = pregrasp
        hand_margin = wp.where(k < 0, wp.static(HAND_MARGIN), reach.reach_margin[column])
        lists = wp.where(k < 0, 2, 3)
        free = _is_free(program, reach, layouts, reach_search, c, corners, pieces, hand_margin, lists, lane)
        if k < 0 and not free:
            return False  # all paths end with this piece
        if k >= 0 and free:
            if lane == 0:
                reach_search.path[c, 0] = start
                reach_search.path[c, 1] = via
                reach_search.path[c, 2] = end
                reach_search.pregrasp_qpos[c] = pregrasp
                reach_search.grasp_qpos[c] = there
            return True
    return False


@wp.kernel(grid_stride=False)
def _test_paths(
    blocks: int,
    program: Program,
    reach: Reach,
    split: wp.uint32,
    # Layouts in: qpos, pending*, bodies*
    layouts: LayoutsView,
    # Search in: restarts*
    search: Search,
    # ReachSearch in: column, tier, first, trials, queue, source, rows, row, grasp; out: path; both: paths, failed,
    #   grasp_qpos, pregrasp_qpos, qpos, body_pos, body_quat
    reach_search: ReachSearch,
):
    block, lane = wp.tid()
    for i in range(block, reach_search.rows[0], blocks):
        row = reach_search.queue[reach_search.source[0], i]
        if reach_search.tier[row, reach_search.column[row]] == wp.static(int(Tier.PATH)):
            c = int(reach_search.first[row])
            last = c + reach_search.trials[row]
            while c < last:
                failed = reach_search.failed[c]
                if failed == ReachStep.DEFERRED:
                    c = last
                elif failed == ReachStep.PASSED:
                    free = bool(False)
                    if reach_search.paths[row] < wp.static(MOST_TRIED):
                        free = _find_path(program, reach, split, layouts, search, reach_search, c, lane)
                    block_sync()
                    if free:
                        c = last
                    elif lane == 0:
                        reach_search.failed[c] = ReachStep.PATH
                        reach_search.paths[row] += 1
                    block_sync()
                c += 1


def launch_test_paths(work: Workspace, reach: Reach, reach_search: ReachSearch) -> None:
    """Find a path for the first candidate of each row that has passed all other steps. Candidates without one fail."""
    state = work.layouts, work.search, reach_search
    work.launch_blocks(_test_paths, work.program, reach, work.split, *state)
