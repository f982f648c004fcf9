"""The audit of heaps: layouts that are as settled, and the same with a thing of it moved."""

from __future__ import annotations

import numpy as np
import pytest

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.tables import read_table
from tests.layout.scenes import compile_on_cpu
from tests.scene.heaping import THINGS, folder, words


@pytest.mark.parametrize("kind", ["fixture", "free"])
def test_heaps_are_sound_and_a_moved_thing_is_found(kind: str):
    """They touch each other and the bin as they may; 0.1 mm aside is no row, and 5 mm down is too deep."""
    compiled = compile_on_cpu(words(folder(), kind=kind), bank=2)
    generator = LayoutGenerator(compiled, 20)
    generator.generate()
    table = read_table(generator)
    auditor = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies)
    report = auditor.judge(table, settled=20)
    assert (report.conflicts, report.misplaced) == ([], [])
    assert report.allowed
    assert {allowed.why for allowed in report.allowed} == {"they lie in a heap"}
    assert {name: report.moved[name] for name in THINGS} == dict.fromkeys(THINGS, 0)
    qpos = np.array(table.qpos)
    adr = compiled.mjm.joint("a/free").qposadr[0]
    qpos[3, adr] += 1e-4
    qpos[5, adr + 2] -= 0.005
    moved = auditor.judge(type(table).from_states(qpos, table.mocap_pos, table.mocap_quat, table.present))
    assert {(m.row, m.cause) for m in moved.misplaced} == {(3, "heap"), (5, "heap")}
    assert 5 in {conflict.row for conflict in moved.conflicts}
