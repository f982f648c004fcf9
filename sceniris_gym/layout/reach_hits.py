"""The posed robots of candidates against a list of pairs, a block for each candidate."""

import warp as wp

from sceniris_gym.layout.boxes import SHARED_STACK, WAITING, collides
from sceniris_gym.layout.containment import encloses
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.reach_search import ReachSearch, Step, reach_candidate_num, takes_step
from sceniris_gym.layout.search import SearchSize
from sceniris_gym.program.device import Program
from sceniris_gym.program.device_reach import Reach

wp.set_module_options({"enable_backward": False})


@wp.kernel(grid_stride=False, cuda_max_registers=128)
def _test(
    program: Program,
    reach: Reach,
    step: int,
    tests: wp.array(dtype=int),
    blocks: int,
    layouts: LayoutsView,
    # Search in and out:
    search: ReachSearch,
):
    block, lane = wp.tid()
    nodes = wp.tile_stack(capacity=wp.static(SHARED_STACK), dtype=wp.vec3i)
    leaves = wp.tile_stack(capacity=wp.static(WAITING), dtype=wp.vec3i)
    for c in range(block, reach_candidate_num(search), blocks):
        if not takes_step(reach, search, c, step):
            continue
        worldid = search.world[c]
        pairs = tests[search.column[worldid]]
        startadr = program.arm_startadr[pairs]
        startnum = program.arm_startnum[pairs]
        own_pos = search.body_pos[c]
        own_quat = search.body_quat[c]
        pos = layouts.body_pos[worldid]
        quat = layouts.body_quat[worldid]
        hit = collides(program, startadr, startnum, -1, nodes, leaves, lane, own_pos, own_quat, pos, quat)
        if lane == 0 and hit:  # all lanes have read what is written here
            search.failed[c] = step


@wp.kernel(grid_stride=False)
def _test_containment(
    program: Program,
    reach: Reach,
    step: int,
    tests: wp.array(dtype=int),
    blocks: int,
    layouts: LayoutsView,
    # Search in and out:
    search: ReachSearch,
):
    block, lane = wp.tid()
    for c in range(block, reach_candidate_num(search), blocks):
        if not takes_step(reach, search, c, step):
            continue
        worldid = search.world[c]
        pairs = tests[search.column[worldid]]
        pairadr = program.arm_pairadr[pairs]
        pairnum = program.arm_pairnum[pairs]
        own_pos = search.body_pos[c]
        own_quat = search.body_quat[c]
        pos = layouts.body_pos[worldid]
        quat = layouts.body_quat[worldid]
        inside = encloses(program, pairadr, pairnum, lane, own_pos, own_quat, pos, quat)
        if lane == 0 and inside:  # all lanes have read what is written here
            search.failed[c] = step


def launch_test_arm(
    program: Program,
    reach: Reach,
    step: Step,
    tests: wp.array,
    size: SearchSize,
    layouts: LayoutsView,
    search: ReachSearch,
    device: str,
) -> None:
    """Test the candidates that have come to a step against the list of pairs that `tests` names for their target."""
    inputs = [program, reach, int(step), tests, size.blocks, layouts]
    words = {"dim": [size.blocks], "outputs": [search], "block_dim": size.block_dim, "device": device}
    wp.launch_tiled(_test, inputs=inputs, **words)
    if program.faces:
        wp.launch_tiled(_test_containment, inputs=inputs, **words)
