"""Draw the present objects in scenes in which presence depends on the presence of other objects.

The draws run in the order of dependence. A slot is 1 while its object may still be present, and in the end if it is. In
a scene without conditions, `draw_groups` suffices, and this kernel is not launched.
"""

import warp as wp

from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.masks import selects
from sceniris_gym.layout.wave.groups import OPEN, draw_members, is_drawn
from sceniris_gym.layout.wave.search import Workspace
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_conditions import Conditions


@wp.func
def _mark(conditions: Conditions, member: int, value: int, present: wp.array[int]):
    """Set all slots of a member."""
    for i in range(conditions.member_leafnum[member]):
        present[conditions.leaf[conditions.member_leafadr[member] + i]] = value


@wp.func
def _may_be(conditions: Conditions, member: int, present: wp.array[int]) -> bool:
    """Return whether no outer group left a member out, and all its conditions hold."""
    if present[conditions.leaf[conditions.member_leafadr[member]]] == 0:
        return False
    for t in range(
        conditions.member_termadr[member], conditions.member_termadr[member] + conditions.member_termnum[member]
    ):
        found = int(0)
        for i in range(conditions.term_slotadr[t], conditions.term_slotadr[t] + conditions.term_slotnum[t]):
            if present[conditions.term_slot[i]] != 0:
                found = 1
        if found != conditions.term_holds[t]:
            return False
    return True


@wp.kernel(module="unique", module_options={"enable_backward": False, "fuse_fp": False}, grid_stride=False)
def _draw_presence(
    program: Program,
    conditions: Conditions,
    mask: wp.array[bool],
    split: wp.uint32,
    # Layouts in: pending*; both: present
    layouts: LayoutsView,
):
    worldid = wp.tid()
    if not selects(mask, worldid):
        return
    seed, episode = layouts.pending_seed[worldid], layouts.pending_episode[worldid]
    present = layouts.present[worldid]
    for i in range(conditions.leaf.shape[0]):
        present[conditions.leaf[i]] = 1
    for k in range(program.ngroup):
        g = conditions.order[k]
        group = program.group[worldid, g]
        for i in range(group[0], group[0] + group[1]):
            may_be = is_drawn(program, worldid, split, i) and _may_be(conditions, i, present)
            _mark(conditions, i, wp.where(may_be, OPEN, 0), present)
        draw_members(program, worldid, seed, episode, split, g, present)
        for i in range(group[0], group[0] + group[1]):
            _mark(conditions, i, present[program.group_slot[i]], present)


def launch_draw_presence(work: Workspace, mask: wp.array | None) -> None:
    """Draw the present objects of the masked worlds in a scene with conditions."""
    inputs = [work.program, work.compiled.conditions, mask, work.split, work.layouts]
    work.launch(_draw_presence, work.nworld, *inputs)
