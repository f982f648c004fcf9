"""Random stacks are a function of their seed and have what they claim; what falls in them is found, and not served."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from tests.generators.stack_models import CARRIERS, SHAPES, make
from tests.generators.stack_table import table
from tests.oracle.stack_judge import StackJudge
from tests.stress.standing import MOST_MOVED, Outcome, main, report, try_scene

SEEDS = range(100)
TOWER = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>{bodies}</worldbody></mujoco>"""
CUBE = """<body name="{name}" pos="{pos}"><freejoint/><geom name="{name}" type="box" size=".025 .025 .025"/></body>"""


@cache
def tried(seed: int) -> Outcome:
    """Try a scene with few layouts; a small bank is quicker to fill."""
    return try_scene(str(seed), replace(make(seed), words={"bank": 8}), layouts=4, replayed=0)


def moves(*places: str, away: tuple[str, ...] = ()) -> list[float]:
    """Return how far each of some cubes gets."""
    bodies = "".join(CUBE.format(name=f"b{i}", pos=pos) for i, pos in enumerate(places))
    mjm = mujoco.MjModel.from_xml_string(TOWER.format(bodies=bodies))
    nothing = np.zeros((0, 3)), np.zeros((0, 4))
    return StackJudge(mjm).moves(mjm.qpos0, *nothing, away=[mjm.body(name).id for name in away]).tolist()


def test_the_judge_finds_what_falls():
    """A tower stands; a cube over the edge falls, and so does one in the air; what is away is not judged."""
    assert max(moves("0 0 .025", "0 0 .075", "0.005 0 .125")) < 0.002
    assert moves("0 0 .025", "0.03 0 .075")[1] > 0.02
    assert moves("0 0 .025", "0 0 .2") == pytest.approx([0.0, 0.125], abs=2e-3)
    assert max(moves("0 0 .025", "0.03 0 .075", away=("b1",))) < 0.001


def test_what_becomes_too_fast_counts_as_moved():
    """Two cubes in one another, which MuJoCo resets, or throws far."""
    assert max(moves("0 0 .025", "0 0 .0251")) > 0.01


def test_a_scene_is_a_function_of_its_seed():
    """Twice the same scene, and another one for another seed."""
    scenes = [make(seed) for seed in SEEDS]
    assert scenes[:10] == [make(seed) for seed in range(10)]
    assert len({scene.model for scene in scenes}) == len(scenes)


def test_scenes_have_all_carriers_and_shapes_and_2_to_8_free_things(tmp_path):
    """Every feature comes up, and MuJoCo C takes every model."""
    count = Counter(feature for seed in SEEDS for feature in make(seed).features)
    assert {*CARRIERS, *SHAPES, "high"} == set(count)
    free = set()
    for seed in SEEDS:
        mjm = mujoco.MjModel.from_xml_path(make(seed).write(tmp_path)["model"])
        free.add(int((mjm.jnt_type == mujoco.mjtJoint.mjJNT_FREE).sum()))
    assert free == set(range(2, 9))


def test_a_report_counts_what_moves():
    """Of two scenes one has a layout that moves, and is named."""
    outcomes = [
        Outcome("1", frozenset({"box"}), layouts=4, moved={3: 0.5}, rejected=4, stand=1),
        Outcome("2", frozenset({"box"}), "SomeError: objects.a"),
    ]
    lines = report(outcomes)
    assert lines[1].split() == ["box", "2", "1", "4", "1", "25.000%", "4,", "25.0%"]
    assert lines[-1].endswith("1 (1, 0.500 m)")


def test_a_scene_can_be_written_and_the_table_has_a_command(tmp_path, capsys):
    """The command writes the files of a scene, and tries a row of the table."""
    assert main(["--show", "3", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "scene.yaml").is_file() and (tmp_path / "model.xml").is_file()
    main(["--table", "--only", "two cubes", "--layouts", "2"])
    assert "two cubes at ratio 0" in capsys.readouterr().out


def test_nothing_falls_in_random_scenes():
    """MuJoCo C finds nothing that moves by 1 cm; few scenes are refused. `tests.stress.standing` tries thousands."""
    outcomes = [tried(seed) for seed in SEEDS[:50]]
    assert sum(bool(o.refused) for o in outcomes) <= 0.1 * len(outcomes)
    assert sum(len(o.moved or {}) for o in outcomes) <= MOST_MOVED * sum(o.layouts for o in outcomes)


@pytest.mark.parametrize("name", table())
def test_what_falls_in_one_way_is_refused_or_rejected(name: str):
    """No layout of a row of the table moves."""
    assert not try_scene(name, table()[name], layouts=16, replayed=0).moved
