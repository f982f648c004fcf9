"""Poses of the start stage: the arm of a candidate as it starts, with what it holds. One lane per candidate."""

import warp as wp

from sceniris_gym.config.tier import Tier
from sceniris_gym.device.quaternions import mul_quat, neg_quat, rot_vec_quat
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reaching.poses import open_gripper, pose_arm, set_gripper, take_joints
from sceniris_gym.layout.reaching.search import ReachSearch, ReachStep, reach_candidate_num
from sceniris_gym.layout.reaching.start_search import TRIALS, StartSearch, start_column, start_row, start_uniform
from sceniris_gym.layout.wave.rounds import row_of_restart
from sceniris_gym.layout.wave.search import Search, Workspace
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.program.device_starts import StartPose, Starts, is_drawn
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.reach.solve import ITERATIONS, accepted, refine, vec8

wp.set_module_options({"enable_backward": False})

# Numbers of the uniform numbers of a trial, behind those of the joints.
_HEIGHT, _GRASP = MAX_JOINTS, MAX_JOINTS + 1


@wp.kernel
def _go_home(
    program: Program,
    reach: Reach,
    starts: Starts,
    # Layouts out: qpos, body_pos, body_quat
    layouts: LayoutsView,
    # Search in: pending, restart, ticket, restarts_at_once
    search: Search,
):
    worldid = wp.tid()
    if not search.pending[worldid]:
        return
    for i in range(search.restarts_at_once[0]):
        if search.restart[worldid] + i <= program.restarts:
            row = row_of_restart(search, worldid, i)
            take_joints(program, reach.arm_body, program.home_qpos, layouts.qpos[row])
            for k in range(reach.arm_body.shape[0]):
                body = reach.arm_body[k]
                layouts.body_pos[row, body] = starts.home_pos[body]
                layouts.body_quat[row, body] = starts.home_quat[body]


def launch_go_home(work: Workspace, reach: Reach, starts: Starts) -> None:
    """Return an arm to its start pose in all rows of this round."""
    work.launch(_go_home, work.nworld, [work.program, reach, starts], work.layouts, work.search)


@wp.func
def _reaches(starts: Starts, kind: int, column: int) -> bool:
    """Return True if the arm starts at a target where that was placed, or straight above."""
    pose = starts.pose[kind]
    return starts.target[kind, column] and pose != StartPose.HOME and pose != StartPose.HELD


@wp.kernel
def _ask_tiers(
    starts: Starts,
    reach: Reach,
    # Layouts in: start
    # Layouts out: grasp_qpos, pregrasp_qpos
    layouts: LayoutsView,
    # Search in: waiting, row_world
    search: Search,
    # ReachSearch out: tier
    reach_search: ReachSearch,
):
    row, column = wp.tid()
    if not search.waiting[row]:
        return
    kind = layouts.start[search.row_world[row]]
    tier = reach.reach_tier[column]
    if _reaches(starts, kind, column):
        tier = int(Tier.CLEAR)
    reach_search.tier[row, column] = tier
    for i in range(MAX_JOINTS):
        layouts.grasp_qpos[row, column, i] = wp.nan
        layouts.pregrasp_qpos[row, column, i] = wp.nan


def launch_ask_tiers(work: Workspace, starts: Starts, reach_search: ReachSearch) -> None:
    """Ask for `clear` where the start of a row's world takes the arm to a target; others are asked for their tier."""
    dim = (work.nrow, starts.target.shape[1])
    work.launch(_ask_tiers, dim, [starts, work.reach], work.layouts, work.search, reach_search)


@wp.kernel(grid_stride=False)
def _leave_grasps(
    reach: Reach,
    starts: Starts,
    lanes: int,
    # Layouts in: start
    layouts: LayoutsView,
    # Search in: row_world
    search: Search,
    # ReachSearch in: column, candidates, row, grasp, start
    # ReachSearch out: failed
    reach_search: ReachSearch,
):
    for c in range(wp.tid(), reach_candidate_num(reach_search), lanes):
        row = reach_search.row[c]
        kind = layouts.start[search.row_world[row]]
        if _reaches(starts, kind, reach_search.column[row]):
            if not starts.grasp[kind, reach_search.grasp[c]] and reach_search.start[c] == 0:
                reach_search.failed[c] = ReachStep.MAP


def launch_leave_grasps(work: Workspace, reach: Reach, starts: Starts, reach_search: ReachSearch) -> None:
    """Reject the candidates of the reach stage whose grasp does not count for the start of their world."""
    lanes = work.size.lanes
    work.launch(_leave_grasps, lanes, [reach, starts, lanes, work.layouts, work.search], reach_search)


@wp.func
def _target(reach: Reach, pos: wp.vec3, quat: wp.vec4, base_pos: wp.vec3, base_quat: wp.vec4):
    """Return a pose of the TCP in the frame of the arm's base."""
    back = neg_quat(base_quat)
    return rot_vec_quat(pos - base_pos, back), wp.normalize(mul_quat(back, quat))


@wp.func
def _grip_pose(reach: Reach, starts: Starts, layouts: LayoutsView, row: int, grasp: int):
    """Return position and orientation of the TCP in a closed grasp of the object where it was placed."""
    body = reach.grasp_body[grasp]
    quat = layouts.body_quat[row, body]
    pos = layouts.body_pos[row, body] + rot_vec_quat(starts.grip_pos[grasp], quat)
    return pos, mul_quat(quat, reach.grasp_quat[grasp])


