"""The start stage, which follows the reach stage: bring the arm to its start, and what it holds with it.

A layout whose kind of start has an arm at an object takes it to the pre-grasp or to the grasp that the reach stage
found. Lifted and held things are tried at several heights and joints; the first that is clear of everything wins. A
restart without one has failed, and the next one follows.
"""

from __future__ import annotations

import warp as wp

from sceniris_gym.collide.boxes import NARROW_STACK, SHARED_STACK, UNPROVEN, collides, collides_without_stack
from sceniris_gym.device.sequence import repeat_launches
from sceniris_gym.layout.layouts import LayoutsView, Status
from sceniris_gym.layout.reaching.poses import take_joints
from sceniris_gym.layout.reaching.start_poses import launch_go_home, launch_pose_start
from sceniris_gym.layout.reaching.start_search import (
    TRIALS,
    StartSearch,
    create_start_search,
    launch_plan_wave,
    launch_queue_worlds,
    start_column,
    start_row,
)
from sceniris_gym.layout.wave.bank import bank_row
from sceniris_gym.layout.wave.search import Search, Workspace
from sceniris_gym.placement.kinematics import write_root
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.program.device_starts import StartPose, Starts
from sceniris_gym.reach.arm import MAX_JOINTS

wp.set_module_options({"enable_backward": False})


