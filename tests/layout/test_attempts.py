"""`attempts: auto`, and the law that attempts give layouts, against a quadrature of our own."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import FallbackWarning, InfeasibleSceneError
from sceniris_gym.layout.attempts import _still_failing, find_attempts
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.program.compiled import CompiledScene, upload_scene
from sceniris_gym.scene.build import build_model
from tests.layout.scenes import box_mjcf, compile_on_cpu, make, valid

HALF = 0.15  # half the length [m] of the line on which pivots lie
WIDTH = 0.1  # of a box [m]
NARROW = 0.103  # a line on which the second box always has a little room
APART = WIDTH + 0.001 + 5e-6  # least distance [m] of two pivots: with the clearance, and what covers rounding
BINS = 10


@pytest.fixture(scope="module")
def box(tmp_path_factory) -> str:
    """Return a box that is as wide as the line is thin: two of them have to lie beside each other."""
    return box_mjcf(tmp_path_factory.mktemp("law"), "box", WIDTH, 0.2, 0.05)


def _line(box: str, num: int, half: float = HALF, **words) -> dict:
    """A scene of some boxes on a line."""
    one = {"asset": box, "on": "floor", "orientation": "fixed", "region": {"box": [[-half, -1e-4], [half, 1e-4]]}}
    return {"floor": {"size": [1, 1]}, "objects": {f"box_{i}": one for i in range(num)}, **words}


def _law(num: int, attempts: int, cells: int = 1500) -> np.ndarray:
    """Probability of each bin for the first two boxes, shape (2, BINS), by quadrature over midpoints of cells.

    p(x1, x2) ~ s(q(x1)) * [x2 fits] / q(x1) * s(q(x1, x2)): uniform given those before, times the chance
    s(q) = 1 - (1 - q)^attempts that what comes next fits within its attempts, with q the free share of the line.
    """
    x = (np.arange(cells) + 0.5) / cells * 2 * HALF - HALF
    fits = np.abs(x[:, None] - x) >= APART
    first = fits.mean(axis=1)  # what the second box finds free
    if num == 2:
        then = np.ones((cells, cells))
    else:
        both = (fits.astype(float) @ fits.astype(float)) / cells  # what the third one finds free
        then = 1.0 - (1.0 - both) ** attempts
    density = fits * then * ((1.0 - (1.0 - first) ** attempts) / np.maximum(first, 1e-12))[:, None]
    density /= density.sum()
    return np.stack([density.sum(axis=axis).reshape(BINS, -1).sum(axis=1) for axis in (1, 0)])


def _p_value(x: np.ndarray, law: np.ndarray) -> float:
    counts = np.histogram(x, BINS, (-HALF, HALF))[0]
    return float(stats.chisquare(counts, law * len(x)).pvalue)


@pytest.mark.parametrize("attempts", [1, 10, 100])
@pytest.mark.parametrize("num", [2, 3])
def test_a_layout_follows_its_sequence_times_the_chance_that_the_rest_fits(box: str, num: int, attempts: int):
    """Two and three boxes on a line that they nearly fill; the last one of three is no wider than the gap it needs."""
    rows = valid(make(compile_on_cpu(_line(box, num, attempts=attempts, restarts=200)), 20_000, seed=3))
    assert len(rows.qpos) > 19_900
    law = _law(num, attempts)
    for i in range(2):
        assert _p_value(rows.qpos[:, 7 * i], law[i]) > 0.001


def test_no_object_is_plainly_uniform_where_the_rest_is_tight(box: str):
    """At ten attempts the first of three boxes is not: that statement alone would be wrong. One alone is."""
    for num, uniform in ((3, False), (1, True)):
        rows = valid(make(compile_on_cpu(_line(box, num, attempts=10, restarts=200)), 20_000, seed=3))
        assert (_p_value(rows.qpos[:, 0], np.full(BINS, 1 / BINS)) > 0.001) == uniform


def test_attempts_are_raised_until_hardly_a_world_restarts(box: str):
    """There is always room for the second box, though little: ten doubled a few times, and half of it would not do."""
    compiled = compile_on_cpu(_line(box, 2, NARROW, attempts="auto"))
    assert compiled.config.attempts == "auto"
    assert compiled.attempts in (40, 80, 160, 320)
    half, found = (
        make(compile_on_cpu(_line(box, 2, NARROW, attempts=n, restarts=0)), 20_000, seed=9).status != LayoutStatus.VALID
        for n in (compiled.attempts // 2, compiled.attempts)
    )
    assert half.mean() > 0.008
    assert found.mean() < 0.012


def test_a_scene_with_room_keeps_ten_attempts_and_its_layouts(box: str):
    """`auto` finds the default; the layouts are those of ten, though the hash is another one."""
    auto, plain = (compile_on_cpu(_line(box, 2, 0.4, attempts=n)) for n in ("auto", 10))
    assert auto.attempts == plain.attempts == 10
    assert auto.hash != plain.hash
    assert (make(auto, 200).qpos == make(plain, 200).qpos).all()


def test_the_number_depends_on_the_scene_alone(box: str):
    """The bank, the restarts and another compilation do not change it."""
    others: tuple[dict, ...] = ({}, {}, {"restarts": 1}, {"bank": 3})
    found = {compile_on_cpu(_line(box, 2, NARROW, attempts="auto", **words)).attempts for words in others}
    assert len(found) == 1


def test_a_scene_in_which_some_worlds_always_restart_is_told(box: str, monkeypatch: pytest.MonkeyPatch):
    """Two of three boxes often leave nothing for the third; no number beyond the last one is tried."""
    monkeypatch.setattr("sceniris_gym.layout.attempts.MOST_ATTEMPTS", 50)
    with pytest.warns(FallbackWarning, match="stopped at 50"):
        assert compile_on_cpu(_line(box, 3, attempts="auto", restarts=100)).attempts == 50


def test_a_scene_that_cannot_be_made_is_refused_as_ever(box: str, monkeypatch: pytest.MonkeyPatch):
    """By the object and the cause, and without thousands of attempts for every world of the bank."""
    monkeypatch.setattr("sceniris_gym.layout.attempts.MOST_ATTEMPTS", 40)
    config = SceneConfig.load(_line(box, 4, half=0.11, attempts="auto"))
    assert find_attempts(upload_scene(build_model(config), "cpu")) == 10
    with pytest.raises(InfeasibleSceneError, match="collision"):
        compile_scene(config, "cpu")


def test_a_scene_that_cannot_be_made_is_tried_with_the_fewest_and_the_most_attempts_only(
    box: str, monkeypatch: pytest.MonkeyPatch
):
    """The most attempts fail only if all fewer do. A scene that can be made now and then is tried with all."""
    monkeypatch.setattr("sceniris_gym.layout.attempts.MOST_ATTEMPTS", 80)
    tried: list[int] = []

    def noted(trial: CompiledScene, seeds: np.ndarray) -> tuple[np.ndarray, bool]:
        tried.append(trial.attempts)
        return _still_failing(trial, seeds)

    monkeypatch.setattr("sceniris_gym.layout.attempts._still_failing", noted)
    full = upload_scene(build_model(SceneConfig.load(_line(box, 4, half=0.11, attempts="auto"))), "cpu")
    assert find_attempts(full) == 10
    assert tried == [10, 80]
    tried.clear()
    tight = upload_scene(build_model(SceneConfig.load(_line(box, 3, attempts="auto"))), "cpu")
    with pytest.warns(FallbackWarning, match="stopped at 80"):
        assert find_attempts(tight) == 80
    assert tried == [10, 20, 40, 80]
