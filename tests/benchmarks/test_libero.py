"""The benchmark of LIBERO's scenes: its sampler keeps circles apart in rectangles, and overlaps are seen."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.libero import CircleSampler, NoPlaceError, Options, main, penetrations
from sceniris_gym.importers.libero.reader import read_bddl
from sceniris_gym.layout.compile import compile_scene
from tests.importers.libero.problems import KITCHEN, write

pytestmark = pytest.mark.filterwarnings("ignore::sceniris_gym.errors.ModelWarning")


def test_circles_are_in_their_rectangles_and_apart(tmp_path: Path):
    """A bowl and a plate in one rectangle; two circles of 2.5 cm keep 5 cm."""
    square = "(-0.14 -0.04 -0.06 0.04)"
    text = KITCHEN.replace("(0.02 0.1 0.06 0.14)", square).replace("(-0.12 -0.02 -0.08 0.02)", square)
    task = read_bddl(write(tmp_path, text))
    compiled = compile_scene(read_bddl(write(tmp_path)).scene, "cpu")
    mjm = compiled.mjm
    sampler = CircleSampler(task, compiled, 0)
    columns = [mjm.jnt_qposadr[mjm.body(name).jntadr[0]] for name in ("akita_black_bowl_1", "plate_1")]
    for _ in range(20):
        (qpos,) = sampler.draw().qpos
        bowl, plate = (qpos[adr : adr + 2] for adr in columns)
        assert np.linalg.norm(bowl - plate) > 0.05
        assert (np.abs(bowl - [-0.1, 0.0]) <= 0.04).all()
        assert (np.abs(plate - [-0.1, 0.0]) <= 0.04).all()


def test_a_thing_without_any_place_is_told(tmp_path: Path):
    """Two things at one point."""
    point = "(0.0 0.0 0.0 0.0)"
    text = KITCHEN.replace("(0.02 0.1 0.06 0.14)", point).replace("(-0.12 -0.02 -0.08 0.02)", point)
    compiled = compile_scene(read_bddl(write(tmp_path)).scene, "cpu")
    with pytest.raises(NoPlaceError):
        CircleSampler(read_bddl(write(tmp_path, text)), compiled, 0).draw()


def test_things_in_each_other_are_counted(tmp_path: Path):
    """A bowl moved into a plate, in one layout of two."""
    task = read_bddl(write(tmp_path))
    compiled = compile_scene(task.scene, "cpu")
    mjm = compiled.mjm
    tables = [CircleSampler(task, compiled, 0).draw() for _ in range(2)]
    bowl, plate = (mjm.jnt_qposadr[mjm.body(name).jntadr[0]] for name in ("akita_black_bowl_1", "plate_1"))
    tables[1].qpos[0, bowl : bowl + 3] = tables[1].qpos[0, plate : plate + 3] + [0.0, 0.0, 0.01]
    found = penetrations(mjm, tables, task.scene.objects)
    assert found == {"penetrate": 1, "deep": 1, "pair": "akita_black_bowl_1 plate_1"}


def test_a_run_goes_on_where_it_ended(tmp_path: Path, capsys: pytest.CaptureFixture):
    """A line for each file, and the sums; a second run measures nothing again."""
    write(tmp_path)
    options = Options(tmp_path, layouts=16, out=tmp_path / "out/libero.jsonl", device="cpu")
    for _ in range(2):
        main(options)
    first, *_, sums = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert first["ours"] == {"layouts": 16, "valid": 16, "penetrate": 0, "deep": 0, "pair": ""}
    assert (sums["read"], sums["with_boxes"], sums["compiled"]) == (1, 1, 1)
    assert len(options.out.read_text().splitlines()) == 1
