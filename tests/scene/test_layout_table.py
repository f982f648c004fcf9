"""Tables of layouts: rows stay together whatever is done to them, and MuJoCo gets them as they are."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneMismatchError
from sceniris_gym.scene.layout_table import COLUMNS, LayoutTable

# A free body, a hinge, and two mocap bodies.
MODEL = """
<mujoco><worldbody>
  <body name="ball"><freejoint/><geom size=".1"/></body>
  <body name="door"><joint axis="0 0 1"/><geom size=".1"/></body>
  <body name="one" mocap="true"/><body name="two" mocap="true"/>
</worldbody></mujoco>"""


def _table(nrow: int, seed: int) -> LayoutTable:
    """A table in which every field of every row holds numbers that no other row has."""
    draws = np.random.default_rng(seed)
    shapes = {"qpos": (8,), "mocap_pos": (2, 3), "mocap_quat": (2, 4), "present": (3,), "grasp": (2,)}
    shapes |= {"grasp_pose": (2, 7), "grasp_qpos": (2, 6), "pregrasp_qpos": (2, 6), "path": (2, 24)}
    columns: dict[str, Any] = {name: draws.random((nrow, *shapes.get(name, ()))) for name in COLUMNS}
    return LayoutTable(**columns)


def _rows(table: LayoutTable) -> list[tuple[np.ndarray, ...]]:
    """All that a table says of each row."""
    return [tuple(getattr(table, name)[i] for name in COLUMNS) for i in range(len(table))]


def _same(a: list[tuple[np.ndarray, ...]], b: list[tuple[np.ndarray, ...]]) -> bool:
    """Return whether two lists of rows hold the same numbers."""
    return len(a) == len(b) and all(
        np.array_equal(x, y) for one, two in zip(a, b, strict=True) for x, y in zip(one, two, strict=True)
    )


def test_concatenated_tables_are_all_their_rows_in_order():
    """Of one table too, and of an empty one among others."""
    tables = [_table(n, seed) for seed, n in enumerate((3, 0, 1, 4))]
    rows = [row for table in tables for row in _rows(table)]
    assert _same(_rows(LayoutTable.concatenate(tables)), rows)
    assert _same(_rows(LayoutTable.concatenate(tables[:1])), _rows(tables[0]))


def test_a_table_of_an_earlier_version_has_no_paths():
    """Files that lack the column are read, as the policies that ship; without targets and with them."""
    columns = {name: getattr(_table(3, 0), name) for name in COLUMNS if name != "path"}
    assert LayoutTable(**columns).path.shape == (3, 2, 0)
    state = _table(3, 0)
    assert LayoutTable.from_states(state.qpos, state.mocap_pos, state.mocap_quat, state.present).path.shape == (3, 0, 0)


def test_chosen_rows_are_whole():
    """By a slice, a mask, or numbers in any order: every field is chosen from alike."""
    table = _table(6, 0)
    rows = _rows(table)
    mask = np.array([True, False, False, True, True, False])
    assert _same(_rows(table[1:4]), rows[1:4])
    assert _same(_rows(table[mask]), [rows[i] for i in (0, 3, 4)])
    assert _same(_rows(table[np.array([5, 0, 5])]), [rows[5], rows[0], rows[5]])


@pytest.mark.parametrize("size", [1, 3, 4, 12, 100])
def test_chunks_are_the_table_cut_into_pieces(size: int):
    """None is longer than asked for, each begins where it says, and together they are the table."""
    table = _table(12, 1)
    chunks = list(table.chunks(size))
    assert all(0 < len(chunk) <= size for _, chunk in chunks)
    assert all(_same(_rows(chunk)[:1], _rows(table)[start : start + 1]) for start, chunk in chunks)
    assert _same(_rows(LayoutTable.concatenate([chunk for _, chunk in chunks])), _rows(table))


def test_a_row_that_is_put_into_mujoco_stands_where_it_says():
    """Positions of bodies after MuJoCo's own kinematics; another row leaves nothing of the one before."""
    mjm = mujoco.MjModel.from_xml_string(MODEL)
    data, draws = mujoco.MjData(mjm), np.random.default_rng(2)
    qpos, quat = draws.normal(size=(5, mjm.nq)), draws.normal(size=(5, 2, 4))
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    quat /= np.linalg.norm(quat, axis=2, keepdims=True)
    table = LayoutTable.from_states(qpos, draws.normal(size=(5, 2, 3)), quat, np.ones((5, 3), bool))
    for i in (0, 4, 2):
        table.put(data, i)
        mujoco.mj_kinematics(mjm, data)
        np.testing.assert_allclose(data.body("ball").xpos, qpos[i, :3])
        np.testing.assert_allclose(data.body("ball").xquat, qpos[i, 3:7])
        np.testing.assert_allclose(data.body("door").xmat[:2], [np.cos(qpos[i, 7]), -np.sin(qpos[i, 7])])
        for k, name in enumerate(("one", "two")):
            np.testing.assert_allclose(data.body(name).xpos, table.mocap_pos[i, k])
            np.testing.assert_allclose(data.body(name).xquat, table.mocap_quat[i, k])


