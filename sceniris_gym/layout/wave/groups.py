"""Members of groups: draw the members that are present in a world, and park the others.

Parked objects are not tested for collision: `program.checks.parking` rejects scenes with objects that could be placed
in the parking area.
"""

import warp as wp

from sceniris_gym.device.random import GROUP_STREAM, uniforms
from sceniris_gym.device.transforms import quat_mat
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.search import numbered_stream
from sceniris_gym.placement.kinematics import follow_joints, pose_bodies, write_root
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import Reach
from sceniris_gym.scene.parking import PARKING_COLUMNS, PARKING_FROM, PARKING_SPACING

OPEN = wp.constant(2)
"""Value of `present` for a member of a group that may be drawn, until its group is drawn."""


@wp.func
def draw_members(
    program: Program,
    worldid: int,
    seed: wp.uint64,
    episode: int,
    split: wp.uint32,
    g: int,
    present: wp.array[int],
):
    """Draw the present members of a group among its members that are `OPEN`.

    The number of members is drawn uniformly from the group's interval, and cut to the members that are `OPEN`. Then
    members are drawn without replacement: all sets are equally likely, or each member is drawn with the weights of the
    members that remain.
    """
    stream = numbered_stream(split, GROUP_STREAM)
    column = int(split % wp.uint32(2))  # the splits 'eval' and 'eval_bank' have odd numbers
    group = program.group[worldid, g]
    able = int(0)
    total = float(0.0)
    for i in range(group[0], group[0] + group[1]):
        if present[program.group_slot[i]] == OPEN:
            able += 1
            total += program.group_weight[worldid, i][column]
    left = group[2] + int(uniforms(seed, episode, stream, g, 0)[0] * float(group[3] - group[2] + 1))
    left = wp.min(wp.min(left, group[3]), able)
    if program.group_uniform[worldid, g]:
        # selection sampling: D. Knuth, "The Art of Computer Programming", vol. 2, algorithm 3.4.2 S
        for i in range(group[1]):
            slot = program.group_slot[group[0] + i]
            if present[slot] == OPEN:
                u = uniforms(seed, episode, stream, g, 1 + i // 4)[i % 4]
                present[slot] = int(u * float(able) < float(left))
                left -= present[slot]
                able -= 1
    for k in range(left):
        u = uniforms(seed, episode, stream, g, 1 + k // 4)[k % 4]
        at = u * total
        chosen = int(0)
        below = float(0.0)  # sum of the weights before, not a difference, so that all devices round in the same way
        for i in range(group[0], group[0] + group[1]):
            if present[program.group_slot[i]] == OPEN:
                if below <= at:
                    chosen = i
                below += program.group_weight[worldid, i][column]
        present[program.group_slot[chosen]] = 1
        total = below - program.group_weight[worldid, chosen][column]
    for i in range(group[0], group[0] + group[1]):
        if present[program.group_slot[i]] == OPEN:
            present[program.group_slot[i]] = 0


@wp.func
def is_drawn(program: Program, worldid: int, split: wp.uint32, member: int) -> bool:
    """Return whether a split may draw a member of a group, given by its index in `group_slot`."""
    return program.group_weight[worldid, member][int(split % wp.uint32(2))] > 0.0


@wp.func
def draw_groups(
    program: Program, worldid: int, seed: wp.uint64, episode: int, split: wp.uint32, present: wp.array[int]
):
    """Draw the present objects of each group.

    The draw belongs to the episode, not to a restart. Otherwise restarts would favour few objects, which are easier to
    place.
    """
    for g in range(program.ngroup):
        group = program.group[worldid, g]
        for i in range(group[0], group[0] + group[1]):
            present[program.group_slot[i]] = wp.where(is_drawn(program, worldid, split, i), OPEN, 0)
        draw_members(program, worldid, seed, episode, split, g, present)


@wp.func
def _park_absent(program: Program, layouts: LayoutsView, row: int, obj: int):
    """Park an absent object above the ground plane, with its joints in the home pose."""
    qpos = layouts.qpos[row]
    for i in range(program.obj_drawadr[obj], program.obj_drawadr[obj] + program.obj_drawnum[obj]):
        adr = program.draw_qposadr[i]
        qpos[adr] = program.home_qpos[adr]
    follow_joints(program, obj, qpos)
    stable = program.obj_stableadr[obj]
    slot = program.obj_slot[obj]
    x = PARKING_FROM + PARKING_SPACING * float(slot % PARKING_COLUMNS)
    y = PARKING_FROM + PARKING_SPACING * float(slot // PARKING_COLUMNS)
    pivot = wp.vec3(x, y, program.obj_gap[obj])
    quat = wp.normalize(program.stable_quat[stable])
    pos = pivot - quat_mat(quat) * program.stable_pivot[stable]
    root = program.obj_body[obj]
    layouts.body_pos[row, root] = pos
    layouts.body_quat[row, root] = quat
    pose_bodies(program, obj, 1, qpos, layouts.body_pos[row], layouts.body_quat[row])
    if program.obj_column[obj] == slot:  # an absent variant does not overwrite the place of the present variant
        layouts.pivot_pose[row, slot] = wp.vec4(pivot[0], pivot[1], pivot[2], 0.0)
        layouts.bounds[row, slot] = program.stable_bounds[stable]
    write_root(program, obj, pos, quat, qpos, layouts.mocap_pos[row], layouts.mocap_quat[row])


@wp.func
def next_object(program: Program, reach: Reach, layouts: LayoutsView, row: int, obj: int) -> int:
    """Return the first present object from `obj` on, and park the absent objects before it."""
    found = int(obj)
    while found < program.nobject and layouts.present[row, program.obj_slot[found]] == 0:
        _park_absent(program, layouts, row, found)
        if reach.obj_reach.shape[0] > 0:
            if reach.obj_reach[found] >= 0:
                layouts.grasp[row, reach.obj_reach[found]] = -1
        found += 1
    return found
