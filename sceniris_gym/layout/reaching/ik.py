"""Inverse kinematics of candidates, a lane for each: from its start to the grasp, and from there to the pre-grasp."""

import warp as wp

from sceniris_gym.device.quaternions import mul_quat, neg_quat, rot_vec_quat, z_axis
from sceniris_gym.device.random import REACH_STREAM, STREAM_BITS, uniforms
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.search import (
    PREGRASP_DISTANCE,
    STARTS,
    ReachSearch,
    Step,
    first_start,
    reach_candidate_num,
    takes_step,
)
from sceniris_gym.layout.wave.search import Search
from sceniris_gym.placement.grasps import tcp_of
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.reach.lookup import witness
from sceniris_gym.reach.solve import ITERATIONS, ArmView, accepted, refine, turns_freely, vec8

wp.set_module_options({"enable_backward": False})

SAME_BRANCH = 0.8
"""A joint [rad or m] that turns further between pre-grasp and grasp may have passed to another branch of solutions."""
WITNESSES = 4
"""How many starts of a grasp are witnesses of the arm's map, if it has one. They follow the pose that the arm has."""

_REACH_STREAM = wp.constant(wp.uint32(REACH_STREAM))
_STREAM_BITS = wp.constant(wp.uint32(STREAM_BITS))
_PI = wp.constant(wp.pi)


@wp.func
def _target(reach: Reach, layouts: LayoutsView, worldid: int, grasp: int):
    """Position and orientation of the TCP in a grasp, in the frame of the arm's base."""
    at, turn = tcp_of(reach, grasp, layouts.body_pos[worldid], layouts.body_quat[worldid])
    back = neg_quat(layouts.body_quat[worldid, reach.base_body])
    pos = rot_vec_quat(at - layouts.body_pos[worldid, reach.base_body], back)
    return pos, wp.normalize(mul_quat(back, turn))


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
def _same_branch(arm: ArmView, there: vec8, before: vec8):
    """Joints of a pre-grasp with all turns as near as they can be to those of the grasp; and whether all are near."""
    near = bool(True)
    q = before
    for i in range(MAX_JOINTS):
        if i < arm.njoint:
            change = before[i] - there[i]
            if turns_freely(arm, i):
                change -= 2.0 * _PI * wp.round(change / (2.0 * _PI))
                q[i] = there[i] + change
            if wp.abs(change) > wp.static(SAME_BRANCH):
                near = False
    return q, near


@wp.kernel(grid_stride=False)
def _start(
    reach: Reach,
    split: wp.uint32,
    lanes: int,
    layouts: LayoutsView,
    search: Search,
    # Search in and out:
    reach_search: ReachSearch,
):
    for c in range(wp.tid(), reach_candidate_num(reach_search), lanes):
        of_grasp = first_start(reach_search, c)
        if of_grasp >= 0:
            if reach_search.failed[of_grasp] < Step.IK_AT_GRASP:
                reach_search.failed[c] = reach_search.failed[of_grasp]
        if not takes_step(reach, reach_search, c, Step.IK_AT_GRASP):
            continue
        worldid = reach_search.world[c]
        column = reach_search.column[worldid]
        grasp = reach_search.grasp[c]
        start = reach_search.start[c]
        q = vec8()
        if start == 0:
            for i in range(MAX_JOINTS):
                if i < reach.arm.njoint:
                    q[i] = layouts.qpos[worldid, reach.arm_qposadr[i]]
        elif reach.mapped != 0 and start <= wp.static(WITNESSES):
            pos, quat = _target(reach, layouts, worldid, grasp)
            q = witness(reach.map, pos, quat, start - 1)
        else:
            stream = (split << _STREAM_BITS) + _REACH_STREAM
            trial = (search.restart[worldid] - 1) * layouts.grasp.shape[1] + column
            draw = (grasp - reach.reach_graspadr[column]) * wp.static(STARTS) + start
            q = _drawn(reach.arm, layouts.seed[worldid], layouts.pending_episode[worldid], stream, trial, draw)
        reach_search.grasp_qpos[c] = q


@wp.kernel(grid_stride=False)
def _solve(
    reach: Reach,
    step: int,
    lanes: int,
    layouts: LayoutsView,
    # Search in and out:
    reach_search: ReachSearch,
):
    for c in range(wp.tid(), reach_candidate_num(reach_search), lanes):
        if not takes_step(reach, reach_search, c, step):
            continue
        pos, quat = _target(reach, layouts, reach_search.world[c], reach_search.grasp[c])
        if step == Step.IK_AT_PREGRASP:
            pos = pos - wp.static(PREGRASP_DISTANCE) * z_axis(quat)
        found = refine(reach.arm, pos, quat, reach_search.grasp_qpos[c], wp.static(ITERATIONS))
        passed = accepted(found)
        if step == Step.IK_AT_PREGRASP:
            q, near = _same_branch(reach.arm, reach_search.grasp_qpos[c], found.q)
            reach_search.pregrasp_qpos[c] = q
            passed = passed and near
        else:
            reach_search.grasp_qpos[c] = found.q
        if not passed:
            reach_search.failed[c] = step


def launch_ik(
    reach: Reach,
    split: int,
    clear: bool,
    lanes: int,
    layouts: LayoutsView,
    search: Search,
    reach_search: ReachSearch,
    device: str,
) -> None:
    """Look for joints of the candidates' grasps, and for those of the tier `clear` in their pre-grasps."""
    inputs = [reach, split, lanes, layouts, search]
    wp.launch(_start, dim=lanes, inputs=inputs, outputs=[reach_search], device=device)
    for step in (Step.IK_AT_GRASP, Step.IK_AT_PREGRASP) if clear else (Step.IK_AT_GRASP,):
        inputs = [reach, int(step), lanes, layouts]
        wp.launch(_solve, dim=lanes, inputs=inputs, outputs=[reach_search], device=device)