def test_of_mere_states_nothing_else_is_claimed():
    """No row is valid, of a known episode or grasped; it can be joined with others and cut like any table."""
    states = LayoutTable.from_states(np.ones((4, 8)), np.zeros((4, 0, 3)), np.zeros((4, 0, 4)), np.ones((4, 2), bool))
    assert len(states) == 4
    assert not states.valid.any() and not states.first_pass_valid.any()
    assert (states.episode == -1).all()
    assert states.grasp.shape == (4, 0)
    assert len(LayoutTable.concatenate([states, states])[2:7]) == 5
    assert all(len(getattr(states, name)) == 4 for name in COLUMNS)


def test_tables_that_cannot_be_joined_or_cut_are_refused():
    """No tables, columns of other widths, and chunks of no rows."""
    states = [
        LayoutTable.from_states(np.ones((4, nq)), np.zeros((4, 0, 3)), np.zeros((4, 0, 4)), np.ones((4, 2), bool))
        for nq in (7, 8)
    ]
    for wrong in ([], None, [3]):
        with pytest.raises(ArgumentError, match="tables should be a list of one LayoutTable or more"):
            LayoutTable.concatenate(wrong)  # pyrefly: ignore[bad-argument-type]
    with pytest.raises(SceneMismatchError, match="should have the same scene, split, params"):
        LayoutTable.concatenate(states)
    for size in (0, -1, None, "x"):
        with pytest.raises(ArgumentError, match="size should be an integer of at least 1"):
            next(states[0].chunks(size))  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize("name", ["qpos", "mocap_pos", "mocap_quat", "present"])
@pytest.mark.parametrize("wrong", [3, None, [[0.0]], np.float32(0.0), np.zeros(())])
def test_states_that_are_no_arrays_are_told_by_their_names(name: str, wrong: Any):
    """A number was a TypeError, and a list an error of whoever used the table later."""
    states = {"qpos": (2, 8), "mocap_pos": (2, 0, 3), "mocap_quat": (2, 0, 4), "present": (2, 1)}
    arrays: dict[str, Any] = {key: np.ones(shape) for key, shape in states.items()}
    with pytest.raises(ArgumentTypeError, match=f"LayoutTable.from_states: {name} should be a NumPy array"):
        LayoutTable.from_states(**arrays | {name: wrong})


def test_rows_that_do_not_exist_are_refused():
    """By the rows that there are; one number names one row, and one beyond them ends a loop."""
    table = _table(3, 5)
    assert len(table[0]) == len(table[-1]) == len(table[np.int64(1)]) == 1
    assert table[0].qpos.shape == (1, *table.qpos.shape[1:])
    assert sum(len(row) for row in table) == len(table)
    for index in ("x", [99], (0, 1), np.array([0.5])):
        with pytest.raises(ArgumentError, match="LayoutTable: the index should be rows from 0 to"):
            table[index]
    for data, row in ((None, 0), (mujoco.MjData(mujoco.MjModel.from_xml_string("<mujoco/>")), None)):
        with pytest.raises(ArgumentTypeError, match=r"LayoutTable\.put: (data|i) should be"):
            table.put(data, row)  # pyrefly: ignore[bad-argument-type]
