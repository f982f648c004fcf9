"""The stages `ik` and `clear` of a reset: after placing, joints of the arm for a grasp of every object asked for.

One thread block per world. Each lane takes a (grasp, start) of its own through inverse kinematics; what it finds is
tested against the robot itself and the finished layout by all lanes together, the lowest (grasp, start) first, so that
the accepted one does not depend on how many lanes there are. A world without any goes on with its next restart, or, out
of them, with its entry of the bank. No path from the start pose is looked for.
"""

from typing import Any

import warp as wp

from sceniris_gym.layout.bank import fall_back
from sceniris_gym.layout.blocks import block_sync
from sceniris_gym.layout.boxes import SHARED_STACK, WAITING, collides
from sceniris_gym.layout.containment import encloses
from sceniris_gym.layout.grasps import passes_map
from sceniris_gym.layout.kinematics import follow_joint, pose_body
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.random import REACH_STREAM, STREAM_BITS, uniforms
from sceniris_gym.layout.search import Search
from sceniris_gym.layout.transforms import Pose, pose_of
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.reach.lookup import witness
from sceniris_gym.reach.quaternions import mul_quat, neg_quat, rot_vec_quat, z_axis
from sceniris_gym.reach.solve import ITERATIONS, ArmView, accepted, refine, turns_freely, vec8
from sceniris_gym.reach.tier import Tier

wp.set_module_options({"enable_backward": False})

PREGRASP_DISTANCE = 0.08
"""How far [m] a pre-grasp is back along the approach."""
OPENING_MARGIN = 0.01
"""Gap [m] that the gripper is opened by beyond what the grasp needs, as far as it goes."""
SAME_BRANCH = 0.8
"""A joint [rad or m] that turns further between pre-grasp and grasp may have passed to another branch of solutions."""
STARTS = 8
"""Starts of the inverse kinematics for each grasp: the pose that the arm has, witnesses of its map, and random ones."""
WITNESSES = 4
"""How many of them are witnesses, where there is a map."""

_IK = wp.constant(int(Tier.IK))
_CLEAR = wp.constant(int(Tier.CLEAR))
_NONE = wp.constant(int(Cause.NONE))
_NO_IK = wp.constant(int(Cause.NO_IK))
_BLOCKED = wp.constant(int(Cause.BLOCKED))
_REACH_STREAM = wp.constant(wp.uint32(REACH_STREAM))
_STREAM_BITS = wp.constant(wp.uint32(STREAM_BITS))
_NO_CANDIDATE = wp.constant(1 << 30)
_PI = wp.constant(wp.pi)


@wp.struct
class Reached:
    """Joints of a grasp and of its pre-grasp."""

    ok: bool
    grasp: vec8
    pregrasp: vec8


@wp.func
def _base(reach: Reach, layouts: LayoutsView, worldid: int) -> Pose:
    """The pose of the arm's base."""
    return pose_of(layouts.body_pos[worldid, reach.base_body], layouts.body_quat[worldid, reach.base_body])


@wp.func
def _drawn(arm: ArmView, seed: wp.uint64, episode: int, stream: wp.uint32, trial: int, draw: int) -> vec8:
    """Joints drawn uniformly within limits, or from -pi to pi where there are none."""
    low = uniforms(seed, episode, stream, trial, 2 * draw)
    high = uniforms(seed, episode, stream, trial, 2 * draw + 1)
    q = vec8()
    for i in range(MAX_JOINTS):
        if i < arm.njoint:
            u = low
            if i > 3:
                u = high
            if turns_freely(arm, i):
                q[i] = _PI * (2.0 * u[i % 4] - 1.0)
            else:
                q[i] = arm.lower[i] + u[i % 4] * (arm.upper[i] - arm.lower[i])
    return q


@wp.func
def _tcp(reach: Reach, layouts: LayoutsView, worldid: int, grasp: int):
    """Position and orientation of the TCP in the world when it stands at a grasp."""
    body = reach.grasp_body[grasp]
    quat = layouts.body_quat[worldid, body]
    pos = layouts.body_pos[worldid, body] + rot_vec_quat(reach.grasp_pos[grasp], quat)
    return pos, mul_quat(quat, reach.grasp_quat[grasp])


