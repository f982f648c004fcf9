"""Restarts and trials that run at once: as many as there is room for, at least one, never beyond the last."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.wave import rounds
from sceniris_gym.layout.wave import search as search_module
from sceniris_gym.layout.wave.draw import begin_wave
from sceniris_gym.layout.wave.search import (
    MANY_ROWS,
    Search,
    SearchSize,
    create_search,
    default_size,
    queue_row,
    suited_size,
)
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.program.device import Program, copied
from tests.layout.scenes import box_mjcf, compile_on_cpu

ATTEMPTS, RESTARTS = 6, 9


@wp.kernel(enable_backward=False)
def _begin(search: Search):
    begin_wave(search)


@wp.kernel(enable_backward=False)
def _queue(program: Program, rows: wp.array[int], ahead: int, search: Search):
    queue_row(program, search, rows[wp.tid()], ahead)


@pytest.fixture(scope="module")
def tray(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """Three crates on a tray with little room."""
    folder: Path = tmp_path_factory.mktemp("tray")
    crate = box_mjcf(folder, "crate", 0.1, 0.1, 0.05)
    objects = {f"crate_{i}": {"asset": crate, "on": "floor", "orientation": "fixed"} for i in range(3)}
    words = {"floor": {"size": [0.2, 0.2]}, "attempts": ATTEMPTS, "restarts": RESTARTS, "objects": objects}
    return compile_on_cpu(words, bank=8)


def _wanted(worlds: float, left: float, rate: float) -> int:
    """Return the number of restarts that leave so many worlds, by the share of restarts that fail."""
    return math.ceil(math.log(worlds / left) / -math.log(rate))


@pytest.mark.parametrize(("staged", "left"), [(False, 0.5), (True, 0.01)])
@pytest.mark.parametrize("rows", [0, 1, 7, 100, 5000])
def test_restarts_at_once_have_rows_of_their_own(tray: CompiledScene, rows: int, staged: bool, left: float):
    """For any number of worlds that are left: the last row of the last world exists, and no more are of use."""
    search = create_search(tray, 100, replace(default_size("cpu"), rows=rows))
    for worlds in (1, 2, 3, 10, 33, 100):
        search.worlds_left.fill_(worlds)
        search.restarts_at_once.zero_()
        inputs = [tray.program, staged, 1000]
        wp.launch(rounds._plan_round, dim=1, inputs=inputs, outputs=[search], device="cpu")
        at_once, rate = int(search.restarts_at_once.numpy()[0]), tray.program.restart_rate
        most = min(_wanted(worlds, left, rate), RESTARTS + 1)
        assert 1 <= at_once <= most
        assert worlds * (at_once - 1) <= rows
        failing = worlds * rate
        enough = failing > left and failing * _wanted(failing, left, rate) <= rows
        if enough and _wanted(worlds, left, rate) > rows // worlds + 1:
            assert at_once == 1  # the next round has room for all that fail
        else:
            assert worlds * at_once > rows or at_once == most
        assert search.worlds_left.numpy()[0] == 0


def test_later_rounds_try_twice_as_much(tray: CompiledScene):
    """Too few restarts for a world are doubled; a scene with a stage tries once where that keeps all lanes busy."""
    search = create_search(tray, 100, replace(default_size("cpu"), rows=5000))
    tried = []
    for staged, worlds, busy, before in ((False, 1, 1000, 0), (False, 1, 1000, 2), (True, 100, 200, 0)):
        search.worlds_left.fill_(worlds)
        search.restarts_at_once.fill_(before)
        wp.launch(rounds._plan_round, dim=1, inputs=[tray.program, staged, busy], outputs=[search], device="cpu")
        tried.append(int(search.restarts_at_once.numpy()[0]))
    risky = 2048 * tray.program.restart_rate**4 > 1  # see the test below
    assert tried[1] == min(4 + risky, RESTARTS + 1)
    assert tried[1] > tried[0]
    assert tried[2] == 1


@pytest.mark.parametrize("worlds", [200, 569, 2258])
@pytest.mark.parametrize("rate", [0.0271, 0.0659, 0.1434])
def test_a_later_round_weighs_more_restarts_against_the_risk_of_another_round(
    tray: CompiledScene, worlds: int, rate: float
):
    """A round costs as much as 2048 rows, and leaves half a world at most."""
    program = copied(Program, tray.program)
    program.restart_rate = rate
    search = create_search(tray, 6000, replace(default_size("cpu"), rows=1 << 15))
    search.worlds_left.fill_(worlds)
    search.restarts_at_once.fill_(1)
    wp.launch(rounds._plan_round, dim=1, inputs=[program, False, 1000], outputs=[search], device="cpu")
    wanted = next(n for n in range(2, 20) if worlds * rate**n <= 0.5)
    best = min((wanted, wanted + 1), key=lambda n: worlds * n + 2048 * worlds * rate**n)
    assert int(search.restarts_at_once.numpy()[0]) == best


@pytest.mark.parametrize(("worlds", "times"), [(1, 1), (MANY_ROWS - 1, 1), (MANY_ROWS, 2)])
def test_rows_of_a_round_and_not_worlds_of_the_batch_decide_how_much_is_drawn(
    tray: CompiledScene, monkeypatch: pytest.MonkeyPatch, worlds: int, times: int
):
    """A reset of few worlds draws as much in a large batch as in a small one."""
    monkeypatch.setattr(search_module, "default_size", lambda device: SearchSize())
    busy = suited_size(tray, 1).busy
    assert all(suited_size(tray, nworld).busy == busy for nworld in (4096, 65_536, 524_288))
    search = create_search(tray, MANY_ROWS, replace(default_size("cpu"), rows=0))
    search.worlds_left.fill_(worlds)
    wp.launch(rounds._plan_round, dim=1, inputs=[tray.program, False, busy], outputs=[search], device="cpu")
    assert search.rows.numpy()[0] == worlds
    assert search.busy.numpy()[0] == times * busy


@pytest.mark.parametrize("candidates", [3, 64, 512])
@pytest.mark.parametrize("busy", [1, 7, 64, 4096])
def test_candidates_fit_into_a_wave(tray: CompiledScene, busy: int, candidates: int):
    """Those of a row are its next trials, one after the other, none beyond its last; rows without room have none."""
    size = replace(default_size("cpu"), candidates=candidates, busy=busy)
    search = LayoutGenerator(tray, 1000, size=size)._work.search
    trial = np.arange(1000) % ATTEMPTS
    search.row_trial.assign(trial)
    search.busy.fill_(busy)
    for number in (1, 2, 3, 10, 63, 64, 65, 1000):
        source = int(search.source.numpy()[0])
        search.opened.zero_()
        search.rows.fill_(number)
        rows = np.random.default_rng(number).permutation(1000)[:number]
        inputs = [tray.program, wp.array(rows, dtype=int, device="cpu"), 0]
        wp.launch(_queue, dim=number, inputs=inputs, outputs=[search], device="cpu")
        assert search.queue.numpy()[1 - source, :number].tolist() == rows.tolist()
        first, trials = search.row_first.numpy()[rows], search.row_trials.numpy()[rows]
        assert (trials <= ATTEMPTS - trial[rows]).all()
        assert trials.sum() == min(search.opened.numpy()[0], candidates)
        assert (trials > 0).all() or trials.sum() == candidates
        of, turn = search.row.numpy(), search.trial.numpy()
        for row, a, n in zip(rows, first, trials, strict=True):
            assert (of[a : a + n] == row).all()
            assert (turn[a : a + n] == trial[row] + np.arange(n)).all()
        wp.launch(_begin, dim=1, outputs=[search], device="cpu")
        assert search.rows.numpy()[0] == number
        assert search.candidates.numpy()[0] == search.opened.numpy()[0]
        assert search.source.numpy()[0] == 1 - source
        assert search.rows_left.numpy()[0] == search.narrow_pairs.numpy()[0] == 0


@pytest.mark.parametrize("room", [0, 1, 2, 3, 4, 8, 100])
def test_objects_ahead_have_a_candidate_each_in_front_of_the_trials(tray: CompiledScene, room: int):
    """As far as there is room; the first that has none is the object of the row, without trials in this wave."""
    search = LayoutGenerator(tray, 1, size=replace(default_size("cpu"), candidates=100, busy=4096))._work.search
    search.opened.fill_(100 - room)
    search.row_object.fill_(2)
    search.busy.fill_(4096)
    rows = wp.zeros(1, dtype=int, device="cpu")
    wp.launch(_queue, dim=1, inputs=[tray.program, rows, 2], outputs=[search], device="cpu")
    names = ("row_object", "row_ahead", "row_first", "row_trials")
    obj, ahead, first, trials = (int(getattr(search, name).numpy()[0]) for name in names)
    assert (obj, ahead, trials) == (min(room, 2), min(room, 2), min(max(room - 2, 0), ATTEMPTS))
    assert first == 100 - room + ahead
    drawn = slice(first - ahead, first + trials)
    assert search.obj.numpy()[drawn].tolist() == [*range(ahead), *[2] * trials]
    assert search.trial.numpy()[drawn].tolist() == [*[0] * ahead, *range(trials)]


def test_the_first_restart_that_places_everything_is_the_layout(tray: CompiledScene):
    """Each world alone, one restart at a time: as many candidates as it draws, and whether it needed a restart."""
    size = replace(default_size("cpu"), rows=500, busy=4096, candidates=4096)
    many = LayoutGenerator(tray, 50, seed=3, size=size)
    many.generate()
    for i in range(50):
        one = LayoutGenerator(tray, 1, seed=3 + i)
        one.generate()
        for name in ("qpos", "attempts", "first_pass_valid", "status"):
            assert (getattr(one.layouts, name).numpy()[0] == getattr(many.layouts, name).numpy()[i]).all()
    first = many.layouts.first_pass_valid.numpy()
    assert 0 < first.sum() < 50
    assert (many.layouts.attempts.numpy()[first == 1] <= 3 * ATTEMPTS).all()
    assert (many.layouts.status.numpy()[first == 1] == LayoutStatus.VALID).all()
    assert many.layouts.attempts.numpy().max() > 3 * ATTEMPTS
