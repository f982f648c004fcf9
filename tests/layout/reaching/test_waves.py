"""Grasps and starts in waves: a row's candidates are its next ones, and the lowest that passes is kept."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.layout.reaching import waves as reach_waves
from sceniris_gym.layout.reaching.search import MOST_AT_ONCE, STARTS, ReachStep
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.grasped import cluttered, waiting

N = 60


@pytest.fixture(scope="module", params=["ik", "clear"])
def compiled(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """The cluttered scene for both tiers."""
    return cluttered(tmp_path_factory.mktemp(request.param), request.param)


@pytest.mark.parametrize(("busy", "grasps"), [(1, 512), (1, 7), (200, 512), (4096, 4096), (4096, 100)])
def test_candidates_are_the_next_starts_as_far_as_there_is_room(compiled: CompiledScene, busy: int, grasps: int):
    """One for each row, more where they are few or where many were tried in vain; from the world's next one on."""
    generator, stage = waiting(compiled, N, busy=busy, grasps=grasps)
    layouts = generator.layouts
    search, reach = stage.search, stage._arms[0][0]
    number = np.arange(N) % 5
    search.number.assign(number)
    search.tried.assign(4 * number)
    reach_waves.launch_open_wave(generator._work, reach, search)
    room = np.minimum(np.where((number > 0) & (busy > 8 * N), 2, 1) * busy, grasps)
    at_once = np.clip(room // N, 1, MOST_AT_ONCE)
    first, trials = search.first.numpy(), search.trials.numpy()
    begin = reach.reach_graspadr.numpy()[0] + layouts.grasp.numpy()[:, 0]
    stable = layouts.view.stable.numpy()[:N, 0]
    end = reach.stable_graspadr.numpy()[stable] + reach.stable_graspnum.numpy()[stable]
    wanted = np.minimum(np.maximum(at_once, 2 * number), STARTS * (end - begin) - number)
    assert trials.sum() == min(wanted.sum(), grasps)
    assert (trials <= wanted).all()
    assert (trials == wanted).all() or trials.sum() == grasps
    row, grasp, start = search.row.numpy(), search.grasp.numpy(), search.ik_start.numpy()
    for i in range(N):
        mine = slice(first[i], first[i] + trials[i])
        assert (row[mine] == i).all()
        assert (STARTS * (grasp[mine] - begin[i]) + start[mine] == number[i] + np.arange(trials[i])).all()


def test_the_lowest_candidate_that_passes_is_kept(compiled: CompiledScene):
    """Of a wave of 24 starts a row: joints of the first; other rows go on after the last start that was tested."""
    generator, stage = waiting(compiled, N, busy=24 * N, grasps=24 * N)
    layouts = generator.layouts
    search = stage.search
    stage._wave(*stage._arms[0])
    assert (search.trials.numpy() == 24).all()
    order = (search.first.numpy()[:, None] + np.arange(24)).ravel()
    failed, start = (getattr(search, name).numpy()[order].reshape(N, 24) for name in ("failed", "ik_start"))
    grasp = search.grasp.numpy()[order].reshape(N, 24) - stage._arms[0][0].reach_graspadr.numpy()[0]
    joints = search.grasp_qpos.numpy()[order].reshape(N, 24, -1)
    passed = failed == ReachStep.PASSED
    kept = passed.any(axis=1)
    which = passed.argmax(axis=1)
    assert N // 3 < kept.sum() < N
    assert (search.column.numpy() == kept).all()
    rows = np.flatnonzero(kept)
    assert (layouts.grasp.numpy()[rows, 0] == grasp[rows, which[rows]]).all()
    assert (layouts.grasp_qpos.numpy()[rows, 0, :6] == joints[rows, which[rows], :6]).all()
    others = np.flatnonzero(~kept)
    tested = np.where((failed == ReachStep.DEFERRED).any(axis=1), (failed == ReachStep.DEFERRED).argmax(axis=1), 24)
    counted = np.arange(24) < tested[:, None]
    assert (search.furthest.numpy()[others] == np.where(counted, failed, -1)[others].max(axis=1)).all()
    assert (search.number.numpy()[others] == tested[others]).all()
    assert (search.tried.numpy()[others] == ((failed >= ReachStep.IK_AT_GRASP) & counted)[others].sum(axis=1)).all()
    # the arm is tested with the first joints that are found, and no others
    assert ((failed >= ReachStep.SELF_AT_GRASP).sum(axis=1) == (failed >= ReachStep.SELF_AT_GRASP).any(axis=1)).all()
    has_joints = (failed >= ReachStep.SELF_AT_GRASP) | (failed == ReachStep.DEFERRED)
    assert (has_joints.argmax(axis=1) == (failed >= ReachStep.SELF_AT_GRASP).argmax(axis=1)).all()
    # what is found of a grasp holds for all of its starts
    by_grasp = np.where(has_joints, ReachStep.PASSED, failed).reshape(N, 3, STARTS)
    assert (start.reshape(N, 3, STARTS) == np.arange(STARTS)).all()
    refused = by_grasp[:, :, 0] < ReachStep.IK_AT_GRASP
    assert (by_grasp[refused] == by_grasp[refused][:, :1]).all()
    assert (by_grasp[~refused] >= ReachStep.IK_AT_GRASP).all()


def test_the_other_starts_of_a_refused_grasp_are_not_tried(compiled: CompiledScene):
    """Its first start goes through the map and the hand's tests for all: the next candidate is of the next grasp."""
    _generator, stage = waiting(compiled, N, busy=1, grasps=512)
    search = stage.search
    stage._wave(*stage._arms[0])
    failed = search.failed.numpy()[search.first.numpy()]
    number = search.number.numpy()[search.column.numpy() == 0]
    failed = failed[search.column.numpy() == 0]
    assert (number == np.where(failed < ReachStep.IK_AT_GRASP, STARTS, 1)).all()
    assert (failed != ReachStep.PASSED).all()
