"""The audit as a whole, on rows with known faults."""

import numpy as np
import pytest

from sceniris_gym.audit.auditor import CHUNK, Auditor, presence
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.layout_table import LayoutTable
from tests.audit.judging import GEOMETRIES, MJM, at, auditor, kept
from tests.audit.stacks import Things, cubes, post, stool, table, table_at_an_edge
from tests.audit.stacks import auditor as auditor_of
from tests.commands.scenes import GAP, OBJECTS, bodies, layout, with_row


def fallen(judge: Auditor, rows: LayoutTable, settled: int) -> list[tuple[int, str]]:
    """Return what falls among the first layouts, by row and name."""
    return [(m.row, m.name) for m in judge.judge(rows, settled=settled).misplaced if m.cause == "falls"]


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


def test_groups_count_who_is_there():
    """Too many, too few, one that is there and far away, and one that is absent and in the scene."""
    groups = {"some": {"of": ["can", "crate"], "count": 1}}
    far, here = at(42.0, 40.0), at(0.3, 0)
    rows = layout(MJM, 4)
    for row, place in enumerate((here, far, far, here)):
        rows.qpos[row] = layout(MJM, crate=place).qpos[0]
    present = np.array([[1, 1, 1, 1], [1, 1, 1, 0], [1, 1, 1, 1], [1, 1, 0, 0]], bool)
    found = kept(LayoutTable.from_states(rows.qpos, rows.mocap_pos, rows.mocap_quat, present), groups)
    assert (found["some", "count objects"].broken, found["some", "count objects"].checked) == (3, 4)
    assert found["crate", "present objects"].broken == 2
    assert found["can", "present objects"].broken == 1
    assert found["crate", "yaw rad"].checked == 2


def test_columns_are_objects_in_the_order_of_the_scene_and_then_the_robot():
    """By name, also of what is in no group."""
    objects = {"can": {"asset": "can", "on": "floor"}, "mug": {"asset": "mug", "on": "floor"}}
    scene = {"floor": {"size": [1.0, 1.0]}, "robot": {"asset": "panda"}, "objects": objects}
    rows = layout(MJM, 2)
    seen = np.array([[1, 0, 1], [0, 0, 1]], bool)
    found = presence(SceneConfig.load(scene), LayoutTable.from_states(rows.qpos, rows.mocap_pos, rows.mocap_quat, seen))
    assert {name: there.tolist() for name, there in found.items()} == {
        "can": [True, False],
        "mug": [False, False],
        "robot": [True, True],
    }


@pytest.mark.parametrize(
    ("stands", "falls", "geometry", "names"),
    [
        (cubes(0.0, 0.005, 0.01), cubes(0.0, 0.005, 0.045), "physics", ["c"]),
        (stool(0.02), stool(0.09), "physics", ["brick", "stool"]),
        (table_at_an_edge(0.12), table_at_an_edge(0.17), "physics", ["table"]),
        (post(0.0), post(0.03), "visual", ["post"]),
    ],
)
def test_what_mujoco_moves_by_a_centimetre_falls(stands: Things, falls: Things, geometry: str, names: list[str]):
    """By name and row, among the layouts that are stepped, in stacks that each stand or fall by hand."""
    for things, expected in ((stands, []), (falls, [(0, name) for name in names])):
        assert fallen(auditor_of(things, geometry), table(things, things), 1) == expected
    assert fallen(auditor_of(falls, geometry), table(falls, falls), 0) == []


def test_only_what_has_to_stand_and_is_there_falls():
    """Not by `stands: false`, in any orientation, or where it is absent; what it carries is judged for itself."""
    tower = cubes(0.0, 0.02, 0.04, 0.06)
    assert fallen(auditor_of(tower), table(tower), 1) == [(0, "b"), (0, "c"), (0, "d")]
    for words in ({"stands": False}, {"orientation": "any"}):
        assert fallen(auditor_of(tower, b=words), table(tower), 1) == [(0, "c"), (0, "d")]
    rows = table(tower)
    rows.present[0, 1] = False
    assert fallen(auditor_of(tower), rows, 1) == [(0, "c"), (0, "d")]


@pytest.mark.parametrize(("word", "names"), [("mass", []), ("ipos", []), ("friction", ["brick", "stool"])])
def test_stacks_with_drawn_masses_do_not_fall_by_those_of_the_model(word: str, names: list[str]):
    """A brick that tips the stool by the masses of the model may not do so by those of its episode."""
    draw = {"add": [-0.001, 0.001]} if word == "ipos" else {"scale": [0.1, 1.0]}
    judge = auditor_of(stool(0.09), brick={"randomize": {word: draw}})
    assert [name for _, name in fallen(judge, table(stool(0.09)), 1)] == names
