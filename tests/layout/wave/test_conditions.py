"""Conditions, groups of groups and several supports: each set of objects as often as the docs have it."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.tables import make_table
from tests.layout.present import FLOOR, forms, pvalue
from tests.layout.related import Shapes, judged
from tests.layout.scenes import compile_on_cpu

FORMS = ("conditions", "groups of groups", "cut counts", "towers", "variants", "supports")


@pytest.fixture(scope="module")
def shapes(tmp_path_factory) -> Shapes:
    """The assets."""
    return Shapes(tmp_path_factory.mktemp("shapes"))


@pytest.mark.parametrize("form", FORMS)
def test_sets_of_objects_are_as_likely_as_an_enumeration_has_them(form: str, shapes: Shapes):
    """Against exact fractions; and the audit finds nothing wrong in 2,000 layouts."""
    written = forms(shapes)[form]
    compiled = compile_on_cpu({"floor": FLOOR, **written}, bank=8)
    table = make_table(compiled, 2000, 5000)
    assert (table.status == LayoutStatus.VALID).mean() > 0.99
    assert pvalue(compiled, written, table.present) > 0.001
    kept = judged(compiled, table[:500])
    assert not [k for k in kept if k.broken]
    report = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies).judge(table[:200])
    assert (report.conflicts, report.misplaced) == ([], [])


def test_conditions_do_not_change_the_draws_of_other_groups(shapes: Shapes):
    """The members of the file's groups have the same bits with and without an object that has a condition."""
    cube = {"asset": shapes.cube, "on": "floor"}
    plain = {
        "floor": FLOOR,
        "objects": dict.fromkeys("abc", cube),
        "groups": {"g": {"of": list("abc"), "count": [0, 3]}},
    }
    more = {**plain, "objects": {**plain["objects"], "d": {**cube, "if": "a"}}}
    first, second = (make_table(compile_on_cpu(words, bank=2), 500, 3).present for words in (plain, more))
    np.testing.assert_array_equal(first, second[:, :3])
    np.testing.assert_array_equal(second[:, 3], second[:, 0])
