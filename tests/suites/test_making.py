"""Making suites: cases of each axis and grade, equal layouts where an axis changes none, and refusals."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from sceniris_gym import LayoutGenerator, compile_scene
from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.layout.params import params_in
from sceniris_gym.suites.making import FIRST_SEED, make
from tests.suites.conftest import WIDE


def test_a_suite_has_cases_of_each_axis_and_grade(task: str):
    """Numbered, and the same from run to run. Cumulative cases have the params of all axes."""
    suite, refused = make(task, ("robot", "mass", "variant"), 3, 2, cumulative=True, device="cpu")
    counts = Counter((case.axis, case.grade) for case in suite.cases)
    graded = [(name, grade) for name in ("robot", "mass", "cumulative") for grade in (1, 2, 3)]
    assert counts == dict.fromkeys([("nominal", 0), ("variant", 1), *graded], 2)
    assert [case.case for case in suite.cases] == list(range(len(suite.cases)))
    assert not refused
    assert make(task, ("robot", "mass", "variant"), 3, 2, cumulative=True, device="cpu")[0].cases == suite.cases
    last = params_in(LayoutId.parse(suite.cases[-1].id).params)
    assert np.ptp(last["robot.joints.arm/pan"]) == 0.0
    assert np.ptp(last["objects.block.randomize.mass"]) == 0.0


def test_nominal_layouts_are_those_of_the_task(task: str):
    """Bit for bit, although the scene is wider, and so are places in cases that change only physics."""
    suite, _ = make(task, ("robot", "joint", "mass"), 5, 2, device="cpu")
    wide = suite.compiled("cpu")
    own = LayoutGenerator(compile_scene(WIDE, "cpu"), 2, seed=FIRST_SEED, split="eval")
    made = LayoutGenerator(wide, 2, split="eval", params=suite.head.params)
    own.generate()
    for axis in ("nominal", "mass"):
        made.reseed(layouts=[case.id for case in suite.cases if case.axis == axis][-2:])
        made.generate()
        np.testing.assert_array_equal(made.table().qpos, own.table().qpos)


def test_what_a_task_lacks_is_refused(task: str):
    """Unknown axes, axes that the task lacks, and edits that pass in no layout."""
    with pytest.raises(UnknownNameError, match=r"unknown axis 'mas'. Did you mean 'mass'"):
        make(task, ("mas",), device="cpu")
    with pytest.raises(ArgumentError, match=r"--axes light: .*sees no pictures"):
        make(task, ("light", "mass"), device="cpu")
    still = ("objects.block.orientation.yaw=[0, 1]",)
    with pytest.raises(ArgumentError, match=r"--axes turn: no edit of a layout passes .*block: .*yaw"):
        make(task, ("turn",), 1, 1, changes=still, device="cpu")
