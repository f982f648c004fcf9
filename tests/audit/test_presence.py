"""Presence as the audit judges it, on rows with known faults."""

from __future__ import annotations

import numpy as np

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.layout_table import LayoutTable
from tests.audit.judging import MJM, judge_language
from tests.commands.scenes import OBJECTS, bodies, layout

CAN, GEM, CRATE = (list(OBJECTS).index(name) for name in ("can", "gem", "crate"))


def broken(present: list[list[int]], groups: dict, **words: dict) -> dict[str, int]:
    """Return how many rows break the count or the conditions of each group or object; `present` has can, gem, crate."""
    objects = {name: {**part, **words.get(name, {})} for name, part in OBJECTS.items()}
    config = SceneConfig.load({"floor": {"size": [2.0, 2.0]}, "objects": objects, "groups": groups})
    rows = layout(MJM, len(present))
    there = np.ones((len(present), len(objects)), bool)
    there[:, [CAN, GEM, CRATE]] = present
    table = LayoutTable.from_states(rows.qpos, rows.mocap_pos, rows.mocap_quat, there)
    found = judge_language(Auditor(MJM, config, bodies(MJM)), table)
    return {k.name: k.broken for k in found if k.word.split()[0] in ("if", "count")}


def test_conditions_hold_in_both_directions():
    """An object in no group is there if and only if its conditions hold; one in a group at most then."""
    rows = [[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0]]
    some = {"some": {"of": ["can"], "count": [0, 1]}}
    assert broken(rows, some, gem={"if": "can"}) == {"some": 0, "gem": 2}
    assert broken(rows, some, gem={"unless": "can"}) == {"some": 0, "gem": 2}
    both = some | {"other": {"of": ["gem"], "count": [0, 1]}}
    assert broken(rows, both, gem={"if": "can"}) == {"some": 0, "other": 1, "gem": 1}


def test_counts_are_cut_to_the_members_that_may_be_there():
    """One of two, one of which needs the can."""
    groups = {"some": {"of": ["can"], "count": [0, 1]}, "pair": {"of": ["gem", "crate"], "count": 2}}
    rows = [[0, 0, 1], [0, 0, 0], [1, 1, 1], [1, 0, 1]]
    assert broken(rows, groups, gem={"if": "can"}) == {"some": 0, "pair": 2, "gem": 0}


def test_a_group_in_a_group_may_be_left_out_as_a_whole():
    """But not in part, and not together with its rival."""
    groups = {"outer": {"of": ["pair", "can"], "count": 1}, "pair": {"of": ["gem", "crate"], "count": 2}}
    rows = [[1, 0, 0], [0, 1, 1], [0, 0, 1], [1, 1, 1]]
    assert broken(rows, groups) == {"outer": 1, "pair": 1}
