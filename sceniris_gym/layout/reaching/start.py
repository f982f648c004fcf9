"""Start poses: after the joints of grasps are found, move the arm and an object in its hand to the start pose.

`start` in the scene file lists kinds of start. If a kind takes an arm to an object, the arm moves to the pre-grasp or
the grasp that the reach stage has found. For a lifted or held object, several heights or joint positions are tried, and
the first collision-free trial wins. If all trials collide, the restart fails, and the next restart follows. A
*candidate* here is one such trial, in a `ReachSearch`.
"""

import warp as wp

from sceniris_gym.config.tier import Tier
from sceniris_gym.device.random import START_STREAM, uniforms
from sceniris_gym.device.transforms import mul_quat, neg_quat, rot_vec_quat
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.poses import in_base, open_gripper, pose_arm, set_gripper, take_joints
from sceniris_gym.layout.reaching.search import (
    IN_HAND,
    ReachSearch,
    ReachStep,
    begin_reach_wave,
    candidate_num,
    queue_row,
    queue_target,
)
from sceniris_gym.layout.reaching.waves import first_passed, keep_grasp
from sceniris_gym.layout.wave.rounds import NEVER, row_of_restart
from sceniris_gym.layout.wave.search import Search, Workspace, flip_failed, numbered_stream
from sceniris_gym.placement.kinematics import write_root
from sceniris_gym.program.device import Cause, Program
from sceniris_gym.program.device_reach import Reach, StartPose, Starts, is_drawn
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.reach.solve import ITERATIONS, accepted, refine, vec8

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

TRIALS = 64
"""Number of trials in a restart whose kind of start draws heights or joints."""
# Greatest distance [m] of the TCP from a grasp. The tier `ik` accepts up to a millimetre at the limit of a joint, but
# the fingers would then penetrate the held object by a millimetre.
_EXACT = wp.constant(1.0e-4)
_mat58 = wp.types.matrix(shape=(5, MAX_JOINTS), dtype=float)
# Indices of a trial's random numbers for height and grasp, after the indices of the joints.
_HEIGHT, _GRASP = MAX_JOINTS, MAX_JOINTS + 1


@wp.kernel
def _queue_starts(
    reach: Reach,
    starts: Starts,
    # Layouts in: start, grasp
    layouts: LayoutsView,
    # Search in: worlds*, restarts_at_once
    search: Search,
    # ReachSearch in: source; out: column, number, total, tried, paths, tier, furthest, queue; both: rows_left
    reach_search: ReachSearch,
):
    worldid = wp.tid()
    kind = layouts.start[worldid]
    if not search.pending[worldid] or search.best[worldid] == NEVER or starts.arm[kind] != reach.number:
        return
    row = row_of_restart(search, worldid, search.best[worldid] - search.restart[worldid])
    lifted = starts.pose[kind] >= StartPose.LIFTED
    for column in range(starts.target.shape[1]):
        if starts.target[kind, column] and layouts.grasp[row, column] >= 0:
            reach_search.tier[row, column] = wp.where(lifted, wp.static(IN_HAND), int(Tier.CLEAR))
            queue_target(reach_search, row, column, wp.where(lifted, wp.static(TRIALS), 1))


def launch_queue_starts(work: Workspace, reach: Reach, reach_search: ReachSearch) -> None:
    """Queue each world that has a finished restart and a kind of start that takes this arm to an object."""
    work.launch(_queue_starts, work.nworld, reach, work.compiled.starts, work.layouts, work.search, reach_search)


@wp.func
def _grip_pose(reach: Reach, starts: Starts, layouts: LayoutsView, row: int, grasp: int):
    """Return position and orientation of the TCP in a closed grasp of an object that is still at its place."""
    body = reach.grasp_body[grasp]
    quat = layouts.body_quat[row, body]
    pos = layouts.body_pos[row, body] + rot_vec_quat(starts.grip_pos[grasp], quat)
    return pos, mul_quat(quat, reach.grasp_quat[grasp])


