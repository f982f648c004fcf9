"""Inverse kinematics, one lane per candidate: from initial joints to the grasp, and from there to the pre-grasp."""

import warp as wp

from sceniris_gym.device.random import REACH_STREAM, uniforms
from sceniris_gym.device.transforms import z_axis
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.poses import in_base
from sceniris_gym.layout.reaching.search import (
    PREGRASP_DISTANCE,
    STARTS,
    ReachSearch,
    ReachStep,
    candidate_num,
    takes_step,
)
from sceniris_gym.layout.wave.search import Search, Workspace, numbered_stream
from sceniris_gym.placement.grasps import tcp_of
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.reach.lookup import witness
from sceniris_gym.reach.solve import ITERATIONS, ArmView, accepted, refine, turns_freely, vec8

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

SAME_BRANCH = 0.8
"""Largest allowed change of a joint [rad or m] from pre-grasp to grasp. A larger change may mean another IK branch."""
WITNESSES = 4
"""Number of starts from witnesses (joints in the arm's map), if it has a map. They follow the arm's present pose."""

_PI = wp.constant(wp.pi)


@wp.func
def tcp_in_base(reach: Reach, layouts: LayoutsView, row: int, grasp: int):
    """Return position and orientation of the TCP in a grasp, in the frame of the arm's base."""
    pos, quat = tcp_of(reach, grasp, layouts.body_pos[row], layouts.body_quat[row])
    return in_base(reach, layouts, row, pos, quat)


@wp.func
def _drawn(arm: ArmView, seed: wp.uint64, episode: int, stream: wp.uint32, trial: int, draw: int) -> vec8:
    """Draw joint positions uniformly within the joint limits, or from -pi to pi for a hinge without limits."""
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
def nearest_turns(arm: ArmView, there: vec8, before: vec8):
    """Shift the freely turning joints of a pose, such as a pre-grasp, by multiples of 2 pi towards another pose.

    Return the shifted joints, and whether every joint is then near its position in the other pose.
    """
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


@wp.func
def present_joints(reach: Reach, layouts: LayoutsView, row: int) -> vec8:
    """Return the present joint positions of a row's arm."""
    q = vec8()
    for i in range(MAX_JOINTS):
        if i < reach.arm.njoint:
            q[i] = layouts.qpos[row, reach.arm_qposadr[i]]
    return q


@wp.func
def start_joints(
    reach: Reach, layouts: LayoutsView, search: Search, reach_search: ReachSearch, split: wp.uint32, c: int
) -> vec8:
    """Return the initial joint positions of a candidate's inverse kinematics."""
    row = reach_search.row[c]
    column = reach_search.column[row]
    grasp = reach_search.grasp[c]
    start = reach_search.ik_start[c]
    q = vec8()
    if start == 0:
        q = present_joints(reach, layouts, row)
    elif reach.mapped != 0 and start <= wp.static(WITNESSES):
        pos, quat = tcp_in_base(reach, layouts, row, grasp)
        q = witness(reach.map, pos, quat, start - 1)
    else:
        stream = numbered_stream(split, REACH_STREAM)
        trial = search.row_restart[row] * layouts.grasp.shape[1] + column
        draw = (grasp - reach.reach_graspadr[column]) * wp.static(STARTS) + start
        worldid = search.row_world[row]
        seed = layouts.pending_seed[worldid]
        q = _drawn(reach.arm, seed, layouts.pending_episode[worldid], stream, trial, draw)
    return q


@wp.kernel(grid_stride=False)
def _solve(
    lanes: int,
    reach: Reach,
    step: int,
    # Layouts in: bodies*
    layouts: LayoutsView,
    # ReachSearch in: column, tier, candidates, row, grasp, ik_start; out: pregrasp_qpos; both: failed, grasp_qpos
    reach_search: ReachSearch,
):
    for c in range(wp.tid(), candidate_num(reach_search), lanes):
        if not takes_step(reach_search, c, step):
            continue
        pos, quat = tcp_in_base(reach, layouts, reach_search.row[c], reach_search.grasp[c])
        if step == ReachStep.IK_AT_PREGRASP:
            pos = pos - wp.static(PREGRASP_DISTANCE) * z_axis(quat)
        found = refine(reach.arm, pos, quat, reach_search.grasp_qpos[c], wp.static(ITERATIONS))
        passed = accepted(found)
        if step == ReachStep.IK_AT_PREGRASP:
            q, near = nearest_turns(reach.arm, reach_search.grasp_qpos[c], found.q)
            reach_search.pregrasp_qpos[c] = q
            passed = passed and near
        else:
            reach_search.grasp_qpos[c] = found.q
        if not passed:
            wp.atomic_min(reach_search.failed, c, step)


def launch_ik(work: Workspace, reach: Reach, clear: bool, reach_search: ReachSearch) -> None:
    """Solve for the joints of the candidates' grasps. If `clear`, also solve for the joints of their pre-grasps."""
    for step in (ReachStep.IK_AT_GRASP, ReachStep.IK_AT_PREGRASP) if clear else (ReachStep.IK_AT_GRASP,):
        work.launch_lanes(_solve, reach, int(step), work.layouts, reach_search)
