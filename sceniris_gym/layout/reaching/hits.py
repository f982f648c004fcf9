"""Test the robot, posed for a candidate, for collision: one list of pairs per step, and one block per candidate."""

import warp as wp

from sceniris_gym.collide.boxes import NARROW_STACK, SHARED_STACK, UNPROVEN, collides, collides_without_stack, encloses
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.search import IN_HAND, ReachSearch, ReachStep, candidate_num, takes_step
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


@wp.kernel(grid_stride=False, cuda_max_registers=128)
def _test(
    blocks: int,
    program: Program,
    reach: Reach,
    first: int,
    last: int,
    # Layouts in: bodies*
    layouts: LayoutsView,
    # ReachSearch in: column, tier, candidates, row, ik_start, body_pos, body_quat; both: failed
    reach_search: ReachSearch,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec3i)
    leaves = wp.tile_stack(capacity=wp.static(NARROW_STACK), dtype=wp.vec3i)
    for c in range(block, candidate_num(reach_search), blocks):
        row = reach_search.row[c]
        own_pos = reach_search.body_pos[c]
        own_quat = reach_search.body_quat[c]
        pos = layouts.body_pos[row]
        quat = layouts.body_quat[row]
        step = int(first)
        hit = bool(False)
        while step <= last and not hit:
            if takes_step(reach_search, c, step):
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
    blocks: int,
    program: Program,
    reach: Reach,
    first: int,
    last: int,
    # Layouts in: bodies*
    layouts: LayoutsView,
    # ReachSearch in: column, tier, candidates, row, ik_start, body_pos, body_quat; both: failed
    reach_search: ReachSearch,
):
    block, lane = wp.tid()
    for c in range(block, candidate_num(reach_search), blocks):
        row = reach_search.row[c]
        own_pos = reach_search.body_pos[c]
        own_quat = reach_search.body_quat[c]
        pos = layouts.body_pos[row]
        quat = layouts.body_quat[row]
        step = int(first)
        inside = bool(False)
        while step <= last and not inside:
            if takes_step(reach_search, c, step):
                pairs = _pairs_of(reach, reach_search, step, row)
                adr = reach.arm_pairadr[pairs]
                inside = encloses(program, adr, reach.arm_pairnum[pairs], lane, own_pos, own_quat, pos, quat)
            step += 1
        if lane == 0 and inside:  # every lane has read `failed` by now
            reach_search.failed[c] = step - 1


def launch_test_arm(
    work: Workspace, reach: Reach, first: ReachStep, last: ReachStep, reach_search: ReachSearch
) -> None:
    """Test candidates in their current pose: run the steps of `ReachStep` from `first` to `last`."""
    for test in (_test, _test_containment) if work.program.visual else (_test,):
        work.launch_blocks(test, work.program, reach, int(first), int(last), work.layouts, reach_search)