@wp.func
def _on_path(layouts: LayoutsView, row: int, column: int, njoint: int, share: float) -> vec8:
    """Return the joints at a share of a path's length. The length of a piece is the largest change of a joint."""
    corners = _mat58()
    for i in range(MAX_JOINTS):
        if i < njoint:
            for k in range(3):
                corners[k, i] = layouts.path[row, column, k * MAX_JOINTS + i]
            corners[3, i] = layouts.pregrasp_qpos[row, column, i]
            corners[4, i] = layouts.grasp_qpos[row, column, i]
    total = float(0.0)
    for k in range(4):
        total += wp.max(wp.abs(corners[k + 1] - corners[k]))
    left = share * total
    joints = corners[0]
    for k in range(4):
        length = wp.max(wp.abs(corners[k + 1] - corners[k]))
        if left > 0.0 and length > 0.0:
            joints = corners[k] + wp.min(left / length, 1.0) * (corners[k + 1] - corners[k])
        left -= length
    return joints


@wp.func
def _drawn_grasp(reach: Reach, starts: Starts, kind: int, stable: int, u: float) -> int:
    """Draw a grasp of a stable pose with the uniform number `u`, among the grasps that the kind of start can use."""
    adr = reach.stable_graspadr[stable]
    num = int(0)
    for grasp in range(adr, adr + reach.stable_graspnum[stable]):
        num += int(starts.grasp[kind, grasp])
    number = wp.min(int(u * float(num)), num - 1)
    found = int(-1)
    for grasp in range(adr, adr + reach.stable_graspnum[stable]):
        if starts.grasp[kind, grasp]:
            if number == 0:
                found = grasp
            number -= 1
    return found


