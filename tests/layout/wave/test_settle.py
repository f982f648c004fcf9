"""The end of a round: whose layout and whose counts a world takes, and which worlds go on."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Status
from sceniris_gym.layout.wave.rounds import NEVER, launch_start
from sceniris_gym.layout.wave.search import default_size
from sceniris_gym.layout.wave.settle import launch_settle
from tests.layout.scenes import box_mjcf, compile_on_cpu

RESTARTS = 5


def test_a_world_takes_the_lowest_restart_that_is_done(tmp_path: Path):
    """With attempts and rejections up to it; the others go on while they have restarts left, and then fall back."""
    crate = {"asset": box_mjcf(tmp_path, "crate", 0.1, 0.1, 0.05), "on": "floor"}
    words = {"floor": {"size": [1.0, 1.0]}, "restarts": RESTARTS, "objects": {"crate": crate}}
    work = LayoutGenerator(compile_on_cpu(words, bank=8), 4, size=replace(default_size("cpu"), rows=8))._work
    layouts, search = work.layouts, work.search
    launch_start(work, None)
    search.restarts_at_once.fill_(3)
    search.restart.assign([0, 0, 1, 3])
    search.best.assign([0, 2, NEVER, NEVER])
    rows = [[0, 4, 5], [1, 6, 7], [2, 8, 9], [3, 10, 11]]
    assert search.ticket.numpy().tolist() == [0, 1, 2, 3]
    search.row_attempts.assign(1 << np.arange(12))
    state = np.zeros(layouts.qpos.shape, np.float32)
    state[:, 3] = 1.0
    state[:, 0] = 0.01 * np.arange(12)
    layouts.qpos.assign(state)
    counts = np.zeros(layouts.row_rejections.shape, np.int32)
    counts[:, 0, 2] = 1 << np.arange(12)
    layouts.row_rejections.assign(counts)
    search.waiting.fill_(True)
    launch_settle(work)

    tried = [sum(1 << row for row in rows[world][:number]) for world, number in enumerate((1, 3, 3, 3))]
    assert layouts.attempts.numpy().tolist() == tried
    assert layouts.row_rejections.numpy()[:4, 0, 2].tolist() == tried
    assert layouts.status.numpy().tolist()[:2] == [Status.VALID, Status.VALID]
    assert layouts.status.numpy()[3] == Status.FALLBACK
    assert layouts.qpos.numpy()[:3, 0].tolist() == state[[0, 7, 2], 0].tolist()
    assert layouts.first_pass_valid.numpy()[:2].tolist() == [1, 0]
    assert search.pending.numpy().tolist() == [False, False, True, False]
    assert (search.restart.numpy()[2], search.best.numpy()[2]) == (4, NEVER)
    assert not search.waiting.numpy().any()