@wp.func
def _try(
    reach: Reach, layouts: LayoutsView, worldid: int, column: int, grasp: int, start: int, stream: wp.uint32, trial: int
) -> Reached:
    """One lane's work: joints for one grasp from one start, and for its pre-grasp from those."""
    at, turn = _tcp(reach, layouts, worldid, grasp)
    back = neg_quat(layouts.body_quat[worldid, reach.base_body])
    pos = rot_vec_quat(at - layouts.body_pos[worldid, reach.base_body], back)
    quat = wp.normalize(mul_quat(back, turn))

    q = vec8()
    if start == 0:
        for i in range(MAX_JOINTS):
            if i < reach.arm.njoint:
                q[i] = layouts.qpos[worldid, reach.arm_qposadr[i]]
    elif reach.mapped != 0 and start <= WITNESSES:
        q = witness(reach.map, pos, quat, start - 1)
    else:
        draw = (grasp - reach.reach_graspadr[column]) * STARTS + start
        q = _drawn(reach.arm, layouts.seed[worldid], layouts.episode[worldid], stream, trial, draw)

    found = Reached()
    there = refine(reach.arm, pos, quat, q, ITERATIONS)
    found.grasp = there.q
    found.ok = accepted(there)
    if found.ok and reach.reach_tier[column] == _CLEAR:
        before = refine(reach.arm, pos - PREGRASP_DISTANCE * z_axis(quat), quat, there.q, ITERATIONS)
        found.pregrasp = before.q
        found.ok = accepted(before)
        for i in range(MAX_JOINTS):
            if i < reach.arm.njoint:
                change = before.q[i] - there.q[i]
                if turns_freely(reach.arm, i):
                    change -= 2.0 * _PI * wp.round(change / (2.0 * _PI))
                    found.pregrasp[i] = there.q[i] + change
                if wp.abs(change) > SAME_BRANCH:
                    found.ok = False
    return found


@wp.func
def _open_gripper(reach: Reach, layouts: LayoutsView, worldid: int, grasp: int):
    """Open the gripper to the gap [m] that a grasp needs and the margin. One lane's work."""
    qpos = layouts.arm_qpos[worldid]
    gap = wp.min(reach.grasp_opening[grasp] + OPENING_MARGIN, reach.gap_open)
    share = (gap - reach.gap_closed) / wp.max(reach.gap_open - reach.gap_closed, 1.0e-6)
    for i in range(reach.grip_qposadr.shape[0]):
        joint = reach.grip_closed[i] + wp.clamp(share, 0.0, 1.0) * (reach.grip_open[i] - reach.grip_closed[i])
        qpos[reach.grip_qposadr[i]] = joint
    for i in range(reach.grip_followadr.shape[0]):
        follow_joint(reach.grip_driveradr, reach.grip_followadr, reach.grip_coef, i, qpos)


@wp.func
def _pose_hand(program: Program, reach: Reach, layouts: LayoutsView, worldid: int, grasp: int, back: float):
    """Pose what the arm's last joint carries at a grasp, or [m] back along its approach. One lane's work."""
    pos, quat = _tcp(reach, layouts, worldid, grasp)
    _open_gripper(reach, layouts, worldid, grasp)
    root = reach.hand_body[0]
    layouts.arm_pos[worldid, root] = pos - back * z_axis(quat) + rot_vec_quat(reach.hand_pos, quat)
    layouts.arm_quat[worldid, root] = wp.normalize(mul_quat(quat, reach.hand_quat))
    for i in range(1, reach.hand_body.shape[0]):
        body = reach.hand_body[i]
        pose_body(program, body, layouts.arm_qpos[worldid], layouts.arm_pos[worldid], layouts.arm_quat[worldid])


