"""Making suites: cases of each axis and grade, equal layouts where an axis changes none, and refusals."""

from __future__ import annotations

from collections import Counter

import gymnasium as gym
import numpy as np
import pytest
import torch

from sceniris_gym import ImageConfig, LayoutGenerator, compile_scene
from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.layout.params import params_in
from sceniris_gym.suites.making import FIRST_SEED, make
from sceniris_gym.vector.state import State
from tests.suites.conftest import TASK, WIDE, Timed


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


def test_pictures_that_a_task_is_registered_with_have_axes(monkeypatch: pytest.MonkeyPatch):
    """Like the pictures of the task's class, which they may replace or leave out."""
    seen = {"overview": {"size": (8, 8)}}
    monkeypatch.setitem(gym.registry[TASK].kwargs, "images", seen)
    suite, _ = make(TASK, ("light", "camera"), 1, 1, device="cpu")
    assert [case.axis for case in suite.cases] == ["nominal", "light", "camera"]
    monkeypatch.setattr(Timed, "images", ImageConfig(cameras=seen), raising=False)
    monkeypatch.setitem(gym.registry[TASK].kwargs, "images", {})
    with pytest.raises(ArgumentError, match="--axes camera: the policy of this task sees no pictures"):
        make(TASK, ("camera",), 1, 1, device="cpu")


def test_confounders_are_absent_in_nominal_cases(monkeypatch: pytest.MonkeyPatch):
    """Their layouts have the bits of the task's own scene. Grade g has g of them, after all other objects."""
    few = {**WIDE, "groups": {}}
    monkeypatch.setitem(gym.registry[TASK].kwargs, "scene", few)
    suite, _ = make(TASK, ("clutter", "mass"), 3, 4, device="cpu")
    wide, own = suite.compiled("cpu"), LayoutGenerator(compile_scene(few, "cpu"), 4, seed=FIRST_SEED, split="eval")
    made = LayoutGenerator(wide, 4, split="eval", params=suite.head.params)
    own.generate()
    for grade in range(4):
        cases = [case for case in suite.cases if case.grade == grade and case.axis != "mass"]
        made.reseed(layouts=[case.id for case in cases])
        made.generate()
        table = made.table()
        added = [wide.slots.index(name) for name in wide.slots if name.startswith("confounder_")]
        assert table.valid.all()
        assert (table.present[:, added].sum(axis=1) == grade).all()
        for name in ("cabinet", "block", "first", "second"):
            np.testing.assert_array_equal(made.layouts.pose(name), own.layouts.pose(name))
    read = Auditor(wide.mjm, wide.config, wide.scene.bodies).judge(table)
    assert not (read.conflicts or read.misplaced)


class SeesAll(Timed):
    """A task that observes each object of its scene."""

    def observe(self, s: State) -> dict[str, dict[str, torch.Tensor]]:
        """Add the positions of all objects."""
        found, places = super().observe(s), s.poses([*s.scene.config.objects])[:, :, :3].flatten(1)
        return {**found, "policy": found["policy"] | {"places": places}}


def test_confounders_that_a_policy_would_observe_are_refused(monkeypatch: pytest.MonkeyPatch):
    """By the names of the observations. Draws that only the critic sees do not count."""
    small = {"task": SeesAll, "scene": {**WIDE, "groups": {}}}
    monkeypatch.setattr(gym.registry[TASK], "kwargs", small)
    with pytest.raises(ArgumentError, match="--axes clutter: a policy of SuiteReach-v0 observes the added objects"):
        make(TASK, ("clutter",), 1, 1, device="cpu")


def test_what_a_task_lacks_is_refused(task: str):
    """Unknown axes, axes that the task lacks, and edits that pass in no layout."""
    with pytest.raises(UnknownNameError, match=r"unknown axis 'mas'. Did you mean 'mass'"):
        make(task, ("mas",), device="cpu")
    with pytest.raises(ArgumentError, match=r"--axes light: .*sees no pictures"):
        make(task, ("light", "mass"), device="cpu")
    still = tuple(f"objects.{name}.orientation=fixed" for name in ("block", "first", "second", "thing"))
    with pytest.raises(ArgumentError, match=r"--axes turn: no edit of a layout passes .*no object has room"):
        make(task, ("turn",), 1, 1, changes=still, device="cpu")
