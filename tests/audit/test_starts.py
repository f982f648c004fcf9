"""The audit of starts: it finds nothing in layouts as they are made, and everything that is moved by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.commands.audit import judge_reach, reach_claims
from sceniris_gym.layout.tables import make_table
from tests.layout.starting import HELD, LIFTED, PLACED, STANDING, starting


@pytest.fixture(scope="module")
def auditor() -> Auditor:
    """The auditor of the scene."""
    compiled = starting()
    return Auditor(compiled.mjm, compiled.config, compiled.scene.bodies)


def test_layouts_pass(auditor: Auditor):
    """Of every kind, with their claims about reach."""
    table = make_table(starting(), 60, 100)
    assert set(table.start.tolist()) == set(range(7))
    report = auditor.judge(table, settled=20)
    assert (report.conflicts, report.misplaced, report.depth, report.relation_violations) == ([], [], 0.0, 0)
    assert report.settled == 20 - np.isin(table.start[:20], (LIFTED, HELD)).sum()
    assert judge_reach(starting(), table, reach_claims(starting(), table)) == []


@pytest.mark.parametrize(("kind", "name"), [(STANDING, "block"), (LIFTED, "block"), (PLACED, "apple")])
def test_what_is_not_where_its_start_says_is_found(auditor: Auditor, kind: int, name: str):
    """A thing that was moved out of the hand by hand, or away from its marker."""
    table = make_table(starting(), 60, 100)
    rows = table[table.start == kind]
    adr = starting().mjm.joint(f"{name}/free").qposadr[0]
    qpos = rows.qpos.copy()
    qpos[:, adr + 2] += 0.001 if kind == PLACED else 0.3
    qpos[:, adr] += 0.001
    found = auditor.judge(replace(rows, qpos=qpos)).misplaced
    assert {(m.row, m.name) for m in found if m.cause == "start"} == {(row, name) for row in range(len(rows))}


def test_what_falls_has_the_number_of_its_layout(auditor: Auditor):
    """Behind layouts with something in the air, which are not stepped."""
    table = make_table(starting(), 60, 100)
    held = np.isin(table.start, (LIFTED, HELD))
    row = int(np.flatnonzero(~held[held.argmax() :])[0] + held.argmax())
    qpos = table.qpos.copy()
    qpos[row, starting().mjm.joint("apple/free").qposadr[0] + 2] += 0.05
    found = auditor.judge(replace(table, qpos=qpos), settled=row + 1).misplaced
    assert [(m.row, m.name) for m in found if m.cause == "falls"] == [(row, "apple")]


def test_an_empty_hand_is_no_excuse(auditor: Auditor):
    """In the state of a grasp that is called another kind, the fingers are in the thing."""
    table = make_table(starting(), 60, 100)
    rows = table[table.start == STANDING]
    report = auditor.judge(replace(rows, start=np.zeros_like(rows.start)))
    assert {c.row for c in report.conflicts} == set(range(len(rows)))