@wp.func
def _pose_arm(program: Program, reach: Reach, layouts: LayoutsView, worldid: int, q: vec8, grasp: int):
    """Pose the robot, its gripper opened for a grasp. One lane's work."""
    qpos = layouts.arm_qpos[worldid]
    for i in range(MAX_JOINTS):
        if i < reach.arm.njoint:
            qpos[reach.arm_qposadr[i]] = q[i]
    _open_gripper(reach, layouts, worldid, grasp)
    for i in range(reach.arm_body.shape[0]):
        pose_body(program, reach.arm_body[i], qpos, layouts.arm_pos[worldid], layouts.arm_quat[worldid])


@wp.func
def _keep(layouts: LayoutsView, worldid: int, column: int, grasp: int, njoint: int, found: Reached, clear: bool):
    """Write an accepted grasp; -1 and no joints for an object that is not there. One lane's work."""
    layouts.grasp[worldid, column] = grasp
    for i in range(MAX_JOINTS):
        layouts.grasp_qpos[worldid, column, i] = wp.where(i < njoint, found.grasp[i], wp.nan)
        layouts.pregrasp_qpos[worldid, column, i] = wp.where(i < njoint and clear, found.pregrasp[i], wp.nan)


@wp.func
def _hits(program: Program, layouts: LayoutsView, nodes: Any, leaves: Any, worldid: int, lane: int, pairs: int) -> bool:
    """Whether the posed arm hits anything of a list of pairs."""
    startadr = program.arm_startadr[pairs]
    startnum = program.arm_startnum[pairs]
    pos = layouts.arm_pos[worldid]
    quat = layouts.arm_quat[worldid]
    if collides(program, startadr, startnum, -1, nodes, leaves, lane, pos, quat, pos, quat):
        return True
    if program.faces == 0:
        return False
    return encloses(program, program.arm_pairadr[pairs], program.arm_pairnum[pairs], lane, pos, quat, pos, quat)


@wp.func
def _hand_is_clear(
    program: Program,
    reach: Reach,
    layouts: LayoutsView,
    nodes: Any,
    leaves: Any,
    worldid: int,
    lane: int,
    column: int,
    grasp: int,
) -> bool:
    """Whether the map lets a grasp through and the hand alone is clear of the layout in it and its pre-grasp.

    It stands there whatever the arm's joints are, so all starts of a grasp are spared at once. The object itself it
    may touch in the grasp alone.
    """
    clear = passes_map(
        reach, column, grasp, _base(reach, layouts, worldid), layouts.body_pos[worldid], layouts.body_quat[worldid]
    )
    step = int(0)
    while step < 3 and clear:
        if lane == 0 and step < 2:
            _pose_hand(program, reach, layouts, worldid, grasp, float(step) * PREGRASP_DISTANCE)
        block_sync()
        pairs = wp.where(step < 2, program.arm_hand[column], program.arm_target[column])
        clear = not _hits(program, layouts, nodes, leaves, worldid, lane, pairs)
        step += 1
    return clear