@wp.func
def _uniform(layouts: LayoutsView, search: Search, split: wp.uint32, row: int, trial: int, number: int) -> float:
    """Return a uniform random number for a row's trial. `number` selects one of the trial's random numbers."""
    worldid = search.row_world[row]
    seed, episode = layouts.pending_seed[worldid], layouts.pending_episode[worldid]
    named = 1 + search.row_restart[row] * wp.static(TRIALS) + trial
    return uniforms(seed, episode, numbered_stream(split, START_STREAM), named, number // 4)[number % 4]


@wp.func
def _carry(
    program: Program, reach: Reach, starts: Starts, layouts: LayoutsView, row: int, reach_search: ReachSearch, c: int
):
    """Move the target of a candidate rigidly from its place into the hand of the posed robot."""
    old_pos, old_quat = _grip_pose(reach, starts, layouts, row, reach_search.grasp[c])
    hand = reach.hand_body[0]
    new_quat = mul_quat(reach_search.body_quat[c, hand], neg_quat(reach.hand_quat))
    new_pos = reach_search.body_pos[c, hand] - rot_vec_quat(reach.hand_pos, new_quat)
    rotation = wp.normalize(mul_quat(new_quat, neg_quat(old_quat)))
    obj = reach.reach_obj[reach_search.column[row]]
    for i in range(program.obj_bodynum[obj]):
        body = program.body_list[program.obj_bodyadr[obj] + i]
        reach_search.body_pos[c, body] = new_pos + rot_vec_quat(layouts.body_pos[row, body] - old_pos, rotation)
        reach_search.body_quat[c, body] = wp.normalize(mul_quat(rotation, layouts.body_quat[row, body]))


@wp.kernel(grid_stride=False)
def _pose(
    lanes: int,
    program: Program,
    reach: Reach,
    starts: Starts,
    split: wp.uint32,
    # Layouts in: qpos, start, grasps*, pending*, stable, bodies*
    layouts: LayoutsView,
    # Search in: restarts*
    search: Search,
    # ReachSearch in: column, number, first, candidates, row; out: rows, failed, grasp_qpos, hard_num; both: rows_left,
    #   source, grasp, qpos, body_pos, body_quat
    reach_search: ReachSearch,
):
    if wp.tid() == 0:
        begin_reach_wave(reach_search)
    for c in range(wp.tid(), candidate_num(reach_search), lanes):
        row = reach_search.row[c]
        column = reach_search.column[row]
        kind = layouts.start[search.row_world[row]]
        pose = starts.pose[kind]
        trial = reach_search.number[row] + c - reach_search.first[row]
        grasp = reach.reach_graspadr[column] + layouts.grasp[row, column]
        qpos = reach_search.qpos[c]
        take_joints(program, reach.arm_body, layouts.qpos[row], qpos)
        joints = vec8()
        for i in range(MAX_JOINTS):
            if i < reach.arm.njoint:
                joints[i] = layouts.grasp_qpos[row, column, i]
                if pose == StartPose.PREGRASP:
                    joints[i] = layouts.pregrasp_qpos[row, column, i]
        if pose == StartPose.PATH:
            share = starts.share[kind]
            u = _uniform(layouts, search, split, row, trial, wp.static(_HEIGHT))
            joints = _on_path(layouts, row, column, reach.arm.njoint, share[0] + u * (share[1] - share[0]))
        if pose == StartPose.PREGRASP or pose == StartPose.PATH:
            open_gripper(reach, grasp, qpos)
        elif pose == StartPose.HELD:
            u = _uniform(layouts, search, split, row, trial, wp.static(_GRASP))
            grasp = _drawn_grasp(reach, starts, kind, layouts.stable[row, column], u)
            for i in range(MAX_JOINTS):
                if i < reach.arm.njoint:
                    interval = starts.arm_range[kind, i]
                    joints[i] = qpos[reach.arm_qposadr[i]]
                    if is_drawn(interval):
                        u = _uniform(layouts, search, split, row, trial, i)
                        joints[i] = interval[0] + u * (interval[1] - interval[0])
        else:
            pos, quat = _grip_pose(reach, starts, layouts, row, grasp)
            lift = starts.lift[kind]
            u = _uniform(layouts, search, split, row, trial, wp.static(_HEIGHT))
            pos = pos + wp.vec3(0.0, 0.0, lift[0] + u * (lift[1] - lift[0]))
            at, rotation = in_base(reach, layouts, row, pos, quat)
            solved = refine(reach.arm, at, rotation, joints, wp.static(ITERATIONS))
            if not accepted(solved) or solved.pos_err > _EXACT:
                reach_search.failed[c] = ReachStep.IK_AT_GRASP
                continue
            joints = solved.q
        reach_search.grasp[c] = grasp
        reach_search.grasp_qpos[c] = joints
        if pose >= StartPose.STANDING:
            set_gripper(reach, starts.grip_share[grasp], qpos)
        pose_arm(program, reach, layouts, row, joints, qpos, reach_search.body_pos[c], reach_search.body_quat[c])
        if pose >= StartPose.LIFTED:
            _carry(program, reach, starts, layouts, row, reach_search, c)


def launch_pose_start(work: Workspace, reach: Reach, reach_search: ReachSearch) -> None:
    """Pose the robot of each candidate with its held object.

    A candidate fails if inverse kinematics finds no joints that reach the candidate's pose exactly.
    """
    inputs = [work.program, reach, work.compiled.starts, work.split, work.layouts, work.search, reach_search]
    work.launch_lanes(_pose, *inputs)


@wp.kernel(grid_stride=False)
def _accept(
    lanes: int,
    program: Program,
    reach: Reach,
    # Layouts out: state*, grasps*; both: row_rejections
    layouts: LayoutsView,
    # Search in: row_world; both: best
    search: Search,
    # ReachSearch in: column, total, tier, first, trials, source, rows, grasp, ik_start, failed, grasp_qpos,
    #   pregrasp_qpos, path, qpos, body_pos, body_quat; out: candidates; both: number, tried, furthest, queue, rows_left
    reach_search: ReachSearch,
):
    if wp.tid() == 0:
        reach_search.candidates[0] = 0  # of the next wave
    for i in range(wp.tid(), reach_search.rows[0], lanes):
        row = reach_search.queue[reach_search.source[0], i]
        column = reach_search.column[row]
        found = first_passed(reach_search, row)
        if found >= 0:
            take_joints(program, reach.arm_body, reach_search.qpos[found], layouts.qpos[row])
            if reach_search.tier[row, column] == wp.static(IN_HAND):
                obj = reach.reach_obj[column]
                pos = reach_search.body_pos[found, program.obj_body[obj]]
                quat = reach_search.body_quat[found, program.obj_body[obj]]
                write_root(program, obj, pos, quat, layouts.qpos[row], layouts.mocap_pos[row], layouts.mocap_quat[row])
                keep_grasp(reach, layouts, reach_search, row, column, found)
        elif reach_search.number[row] < reach_search.total[row]:
            queue_row(reach_search, row)
        else:
            layouts.row_rejections[row, reach.reach_obj[column], Cause.BLOCKED] += 1
            worldid = search.row_world[row]
            search.best[worldid] = flip_failed(search.best[worldid])


def launch_accept_starts(work: Workspace, reach: Reach, reach_search: ReachSearch) -> None:
    """Keep the first candidate of each row that passed.

    A row without such a candidate continues with its next trials, or fails after its last trial. A start pose only
    changes positions of joints and mocap bodies. `body_pos` and `body_quat` of the row keep the placed poses.
    """
    work.launch_lanes(_accept, work.program, reach, work.layouts, work.search, reach_search)
