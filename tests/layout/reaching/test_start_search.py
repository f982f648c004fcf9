"""The queue of the start stage: worlds whose arm leaves its start pose, more trials of each where few are left."""

from __future__ import annotations

import numpy as np

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.reaching.start_search import TRIALS, create_start_search, launch_plan_wave, launch_queue_worlds
from tests.layout.starting import HOME, PLACED, starting


def test_worlds_that_start_at_home_are_not_queued():
    """All other worlds are, once each, and share the candidates of a wave."""
    generator, starts = LayoutGenerator(starting(), 40, seed=1), starting().starts
    generator.generate()
    work = generator._work
    assert starts is not None
    search = create_start_search(starting(), work)
    work.search.pending.fill_(True)
    launch_queue_worlds(work, starts, search)
    launch_plan_wave(work, search)
    kinds, num = generator.layouts.start.numpy(), int(search.num.numpy()[0])
    queued = search.queue.numpy()[int(search.source.numpy()[0]), :num]
    np.testing.assert_array_equal(np.sort(queued), np.flatnonzero(~np.isin(kinds, (HOME, PLACED))))
    assert 1 <= int(search.at_once.numpy()[0]) <= TRIALS
    assert num * int(search.at_once.numpy()[0]) <= search.passed.shape[0]