@wp.func
def _reach_object(
    program: Program,
    reach: Reach,
    layouts: LayoutsView,
    nodes: Any,
    leaves: Any,
    worldid: int,
    lane: int,
    column: int,
    stream: wp.uint32,
    trial: int,
) -> int:
    """Find and keep the first grasp and start that pass. Returns why there is none, or NONE."""
    body_pos = layouts.body_pos[worldid]
    body_quat = layouts.body_quat[worldid]
    variant = layouts.variant[worldid, column]
    # placing has found that the map lets none through before this one
    first = reach.reach_graspadr[column] + layouts.grasp[worldid, column]
    number = (reach.variant_graspadr[variant] + reach.variant_graspnum[variant] - first) * STARTS
    clear = reach.reach_tier[column] == _CLEAR
    # against itself in the grasp; then against the layout, both in the pre-grasp, and there the hand and the object
    tests = wp.where(clear, 5, 1)
    tried = bool(False)  # whether this lane's grasp goes through inverse kinematics
    looked = first - 1  # the last grasp for which that is known
    blocked = clear  # whether the hand hits something in all of these
    cause = int(_NO_IK)
    base = int(0)
    while base < number and cause != _NONE:
        mine = int(_NO_CANDIDATE)
        grasp = first + (base + lane) // STARTS
        found = Reached()
        last = first + (wp.min(base + wp.block_dim(), number) - 1) // STARTS
        if clear:
            while looked < last:
                looked += 1
                through = _hand_is_clear(program, reach, layouts, nodes, leaves, worldid, lane, column, looked)
                blocked = blocked and not through
                if looked == grasp:
                    tried = through
        else:
            tried = passes_map(reach, column, wp.min(grasp, last), _base(reach, layouts, worldid), body_pos, body_quat)
        if base + lane < number and tried:
            found = _try(reach, layouts, worldid, column, grasp, (base + lane) % STARTS, stream, trial)
            if found.ok:
                mine = base + lane
        least = wp.tile_extract(wp.tile_min(wp.tile(mine)), 0)
        while least < _NO_CANDIDATE and cause != _NONE:
            k = int(0)
            hit = bool(False)
            while k < tests and not hit:
                if k == 0 or k == 2:
                    if mine == least:
                        q = found.grasp
                        if k > 0:
                            q = found.pregrasp
                        _pose_arm(program, reach, layouts, worldid, q, grasp)
                    block_sync()
                pairs = int(program.arm_self[column])
                if k == 4:
                    pairs = program.arm_target[column]
                elif k % 2 == 1:
                    pairs = program.arm_scene[column]
                hit = _hits(program, layouts, nodes, leaves, worldid, lane, pairs)
                k += 1
                if k == 1 and not hit:
                    cause = _BLOCKED
            if hit:
                if mine == least:
                    mine = _NO_CANDIDATE
                least = wp.tile_extract(wp.tile_min(wp.tile(mine)), 0)
            else:
                cause = _NONE
                if mine == least:
                    name = grasp - reach.reach_graspadr[column]
                    _keep(layouts, worldid, column, name, reach.arm.njoint, found, clear)
        base += wp.block_dim()
    if blocked:
        cause = _BLOCKED
    return cause


@wp.kernel(grid_stride=False)
def _reachability(
    program: Program,
    reach: Reach,
    split: wp.uint32,
    # Layouts in and out:
    layouts: LayoutsView,
    # Search in and out:
    search: Search,
):
    worldid, lane = wp.tid()
    if not search.waiting[worldid]:
        return
    restart = search.restart[worldid]
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec3i)
    leaves = wp.tile_stack(capacity=wp.static(WAITING), dtype=wp.vec3i)
    for i in range(lane, layouts.arm_qpos.shape[1], wp.block_dim()):
        layouts.arm_qpos[worldid, i] = layouts.qpos[worldid, i]
    for i in range(lane, layouts.arm_pos.shape[1], wp.block_dim()):
        layouts.arm_pos[worldid, i] = layouts.body_pos[worldid, i]
        layouts.arm_quat[worldid, i] = layouts.body_quat[worldid, i]
    block_sync()
    stream = (split << _STREAM_BITS) + _REACH_STREAM
    columns = layouts.grasp.shape[1]
    cause = int(_NONE)
    column = int(0)
    while column < columns and cause == _NONE:
        if layouts.present[worldid, reach.reach_slot[column]] == 0:
            if lane == 0:
                _keep(layouts, worldid, column, -1, 0, Reached(), False)
        elif reach.reach_tier[column] >= _IK:
            trial = (restart - 1) * columns + column
            cause = _reach_object(program, reach, layouts, nodes, leaves, worldid, lane, column, stream, trial)
        column += 1
    block_sync()
    if lane == 0:
        if cause == _NONE:
            search.waiting[worldid] = False
        else:
            wp.atomic_add(layouts.rejections, reach.reach_obj[column - 1], cause, 1)
            layouts.first_pass_valid[worldid] = 0
            if restart > program.restarts:
                layouts.status[worldid] = fall_back(program, reach, layouts, worldid, split)
                search.waiting[worldid] = False


def launch_reachability(
    program: Program, reach: Reach, split: int, block_dim: int, layouts: LayoutsView, search: Search, device: str
) -> None:
    """Find joints for the grasps of all worlds that wait for them."""
    wp.launch_tiled(
        _reachability,
        dim=[search.waiting.shape[0]],
        inputs=[program, reach, split, layouts, search],
        block_dim=block_dim,
        device=device,
    )