@wp.kernel(grid_stride=False, cuda_max_registers=128)
def _test(
    program: Program,
    reach: Reach,
    starts: Starts,
    blocks: int,
    # Layouts in: start, grasp, body_pos, body_quat
    layouts: LayoutsView,
    # Search in: restart, ticket, best, restarts_at_once
    search: Search,
    # StartSearch in: queue, source, num, at_once, passed, body_pos, body_quat
    # StartSearch out: passed
    start_search: StartSearch,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec3i)
    leaves = wp.tile_stack(capacity=wp.static(NARROW_STACK), dtype=wp.vec3i)
    for c in range(block, start_search.num[0] * start_search.at_once[0], blocks):
        worldid = start_search.queue[start_search.source[0], c // start_search.at_once[0]]
        kind = layouts.start[worldid]
        if starts.arm[kind] != reach.number or not start_search.passed[c]:
            continue
        row = start_row(search, worldid)
        column = start_column(starts, layouts, row, kind)
        own_pos = start_search.body_pos[c]
        own_quat = start_search.body_quat[c]
        pos = layouts.body_pos[row]
        quat = layouts.body_quat[row]
        hit = bool(False)
        step = int(0)
        while step < 2 and not hit:
            pairs = reach.arm_self[column]
            if step == 1:
                pairs = reach.arm_scene[column]
                if starts.pose[kind] >= StartPose.LIFTED:
                    pairs = reach.arm_held[column]
            adr = reach.arm_broadadr[pairs]
            num = reach.arm_broadnum[pairs]
            found = collides(program, adr, num, 0, -1, nodes, leaves, lane, own_pos, own_quat, pos, quat)
            hit = found == Cause.COLLISION
            if found == UNPROVEN:
                hit = collides_without_stack(program, adr, num, lane, own_pos, own_quat, pos, quat)
            step += 1
        if lane == 0 and hit:  # every lane has read `passed` by now
            start_search.passed[c] = False


def _launch_test(work: Workspace, reach: Reach, starts: Starts, start_search: StartSearch) -> None:
    """Test the candidates of an arm for collision."""
    inputs = [work.program, reach, starts, work.size.blocks, work.layouts, work.search]
    work.launch_blocks(_test, inputs, start_search)


@wp.func
def _keep(
    program: Program,
    reach: Reach,
    starts: Starts,
    layouts: LayoutsView,
    row: int,
    kind: int,
    start_search: StartSearch,
    c: int,
):
    """Write a candidate that passed into its row."""
    take_joints(program, reach.arm_body, start_search.qpos[c], layouts.qpos[row])
    for i in range(reach.arm_body.shape[0]):
        body = reach.arm_body[i]
        layouts.body_pos[row, body] = start_search.body_pos[c, body]
        layouts.body_quat[row, body] = start_search.body_quat[c, body]
    if starts.pose[kind] < StartPose.LIFTED:
        return
    column = start_column(starts, layouts, row, kind)
    obj = reach.reach_obj[column]
    root = program.obj_body[obj]
    pos = start_search.body_pos[c, root]
    quat = start_search.body_quat[c, root]
    write_root(program, obj, pos, quat, layouts.qpos[row], layouts.mocap_pos[row], layouts.mocap_quat[row])
    for i in range(program.obj_bodynum[obj]):
        body = program.body_list[program.obj_bodyadr[obj] + i]
        layouts.body_pos[row, body] = start_search.body_pos[c, body]
        layouts.body_quat[row, body] = start_search.body_quat[c, body]
    layouts.grasp[row, column] = start_search.grasp[c] - reach.reach_graspadr[column]
    for i in range(MAX_JOINTS):
        layouts.grasp_qpos[row, column, i] = wp.where(i < reach.arm.njoint, start_search.joints[c][i], wp.nan)
        layouts.pregrasp_qpos[row, column, i] = wp.nan


@wp.kernel(grid_stride=False)
def _accept(
    program: Program,
    reach: Reach,
    starts: Starts,
    lanes: int,
    # Layouts in: start, grasp, row_rejections
    # Layouts out: qpos, mocap_pos, mocap_quat, grasp, grasp_qpos, pregrasp_qpos, row_rejections, body_pos, body_quat
    layouts: LayoutsView,
    # Search in: restart, ticket, best, restarts_at_once
    # Search out: best
    search: Search,
    # StartSearch in: queue, trial, left, source, num, waiting, at_once, passed, grasp, joints, qpos, body_pos,
    #   body_quat
    # StartSearch out: queue, trial, left
    start_search: StartSearch,
):
    for i in range(wp.tid(), start_search.waiting[0], lanes):
        worldid = start_search.queue[start_search.source[0], i]
        kind = layouts.start[worldid]
        if starts.arm[kind] != reach.number:
            continue
        at_once = start_search.at_once[0]
        found = int(-1)
        if i < start_search.num[0]:
            for c in range(i * at_once, (i + 1) * at_once):
                if found < 0 and start_search.passed[c]:
                    found = c
            start_search.trial[worldid] += at_once
        if found >= 0:
            _keep(program, reach, starts, layouts, start_row(search, worldid), kind, start_search, found)
            continue
        most = wp.where(starts.pose[kind] >= StartPose.LIFTED, wp.static(TRIALS), 1)
        if i >= start_search.num[0] or start_search.trial[worldid] < most:
            at = wp.atomic_add(start_search.left, 0, 1)
            start_search.queue[1 - start_search.source[0], at] = worldid
            continue
        row = start_row(search, worldid)
        column = start_column(starts, layouts, row, kind)
        layouts.row_rejections[row, reach.reach_obj[column], Cause.BLOCKED] += 1
        search.best[worldid] = -1 - search.best[worldid]


def _launch_accept(work: Workspace, reach: Reach, starts: Starts, start_search: StartSearch) -> None:
    """Keep the first candidate of each world that passed. A world without one goes on; out of trials, it has failed."""
    lanes = work.size.lanes
    work.launch(_accept, lanes, [work.program, reach, starts, lanes], work.layouts, work.search, start_search)


@wp.kernel
def _take_kind_of_bank(
    program: Program,
    starts: Starts,
    split: wp.uint32,
    # Layouts in: status, pending_seed, pending_episode
    # Layouts out: start
    layouts: LayoutsView,
):
    worldid = wp.tid()
    if layouts.status[worldid] == Status.FALLBACK:
        layouts.start[worldid] = starts.bank_start[bank_row(program, layouts, worldid, split)]


class StartStage:
    """The search for starts that are clear of everything, in all worlds whose restart is done.

    Args:
        compiled: A scene with kinds of starts.
        starts: These.
        work: The arrays of the generator.
    """

    def __init__(self, compiled: CompiledScene, starts: Starts, work: Workspace) -> None:
        self._starts, self._work = starts, work
        self._reaches = [] if compiled.reaching is None else [one.view for one in compiled.reaching.arms]
        self.search = create_start_search(compiled, work)
        self._most_waves = TRIALS + -(-work.nworld * TRIALS // self.search.passed.shape[0])

    def launch_start(self) -> None:
        """Clear the queue of worlds, which is not empty if earlier launches were interrupted."""
        self.search.left.zero_()

    def launch_go_home(self) -> None:
        """Return the arms of all rows to their start pose, from which the starts of the last layouts took them."""
        for reach in self._reaches:
            launch_go_home(self._work, reach, self._starts)

    def launch(self) -> None:
        """Bring the arms of all worlds whose restart is done to their start; a restart without one has failed."""
        launch_queue_worlds(self._work, self._starts, self.search)
        repeat_launches(self.search.left, self._wave, self._most_waves)

    def launch_take_kinds(self) -> None:
        """Give worlds that fell back on the bank the kinds of its layouts."""
        work = self._work
        work.launch(_take_kind_of_bank, work.nworld, [work.program, self._starts, work.split], work.layouts)

    def _wave(self) -> None:
        work, search = self._work, self.search
        launch_plan_wave(work, search)
        for reach in self._reaches:
            launch_pose_start(work, reach, self._starts, search)
            _launch_test(work, reach, self._starts, search)
            _launch_accept(work, reach, self._starts, search)
