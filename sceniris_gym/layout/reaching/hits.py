"""Collision tests of candidates' robots against lists of pairs, one block per candidate."""

import warp as wp

from sceniris_gym.collide.boxes import NARROW_STACK, SHARED_STACK, UNPROVEN, collides, collides_without_stack
from sceniris_gym.collide.containment import encloses
from sceniris_gym.device.blocks import block_sync
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.poses import pose_for
from sceniris_gym.layout.reaching.search import (
    DEFERRED,
    IN_HAND,
    ReachSearch,
    ReachStep,
    reach_candidate_num,
    takes_step,
)
from sceniris_gym.layout.wave.search import Workspace
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach

wp.set_module_options({"enable_backward": False})


@wp.func
def _pairs_of(reach: Reach, reach_search: ReachSearch, step: int, row: int) -> int:
    """Return the list of pairs that a step tests for the reach target of a row."""
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
def _is_deferred(reach_search: ReachSearch, at_once: int, c: int) -> bool:
    """Return True if enough candidates before this one have joints: the first that passes wins, most often the first.

    More are tested where some have failed, and where the wave has few rows for the `at_once` candidates that a launch
    tests as fast as one; all are where rows wait for room, which bounds the number of waves. Other blocks may defer the
    candidates before it meanwhile, or see them collide.
    """
    if reach_search.candidates[0] > reach_search.failed.shape[0]:
        return False
    row = reach_search.row[c]
    earlier = int(0)
    for other in range(reach_search.first[row], c):
        failed = reach_search.failed[other]
        if failed == wp.static(DEFERRED) or failed >= ReachStep.SELF_AT_GRASP:
            earlier += 1
    return earlier >= wp.max(1 + 8 * reach_search.tried[row], at_once // reach_search.rows[0])


@wp.kernel(grid_stride=False, cuda_max_registers=128)
def _test(
    program: Program,
    reach: Reach,
    first: int,
    last: int,
    posed: bool,
    blocks: int,
    # Layouts in: qpos, body_pos, body_quat
    layouts: LayoutsView,
    # ReachSearch in: column, tried, tier, first, rows, candidates, row, grasp, start, failed, grasp_qpos,
    #   pregrasp_qpos, qpos, body_pos, body_quat
    # ReachSearch out: failed, qpos, body_pos, body_quat
    reach_search: ReachSearch,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec3i)
    leaves = wp.tile_stack(capacity=wp.static(NARROW_STACK), dtype=wp.vec3i)
    for c in range(block, reach_candidate_num(reach_search), blocks):
        if not takes_step(reach_search, c, first):
            continue
        if not posed:
            at_once = blocks // 16  # on an H200, 1,000 more take 0.1 ms longer
            deferred = first == ReachStep.SELF_AT_GRASP and _is_deferred(reach_search, at_once, c)
            block_sync()  # every lane has read `failed`
            if deferred:
                reach_search.failed[c] = wp.static(DEFERRED)
                continue
        row = reach_search.row[c]
        own_pos = reach_search.body_pos[c]
        own_quat = reach_search.body_quat[c]
        pos = layouts.body_pos[row]
        quat = layouts.body_quat[row]
        step = int(first)
        hit = bool(False)
        while step <= last and not hit:
            if takes_step(reach_search, c, step):
                if not posed:
                    pose_for(program, reach, layouts, reach_search, c, step, lane)
                pairs = _pairs_of(reach, reach_search, step, row)
                adr = reach.arm_broadadr[pairs]
                num = reach.arm_broadnum[pairs]
                found = collides(program, adr, num, 0, -1, nodes, leaves, lane, own_pos, own_quat, pos, quat)
                hit = found == Cause.COLLISION
                if found == UNPROVEN:
                    hit = collides_without_stack(program, adr, num, lane, own_pos, own_quat, pos, quat)
            step += 1
        if lane == 0 and hit:  # every lane has read `failed` by now
            reach_search.failed[c] = step - 1


@wp.kernel(grid_stride=False)
def _test_containment(
    program: Program,
    reach: Reach,
    first: int,
    last: int,
    posed: bool,
    blocks: int,
    # Layouts in: qpos, body_pos, body_quat
    layouts: LayoutsView,
    # ReachSearch in: column, tier, candidates, row, grasp, start, failed, grasp_qpos, pregrasp_qpos, qpos, body_pos,
    #   body_quat
    # ReachSearch out: failed, qpos, body_pos, body_quat
    reach_search: ReachSearch,
):
    block, lane = wp.tid()
    for c in range(block, reach_candidate_num(reach_search), blocks):
        row = reach_search.row[c]
        own_pos = reach_search.body_pos[c]
        own_quat = reach_search.body_quat[c]
        pos = layouts.body_pos[row]
        quat = layouts.body_quat[row]
        step = int(first)
        inside = bool(False)
        while step <= last and not inside:
            if takes_step(reach_search, c, step):
                if not posed:
                    pose_for(program, reach, layouts, reach_search, c, step, lane)
                pairs = _pairs_of(reach, reach_search, step, row)
                adr = reach.arm_pairadr[pairs]
                inside = encloses(program, adr, reach.arm_pairnum[pairs], lane, own_pos, own_quat, pos, quat)
            step += 1
        if lane == 0 and inside:  # every lane has read `failed` by now
            reach_search.failed[c] = step - 1


def launch_test_arm(
    work: Workspace,
    reach: Reach,
    first: ReachStep,
    last: ReachStep,
    reach_search: ReachSearch,
    *,
    posed: bool = False,
) -> None:
    """Pose the robots of candidates, and test them, at the steps from `first` to `last`; defer some before that.

    Args:
        work: The arrays of the generator.
        reach: The arm.
        first: The first step.
        last: The last step.
        reach_search: The candidates.
        posed: They are posed already, and none is deferred.
    """
    for test in (_test, _test_containment) if work.program.visual else (_test,):
        inputs = [work.program, reach, int(first), int(last), posed, work.size.blocks, work.layouts]
        work.launch_blocks(test, inputs, reach_search)
