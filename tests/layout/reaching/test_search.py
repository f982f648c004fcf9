"""The state of a search for joints: room for candidates, and the steps that each of them takes."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from sceniris_gym.config.tier import Tier
from sceniris_gym.layout.reaching.search import (
    MOST_AT_ONCE,
    STARTS,
    ReachSearch,
    ReachStep,
    create_reach_search,
    first_start,
    takes_step,
)
from sceniris_gym.layout.wave.search import default_size
from tests.layout.grasped import cluttered


def test_the_room_for_candidates_is_bounded_by_what_rows_can_use(tmp_path: Path):
    """Each candidate has two poses of the robot: there are no more than the size says, nor than a row has in a wave."""
    compiled = cluttered(tmp_path, "ik")
    size = replace(default_size("cpu"), grasps=1000)
    for nrow, room in ((1, MOST_AT_ONCE), (3, 1000), (1000, 1000)):
        search = create_reach_search(compiled, nrow, size)
        assert search.failed.shape == (room,)
        assert search.body_pos.shape == (2 * room, compiled.mjm.nbody)


@wp.kernel(enable_backward=False)
def _take(reach_search: ReachSearch, step: int, taken_out: wp.array[bool], first_out: wp.array[int]):
    c = wp.tid()
    taken_out[c] = takes_step(reach_search, c, step)
    first_out[c] = first_start(reach_search, c)


def _search(failed: list[int], start: list[int], row: list[int], first: list[int]) -> ReachSearch:
    """Return a search with these candidates; the target of every row is the first."""
    search = ReachSearch()  # pyrefly: ignore[missing-argument]
    columns = {"failed": failed, "ik_start": start, "row": row, "first": first, "column": [0] * len(first)}
    for name, values in columns.items():
        setattr(search, name, wp.array(values, dtype=int, device="cpu"))
    return search


def _launch(search: ReachSearch, tier: Tier, step: ReachStep) -> tuple[np.ndarray, np.ndarray]:
    """Return for each candidate if it takes a step, and the candidate of its grasp's first start."""
    search.tier = wp.array(np.full((search.first.shape[0], 1), int(tier)), dtype=int, device="cpu")
    num = search.failed.shape[0]
    taken, first = wp.zeros(num, dtype=bool, device="cpu"), wp.zeros(num, dtype=int, device="cpu")
    wp.launch(_take, dim=num, inputs=[search, int(step)], outputs=[taken, first], device="cpu")
    return taken.numpy(), first.numpy()


@pytest.mark.parametrize("tier", [Tier.IK, Tier.CLEAR])
@pytest.mark.parametrize("step", [step for step in ReachStep if ReachStep.DEFERRED < step < ReachStep.PASSED])
def test_a_candidate_takes_the_steps_of_its_tier_until_it_fails(tier: Tier, step: ReachStep):
    """`ik` has three steps, and the first start of a grasp alone takes those before the inverse kinematics."""
    cases = list(product(ReachStep, (0, 1, STARTS - 1)))
    search = _search([int(f) for f, _ in cases], [s for _, s in cases], [0] * len(cases), [0])
    of_tier = tier == Tier.CLEAR or step in (ReachStep.MAP, ReachStep.IK_AT_GRASP, ReachStep.SELF_AT_GRASP)
    of_grasp = step in (ReachStep.MAP, ReachStep.HAND_AT_GRASP, ReachStep.HAND_AT_PREGRASP, ReachStep.HAND_AND_TARGET)
    expected = [of_tier and failed >= step and (start == 0 or not of_grasp) for failed, start in cases]
    assert _launch(search, tier, step)[0].tolist() == expected


def test_the_first_start_of_a_grasp_is_found_within_its_wave():
    """A row whose wave begins with start 5 of a grasp has tested that grasp before; its next grasp begins here."""
    starts = [5, 6, 7, 0, 1, 0, 1, 2]
    search = _search([11] * 8, starts, [1, 1, 1, 1, 1, 0, 0, 0], [5, 0])
    assert _launch(search, Tier.IK, ReachStep.MAP)[1].tolist() == [-1, -1, -1, 3, 3, 5, 5, 5]
