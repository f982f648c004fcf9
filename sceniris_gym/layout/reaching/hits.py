"""Test the robot, posed for a candidate, for collision: one list of pairs per step.

A candidate has one pose, or two: in the grasp and in the pre-grasp. A block takes the steps of a candidate, one after
the other. The first step that fails counts.
"""

import warp as wp

from sceniris_gym.collide.boxes import NARROW_STACK, SHARED_STACK, UNPROVEN, collides, collides_without_stack, encloses
from sceniris_gym.device.blocks import block_any
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.search import (
    IN_HAND,
    ReachSearch,
    ReachStep,
    candidate_num,
    fail_grasp,
    pose_index,
    takes_step,
)
from sceniris_gym.layout.wave.search import Workspace
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.func
def _pairs_of(reach: Reach, reach_search: ReachSearch, step: int, row: int) -> int:
    """Return the index of the list of pairs that `step` tests for the current reach target of a row."""
    column = reach_search.column[row]
    if step < ReachStep.HAND_AND_TARGET:
        return reach.arm_hand[column]
    if step == ReachStep.HAND_AND_TARGET or step == ReachStep.TARGET_AT_PREGRASP:
        return reach.arm_target[column]
    if step == ReachStep.SELF_AT_GRASP or step == ReachStep.SELF_AT_PREGRASP:
        return reach.arm_self[column]
    if reach_search.tier[row, column] == wp.static(IN_HAND):
        return reach.arm_held[column]
    return reach.arm_scene[column]


@wp.func
def _fail(reach_search: ReachSearch, c: int, step: int):
    """Let a candidate fail at a step. A step before the inverse kinematics decides for all starts of the grasp."""
    if step < ReachStep.IK_AT_GRASP:
        fail_grasp(reach_search, c, step)
    else:
        wp.atomic_min(reach_search.failed, c, step)


@wp.kernel(grid_stride=False, cuda_max_registers=128)
def _test(
    blocks: int,
    program: Program,
    reach: Reach,
    first: int,
    second: int,
    last: int,
    # Layouts in: bodies*
    layouts: LayoutsView,
    # ReachSearch in: column, tier, first, trials, candidates, row, ik_start, body_pos, body_quat; both: failed
    reach_search: ReachSearch,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec3i)
    leaves = wp.tile_stack(capacity=wp.static(NARROW_STACK), dtype=wp.vec3i)
    for c in range(block, candidate_num(reach_search), blocks):
        row = reach_search.row[c]
        pos = layouts.body_pos[row]
        quat = layouts.body_quat[row]
        step = int(first)
        hit = bool(False)
        while step <= last and not hit:
            # the inverse kinematics may write `failed` meanwhile, so all lanes agree first
            if block_any(int(takes_step(reach_search, c, step))) != 0:
                pairs = _pairs_of(reach, reach_search, step, row)
                at = pose_index(reach_search, c, int(step >= second))
                own_pos = reach_search.body_pos[at]
                own_quat = reach_search.body_quat[at]
                adr = reach.arm_broadadr[pairs]
                num = reach.arm_broadnum[pairs]
                found = collides(program, adr, num, 0, -1, nodes, leaves, lane, own_pos, own_quat, pos, quat)
                hit = found == Cause.COLLISION
                if found == UNPROVEN:
                    hit = collides_without_stack(program, adr, num, lane, own_pos, own_quat, pos, quat)
            step += 1
        if lane == 0 and hit:
            _fail(reach_search, c, step - 1)


@wp.kernel(grid_stride=False)
def _test_containment(
    blocks: int,
    program: Program,
    reach: Reach,
    first: int,
    second: int,
    last: int,
    # Layouts in: bodies*
    layouts: LayoutsView,
    # ReachSearch in: column, tier, first, trials, candidates, row, ik_start, body_pos, body_quat; both: failed
    reach_search: ReachSearch,
):
    block, lane = wp.tid()
    for c in range(block, candidate_num(reach_search), blocks):
        row = reach_search.row[c]
        pos = layouts.body_pos[row]
        quat = layouts.body_quat[row]
        step = int(first)
        inside = bool(False)
        while step <= last and not inside:
            if block_any(int(takes_step(reach_search, c, step))) != 0:
                pairs = _pairs_of(reach, reach_search, step, row)
                at = pose_index(reach_search, c, int(step >= second))
                own_pos = reach_search.body_pos[at]
                own_quat = reach_search.body_quat[at]
                adr = reach.arm_pairadr[pairs]
                inside = encloses(program, adr, reach.arm_pairnum[pairs], lane, own_pos, own_quat, pos, quat)
            step += 1
        if lane == 0 and inside:
            _fail(reach_search, c, step - 1)


def launch_test_arm(
    work: Workspace,
    reach: Reach,
    first: ReachStep,
    second: ReachStep | None,
    last: ReachStep,
    reach_search: ReachSearch,
) -> None:
    """Test candidates in their poses: run the steps of `ReachStep` from `first` to `last`.

    The steps from `second` on test the pre-grasp. With None, candidates have a single pose.
    """
    steps = [int(first), int(last) + 1 if second is None else int(second), int(last)]
    for test in (_test, _test_containment) if work.program.visual else (_test,):
        work.launch_blocks(test, work.program, reach, *steps, work.layouts, reach_search)