@wp.func
def _drawn_grasp(reach: Reach, starts: Starts, kind: int, variant: int, u: float) -> int:
    """Draw one of the grasps of a variant that count; each is as likely as any other."""
    adr = reach.variant_graspadr[variant]
    num = int(0)
    for grasp in range(adr, adr + reach.variant_graspnum[variant]):
        num += int(starts.grasp[kind, grasp])
    number = wp.min(int(u * float(num)), num - 1)
    found = int(-1)
    for grasp in range(adr, adr + reach.variant_graspnum[variant]):
        if starts.grasp[kind, grasp]:
            if number == 0:
                found = grasp
            number -= 1
    return found


@wp.func
def _move_object(
    program: Program,
    layouts: LayoutsView,
    row: int,
    obj: int,
    start_search: StartSearch,
    c: int,
    old_pos: wp.vec3,
    old_quat: wp.vec4,
    new_pos: wp.vec3,
    new_quat: wp.vec4,
):
    """Move an object as a whole, as a frame that it is fixed to moves."""
    turn = wp.normalize(mul_quat(new_quat, neg_quat(old_quat)))
    for i in range(program.obj_bodynum[obj]):
        body = program.body_list[program.obj_bodyadr[obj] + i]
        start_search.body_pos[c, body] = new_pos + rot_vec_quat(layouts.body_pos[row, body] - old_pos, turn)
        start_search.body_quat[c, body] = wp.normalize(mul_quat(turn, layouts.body_quat[row, body]))


@wp.kernel(grid_stride=False)
def _pose(
    program: Program,
    reach: Reach,
    starts: Starts,
    split: wp.uint32,
    lanes: int,
    # Layouts in: qpos, start, grasp, grasp_qpos, pregrasp_qpos, pending_seed, pending_episode, variant, body_pos,
    #   body_quat
    layouts: LayoutsView,
    # Search in: restart, ticket, best, restarts_at_once
    search: Search,
    # StartSearch in: queue, trial, source, num, at_once, passed, qpos, body_pos, body_quat
    # StartSearch out: passed, grasp, joints, qpos, body_pos, body_quat
    start_search: StartSearch,
):
    for c in range(wp.tid(), start_search.num[0] * start_search.at_once[0], lanes):
        worldid = start_search.queue[start_search.source[0], c // start_search.at_once[0]]
        kind = layouts.start[worldid]
        if starts.arm[kind] != reach.number:
            continue
        pose = starts.pose[kind]
        trial = start_search.trial[worldid] + c % start_search.at_once[0]
        start_search.passed[c] = trial == 0 or (pose >= StartPose.LIFTED and trial < wp.static(TRIALS))
        if not start_search.passed[c]:
            continue
        row = start_row(search, worldid)
        column = start_column(starts, layouts, row, kind)
        grasp = reach.reach_graspadr[column] + layouts.grasp[row, column]
        qpos = start_search.qpos[c]
        take_joints(program, reach.arm_body, layouts.qpos[row], qpos)
        joints = vec8()
        for i in range(MAX_JOINTS):
            if i < reach.arm.njoint:
                joints[i] = layouts.grasp_qpos[row, column, i]
                if pose == StartPose.PREGRASP:
                    joints[i] = layouts.pregrasp_qpos[row, column, i]
        if pose == StartPose.PREGRASP:
            open_gripper(reach, grasp, qpos)
        elif pose == StartPose.HELD:
            u = start_uniform(layouts, search, split, worldid, trial, wp.static(_GRASP))
            grasp = _drawn_grasp(reach, starts, kind, layouts.variant[row, column], u)
            for i in range(MAX_JOINTS):
                if i < reach.arm.njoint:
                    interval = starts.arm_range[kind, i]
                    joints[i] = qpos[reach.arm_qposadr[i]]
                    if is_drawn(interval):
                        u = start_uniform(layouts, search, split, worldid, trial, i)
                        joints[i] = interval[0] + u * (interval[1] - interval[0])
        else:
            pos, quat = _grip_pose(reach, starts, layouts, row, grasp)
            lift = starts.lift[kind]
            u = start_uniform(layouts, search, split, worldid, trial, wp.static(_HEIGHT))
            pos = pos + wp.vec3(0.0, 0.0, lift[0] + u * (lift[1] - lift[0]))
            base = reach.base_body
            at, turn = _target(reach, pos, quat, layouts.body_pos[row, base], layouts.body_quat[row, base])
            solved = refine(reach.arm, at, turn, joints, wp.static(ITERATIONS))
            start_search.passed[c] = accepted(solved)
            joints = solved.q
        start_search.grasp[c] = grasp
        start_search.joints[c] = joints
        if pose >= StartPose.STANDING:
            set_gripper(reach, starts.grip_share[grasp], qpos)
        pose_arm(program, reach, layouts, row, joints, qpos, start_search.body_pos[c], start_search.body_quat[c])
        if pose >= StartPose.LIFTED:
            hand = reach.hand_body[0]
            new_quat = mul_quat(start_search.body_quat[c, hand], neg_quat(reach.hand_quat))
            new_pos = start_search.body_pos[c, hand] - rot_vec_quat(reach.hand_pos, new_quat)
            pos, quat = _grip_pose(reach, starts, layouts, row, grasp)
            obj = reach.reach_obj[column]
            _move_object(program, layouts, row, obj, start_search, c, pos, quat, new_pos, new_quat)


def launch_pose_start(work: Workspace, reach: Reach, starts: Starts, start_search: StartSearch) -> None:
    """Pose the robot of each candidate of an arm, and what it holds. Candidates fail where no joints lead there."""
    lanes = work.size.lanes
    inputs = [work.program, reach, starts, work.split, lanes, work.layouts, work.search]
    work.launch(_pose, lanes, inputs, start_search)
