"""Grasps and starts in waves: a world's candidates are its next ones, and the lowest that passes is kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.reaching import waves as reach_waves
from sceniris_gym.layout.reaching.search import MOST_AT_ONCE, STARTS, ReachStep, create_reach_search
from sceniris_gym.layout.wave.search import default_size
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.grasped import cluttered

N = 60


@pytest.fixture(scope="module", params=["ik", "clear"])
def compiled(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """The cluttered scene for both tiers."""
    return cluttered(tmp_path_factory.mktemp(request.param), request.param)


def placed(compiled: CompiledScene, **words: int) -> LayoutGenerator:
    """Worlds that wait for joints, and have been given their first column."""
    generator = LayoutGenerator(compiled, N, seed=3, size=replace(default_size("cpu"), **words))
    generator.launch_placing(None)
    stage, view = generator._stage, generator.layouts.view
    assert stage is not None
    reach_waves.launch_open_worlds(stage._arms[0][0], view, generator._search, stage.search, "cpu")
    return generator


@pytest.mark.parametrize(("busy", "grasps"), [(1, 512), (1, 7), (200, 512), (4096, 4096), (4096, 100)])
def test_candidates_are_the_next_starts_as_far_as_there_is_room(compiled: CompiledScene, busy: int, grasps: int):
    """One for each world, more where they are few or where many were tried in vain; from the world's next one on."""
    generator = placed(compiled, busy=busy, grasps=grasps)
    stage, layouts = generator._stage, generator.layouts
    assert stage is not None
    search, reach = stage.search, stage._arms[0][0]
    number = np.arange(N) % 5
    search.number.assign(number)
    search.tried.assign(4 * number)
    reach_waves.launch_open_wave(reach, generator.size, layouts.view, search, "cpu")
    at_once = min(max(1, min(busy, grasps) // N), MOST_AT_ONCE)
    first, trials = search.first.numpy(), search.trials.numpy()
    begin = reach.reach_graspadr.numpy()[0] + layouts.grasp.numpy()[:, 0]
    variant = layouts.view.variant.numpy()[:N, 0]
    end = reach.variant_graspadr.numpy()[variant] + reach.variant_graspnum.numpy()[variant]
    wanted = np.minimum(np.maximum(at_once, 2 * number), STARTS * (end - begin) - number)
    assert trials.sum() == min(wanted.sum(), grasps)
    assert (trials <= wanted).all()
    assert (trials == wanted).all() or trials.sum() == grasps
    world, grasp, start = search.world.numpy(), search.grasp.numpy(), search.start.numpy()
    for i in range(N):
        mine = slice(first[i], first[i] + trials[i])
        assert (world[mine] == i).all()
        assert (STARTS * (grasp[mine] - begin[i]) + start[mine] == number[i] + np.arange(trials[i])).all()
    assert search.worlds_left.numpy()[0] == 0


def test_the_lowest_candidate_that_passes_is_kept(compiled: CompiledScene):
    """Of a wave of 24 starts a world: joints of the first; other worlds go on after the last start that is of use."""
    generator = placed(compiled, busy=24 * N, grasps=24 * N)
    stage, layouts = generator._stage, generator.layouts
    assert stage is not None
    search = stage.search
    stage._wave(*stage._arms[0], layouts.view, generator._search)
    assert (search.trials.numpy() == 24).all()
    order = (search.first.numpy()[:, None] + np.arange(24)).ravel()
    failed, start = (getattr(search, name).numpy()[order].reshape(N, 24) for name in ("failed", "start"))
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
    assert (search.furthest.numpy()[others] == failed[others].max(axis=1)).all()
    assert (search.number.numpy()[others] == 24).all()
    assert (search.tried.numpy()[others] == (failed[others] >= ReachStep.IK_AT_GRASP).sum(axis=1)).all()
    # what is found of a grasp holds for all of its starts
    by_grasp = failed.reshape(N, 3, STARTS)
    assert (start.reshape(N, 3, STARTS) == np.arange(STARTS)).all()
    refused = by_grasp[:, :, 0] < ReachStep.IK_AT_GRASP
    assert (by_grasp[refused] == by_grasp[refused][:, :1]).all()
    assert (by_grasp[~refused] >= ReachStep.IK_AT_GRASP).all()


def test_the_other_starts_of_a_refused_grasp_are_not_tried(compiled: CompiledScene):
    """Its first start goes through the map and the hand's tests for all: the next candidate is of the next grasp."""
    generator = placed(compiled, busy=1, grasps=512)
    stage, layouts = generator._stage, generator.layouts
    assert stage is not None
    search = stage.search
    stage._wave(*stage._arms[0], layouts.view, generator._search)
    failed = search.failed.numpy()[search.first.numpy()]
    number = search.number.numpy()[search.column.numpy() == 0]
    failed = failed[search.column.numpy() == 0]
    assert (number == np.where(failed < ReachStep.IK_AT_GRASP, STARTS, 1)).all()
    assert (failed != ReachStep.PASSED).all()
    if compiled.config.objects["can"].reachable == "clear":
        assert (failed < ReachStep.IK_AT_GRASP).any()


def test_the_room_for_candidates_is_bounded_by_what_worlds_can_use(compiled: CompiledScene):
    """Each poses a robot: there are no more than the size says, nor than a world has in a wave."""
    size = replace(default_size("cpu"), grasps=1000)
    for nworld, room in ((1, MOST_AT_ONCE), (3, 3 * MOST_AT_ONCE), (1000, 1000)):
        search = create_reach_search(compiled, nworld, size)
        assert search.failed.shape == (room,)
        assert search.body_pos.shape == (room, compiled.mjm.nbody)
