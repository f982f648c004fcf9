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
    fail_grasp,
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
def _take(reach_search: ReachSearch, step: int, taken_out: wp.array[bool]):
    c = wp.tid()
    taken_out[c] = takes_step(reach_search, c, step)


@wp.kernel(enable_backward=False)
def _fail(reach_search: ReachSearch, c: int, step: int):
    fail_grasp(reach_search, c, step)


def _search(failed: list[int], start: list[int], row: list[int], first: list[int], trials: list[int]) -> ReachSearch:
    """Return a search with these candidates; the target of every row is the first."""
    search = ReachSearch()  # pyrefly: ignore[missing-argument]
    columns = {"failed": failed, "ik_start": start, "row": row, "first": first, "column": [0] * len(first)}
    columns["trials"] = trials
    for name, values in columns.items():
        setattr(search, name, wp.array(values, dtype=int, device="cpu"))
    return search


def _taken(search: ReachSearch, tier: Tier, step: ReachStep) -> list[bool]:
    """Return for each candidate if it takes a step."""
    search.tier = wp.array(np.full((search.first.shape[0], 1), int(tier)), dtype=int, device="cpu")
    num = search.failed.shape[0]
    taken = wp.zeros(num, dtype=bool, device="cpu")
    wp.launch(_take, dim=num, inputs=[search, int(step)], outputs=[taken], device="cpu")
    return taken.numpy().tolist()


@pytest.mark.parametrize("tier", [Tier.IK, Tier.CLEAR])
@pytest.mark.parametrize("step", [step for step in ReachStep if ReachStep.DEFERRED < step < ReachStep.PASSED])
def test_a_candidate_takes_the_steps_of_its_tier_until_it_fails(tier: Tier, step: ReachStep):
    """`ik` has three steps, and the first start of a grasp alone takes those before the inverse kinematics."""
    cases = list(product(ReachStep, (0, 1, STARTS - 1)))
    search = _search([int(f) for f, _ in cases], [s for _, s in cases], [0] * len(cases), [0], [len(cases)])
    of_tier = tier == Tier.CLEAR or step in (ReachStep.MAP, ReachStep.IK_AT_GRASP, ReachStep.SELF_AT_GRASP)
    of_grasp = step in (ReachStep.MAP, ReachStep.HAND_AT_GRASP, ReachStep.HAND_AT_PREGRASP, ReachStep.HAND_AND_TARGET)
    expected = [of_tier and failed >= step and (start == 0 or not of_grasp) for failed, start in cases]
    assert _taken(search, tier, step) == expected


def test_a_grasp_fails_with_all_of_its_starts_in_the_wave():
    """Row 1 has starts 5 to 7 of a grasp and two of the next one, and row 0 three. A step that fails earlier stays."""
    starts, rows = [5, 6, 7, 0, 1, 0, 1, 2], [1, 1, 1, 1, 1, 0, 0, 0]
    search = _search([11, 11, 11, 11, 2, 11, 11, 4], starts, rows, [5, 0], [3, 5])
    for c, step in ((3, 3), (5, 1)):
        wp.launch(_fail, dim=1, inputs=[search, c, step], device="cpu")
    assert search.failed.numpy().tolist() == [11, 11, 11, 3, 2, 1, 1, 1]
