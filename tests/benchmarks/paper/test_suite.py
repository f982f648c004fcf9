"""The suite as a whole: every row of the paper is there, measured or with a reason, on a CPU and on a GPU."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from benchmarks.paper import peers, suite, synthesizer
from benchmarks.paper.extent import PRESSURE, SIZES, Extent
from benchmarks.paper.figures import REPORTED, Experiment
from benchmarks.paper.report import as_json, as_text
from benchmarks.paper.rows import Row
from benchmarks.paper.warm import Warm
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.layout_table import LayoutTable
from tests.layout.scenes import compile_on_cpu

COLD = {"cold_s": 2.0, "imports_s": 1.0, "compile_s": 0.5, "generate_s": 0.1, "valid": 1.0, "peak_bytes": 5e8}
NOTHING = LayoutTable.from_states(np.zeros((0, 1)), np.zeros((0, 0, 3)), np.zeros((0, 0, 4)), np.ones((0, 1), bool))


def check(rows: list[Row]) -> None:
    """Every row is measured or says why not, every figure of others stands in one, and all sizes are there."""
    for row in rows:
        assert bool(row.measured) != bool(row.missing), row
    assert {f for row in rows for f in row.reported} == set(REPORTED)
    assert [row.experiment for row in rows] == sorted((row.experiment for row in rows), key=list(Experiment).index)
    assert {row.experiment for row in rows} == set(Experiment)
    for experiment in (Experiment.WARM, Experiment.EMPTY, Experiment.KEPT, Experiment.PHYSICS):
        assert tuple(row.worlds for row in rows if row.experiment is experiment) == SIZES


@pytest.mark.slow
def test_a_small_run_measures_all_experiments(monkeypatch: pytest.MonkeyPatch):
    """With up to sixteen scenes at once, and without fresh processes, which have their own tests."""
    small = Extent(True, 16, "left out by this test", 1, 4, 0.0)
    monkeypatch.setattr(suite.Extent, "of", lambda *_: small)
    monkeypatch.setattr(suite, "cold", lambda *_: dict(COLD))
    told: list[Row] = []
    found = suite.run("cpu", True, ["uniform"], told.append)
    check(found["rows"])
    assert told == found["rows"]
    measured = {row.experiment for row in told if row.measured}
    assert set(Experiment) - measured == {
        *(Experiment.EMPTY, Experiment.HARDER_EMPTY, Experiment.HARDER_KEPT),
        *(Experiment.SYNTHESIZER, Experiment.RATIO, Experiment.PICTURES, Experiment.ORIGINAL),
    }
    assert all(row.measured["valid"] == 1.0 for row in told if row.experiment is Experiment.WARM and row.measured)
    parsed = json.loads(as_json(found))
    assert len(parsed["rows"]) == len(told)
    assert parsed["faces"]["apple"] > 16000
    assert "| 524,288 | not measured: left out by this test | 5,279.84 valid/s" in as_text(found)


@pytest.fixture(scope="module")
def mid() -> CompiledScene:
    """One scene in place of all, where nothing is made of it."""
    return compile_on_cpu("mid")


@pytest.mark.parametrize("quick", [False, True])
@pytest.mark.parametrize("gpu", [False, True])
def test_all_rows_are_there_whatever_the_extent(
    gpu: bool, quick: bool, mid: CompiledScene, monkeypatch: pytest.MonkeyPatch
):
    """With stubs for all that takes time; on a GPU without --quick nothing is left out but what never is measured."""
    asked: list[int] = []

    def warm(_: Any, worlds: int, rounds: int) -> Warm:
        asked.append(worlds)
        assert rounds >= 5
        return Warm(0.01, 0.9, 5.0, 50.0)

    for module in (suite, peers):
        monkeypatch.setattr(module, "warm", warm)
        monkeypatch.setattr(module, "colliding", lambda *_: 0.25)
        monkeypatch.setattr(module, "make_table", lambda *_, **__: NOTHING)
    monkeypatch.setattr(suite.scenes, "compiled_scene", lambda *_: mid)
    monkeypatch.setattr(suite, "cold", lambda *_: dict(COLD))
    monkeypatch.setattr(suite, "shares", lambda *_: {"collision": 1.0})
    monkeypatch.setattr(synthesizer, "check_installed", lambda: None)
    made = {"processes": 1, "cold_s": 1.0, "scene_s": 0.5, "made": 9, "valid": 1.0, "valid_per_s": 2.0}
    monkeypatch.setattr(synthesizer, "measure", lambda *_: (dict(made), NOTHING))
    largest = (16384 if quick else PRESSURE) if gpu else (1024 if quick else 16384)
    extent = Extent(quick, largest, "why", 5, 4, 1.0)
    monkeypatch.setattr(suite.Extent, "of", lambda *_: extent)
    found = suite.run("cpu", quick, ["uniform", "scene_synthesizer"])
    check(found["rows"])
    assert max(asked) == largest
    if gpu and not quick:
        missing = [(row.experiment, row.worlds) for row in found["rows"] if row.missing]
        assert {experiment for experiment, _ in missing} == {
            *(Experiment.EMPTY, Experiment.PICTURES, Experiment.ORIGINAL)
        }
        assert not {PRESSURE, 16384, 1024} & {worlds for _, worlds in missing}
    (ratio,) = (row for row in found["rows"] if row.experiment is Experiment.RATIO)
    assert ratio.measured["valid_ratio_warm"] == pytest.approx(0.9 * min(largest, 16384) / 0.01 / 2.0)
    assert as_text(found).count("\n**") >= len(Experiment)
