"""`StartSearch`: the state of the start stage: a queue of worlds, and their candidates.

A *candidate* here is one trial of one world: a height or joints that are drawn, or the only pose that there is.
"""

from functools import partial

import warp as wp

from sceniris_gym.device.random import START_STREAM, uniforms
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.wave.rounds import NEVER, row_of_restart
from sceniris_gym.layout.wave.search import Search, Workspace, numbered_stream
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import allocate
from sceniris_gym.program.device_starts import StartPose, Starts
from sceniris_gym.reach.solve import vec8

wp.set_module_options({"enable_backward": False})

TRIALS = 64
"""Trials of a restart whose kind of start draws heights or joints."""
_AT_ONCE = 16
"""Most trials of a world in a wave; a single lane goes through them at the end."""


@wp.struct
class StartSearch:
    """The arrays of the start stage on the device."""

    queue: wp.array2d[int]  # worlds that go on: two lists, one read and one written
    trial: wp.array[int]  # the next trial of each world
    left: wp.array[int]
    source: wp.array[int]  # the list of `queue` that is read
    num: wp.array[int]  # number of worlds in this wave
    waiting: wp.array[int]  # number of worlds in that list
    at_once: wp.array[int]  # candidates of each
    # Candidates
    passed: wp.array[bool]
    grasp: wp.array[int]
    joints: wp.array[vec8]
    qpos: wp.array2d[float]
    body_pos: wp.array2d[wp.vec3]
    body_quat: wp.array2d[wp.vec4]


@wp.func
def start_row(search: Search, worldid: int) -> int:
    """Return the row of the restart that is done."""
    return row_of_restart(search, worldid, search.best[worldid] - search.restart[worldid])


@wp.func
def start_column(starts: Starts, layouts: LayoutsView, row: int, kind: int) -> int:
    """Return the reach target that is present of those that a kind may hold."""
    found = int(0)
    for column in range(starts.target.shape[1]):
        if starts.target[kind, column] and layouts.grasp[row, column] >= 0:
            found = column
    return found


@wp.func
def start_uniform(
    layouts: LayoutsView, search: Search, split: wp.uint32, worldid: int, trial: int, number: int
) -> float:
    """Return a uniform number of a trial of a world's restart."""
    seed, episode = layouts.pending_seed[worldid], layouts.pending_episode[worldid]
    restart = search.best[worldid]
    stream = numbered_stream(split, START_STREAM)
    return uniforms(seed, episode, stream, 1 + restart * wp.static(TRIALS) + trial, number // 4)[number % 4]


def create_start_search(compiled: CompiledScene, work: Workspace) -> StartSearch:
    """Allocate the arrays of the start stage."""
    ncand, mjm, s = min(work.size.grasps, work.nworld * _AT_ONCE), compiled.mjm, StartSearch()
    zeros = partial(allocate, StartSearch, s)
    with wp.ScopedDevice(compiled.device):
        zeros((2, work.nworld), "queue")
        zeros(work.nworld, "trial")
        zeros(1, "left source num waiting at_once")
        zeros(ncand, "passed grasp joints")
        zeros((ncand, mjm.nq), "qpos")
        zeros((ncand, mjm.nbody), "body_pos body_quat")
    return s


@wp.kernel
def _queue_worlds(
    starts: Starts,
    # Layouts in: start
    layouts: LayoutsView,
    # Search in: pending, best
    search: Search,
    # StartSearch in: left, source
    # StartSearch out: queue, trial, left
    start_search: StartSearch,
):
    worldid = wp.tid()
    if not search.pending[worldid] or search.best[worldid] == NEVER:
        return
    if starts.pose[layouts.start[worldid]] != StartPose.HOME:
        start_search.trial[worldid] = 0
        at = wp.atomic_add(start_search.left, 0, 1)
        start_search.queue[1 - start_search.source[0], at] = worldid


def launch_queue_worlds(work: Workspace, starts: Starts, start_search: StartSearch) -> None:
    """Queue the worlds whose restart is done and whose arm leaves its start pose."""
    work.launch(_queue_worlds, work.nworld, [starts], work.layouts, work.search, start_search)


@wp.kernel
def _plan_wave(
    busy: int,
    # StartSearch in: left, source, num
    # StartSearch out: left, source, num, waiting, at_once
    start_search: StartSearch,
):
    capacity = start_search.passed.shape[0]
    start_search.waiting[0] = start_search.left[0]
    start_search.num[0] = wp.min(start_search.left[0], capacity)
    start_search.at_once[0] = wp.clamp(wp.min(busy, capacity) // wp.max(start_search.num[0], 1), 1, wp.static(_AT_ONCE))
    start_search.source[0] = 1 - start_search.source[0]
    start_search.left[0] = 0


def launch_plan_wave(work: Workspace, start_search: StartSearch) -> None:
    """Begin a wave with the queued worlds, with more trials of each if few are left."""
    work.launch(_plan_wave, 1, [work.size.busy], start_search)
