"""The audit as a whole, on rows with known faults."""

import numpy as np

from sceniris_gym.audit.auditor import CHUNK, Auditor
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.layout_table import LayoutTable
from tests.audit.judging import GEOMETRIES, MJM, auditor
from tests.commands.scenes import GAP, OBJECTS, bodies, layout, with_row


@GEOMETRIES
def test_reports_exactly_the_rows_with_a_pushed_and_an_enclosed_object(geometry: str):
    """One can is pushed 1 mm into the crate, one gem is wholly inside of the crate; nothing else is reported."""
    rows = layout(MJM, 20)
    touching = 0.3 - 0.04 - 0.03
    rows = with_row(rows, 4, layout(MJM, crate=(0.3, 0, GAP, 0), can=(touching + 0.001, 0, GAP, 0)))
    rows = with_row(rows, 11, layout(MJM, gem=(0.3, 0, 0.01, 0)))
    report = auditor(geometry).judge(rows)
    assert [(c.row, set(c.owners)) for c in report.conflicts] == [(4, {"can", "crate"}), (11, {"gem", "crate"})]
    assert report.conflicts[1].distance == -np.inf
    assert report.colliding == 2
    assert [(m.row, m.name) for m in report.misplaced] == [(11, "gem")]


def test_absent_objects_are_judged_by_nothing_else():
    """An absent crate that stands in a can is not misplaced and has no relations, but in MuJoCo it collides."""
    rows = layout(MJM, 2, crate=(-0.3, 0.0, 0.5, 0.0), can=(-0.3, 0.0, 0.5, 0.0))
    config = {"floor": {"size": [1.0, 1.0]}, "objects": OBJECTS, "groups": {"some": {"of": ["crate"], "count": [0, 1]}}}
    judge = Auditor(MJM, SceneConfig.load(config), bodies(MJM))
    present = np.array([[1, 1, 1, 1], [1, 1, 1, 0]], bool)
    report = judge.judge(LayoutTable.from_states(rows.qpos, rows.mocap_pos, rows.mocap_quat, present))
    assert {c.row for c in report.conflicts} == {0, 1}
    assert {(m.row, m.name) for m in report.misplaced} == {(0, "crate"), (0, "can"), (1, "can")}
    assert report.relation_violations == 1


def test_rows_keep_their_numbers_however_many_are_judged():
    """Faults in the first, the second and the last part of the rows that are held at once."""
    faulty = (3, CHUNK + 7, 2 * CHUNK + 50)
    rows = layout(MJM, faulty[-1] + 1)
    for row in faulty:
        rows = with_row(rows, row, layout(MJM, can=(-0.3, 0.0, -0.001, 0.0), gem=(0.3, -0.3, 0.1, 0.0)))
    report = auditor().judge(rows)
    assert report.layouts == len(rows)
    assert [(c.row, set(c.owners)) for c in report.conflicts] == [(row, {"can", "world"}) for row in faulty]
    assert [m.row for m in report.misplaced if m.name == "gem"] == list(faulty)
    assert report.penetration is not None
    assert report.penetration.row in faulty
