"""Relations, orientations and groups, counted over rows."""

import numpy as np
import pytest

from sceniris_gym.scene.layout_table import LayoutTable
from tests.audit.judging import MJM, at, kept
from tests.commands.scenes import layout


def test_relations_of_many_rows_are_judged_quickly():
    """Four relations in 20,000 rows take seconds, not minutes; the worst row is named."""
    relations = [{"near": "can", "measure": "bounds", "distance": {"max": 0.6}}, {"right_of": "can"}]
    relations += [{"between": ["can", "gem", "shelf"], "width": 0.1}, {"beside": "can", "side": "right"}]
    rows = layout(MJM, 20000)
    rows.qpos[17000] = layout(MJM, crate=at(0.9, 0.0)).qpos[0]
    found = kept(rows, crate={"relations": relations})
    assert (found["crate", "0 near m"].broken, found["crate", "0 near m"].row) == (1, 17000)
    assert found["crate", "3 beside m"].broken == 20000


def test_counts_of_parts_add_up_to_those_of_the_whole():
    """Random places of a crate that is to be near a can: broken, checked and worst, by plain arithmetic as well."""
    rng = np.random.default_rng(4)
    rows = layout(MJM, 1300)
    adr = MJM.jnt_qposadr[MJM.joint("crate/free").id]
    rows.qpos[:, adr : adr + 2] = rng.uniform(-0.9, 0.9, (1300, 2))
    near = {"relations": [{"near": "can", "distance": {"max": 0.6}}]}
    whole = kept(rows, crate=near)["crate", "0 near m"]
    missed = np.hypot(rows.qpos[:, adr] + 0.3, rows.qpos[:, adr + 1]) - 0.6
    assert (whole.checked, whole.broken) == (1300, int((missed > 1e-4).sum()))
    assert (whole.worst, whole.row) == (pytest.approx(missed.max()), int(missed.argmax()))
    first, second = (kept(rows[part], crate=near)["crate", "0 near m"] for part in (slice(0, 700), slice(700, 1300)))
    assert first.broken + second.broken == whole.broken
    assert max(first.worst, second.worst) == whole.worst


def test_what_applies_nowhere_is_not_counted():
    """A relation to a can that is in no row: nothing is checked, nothing broken, and there is no worst row."""
    rows = layout(MJM, 3)
    present = np.array([[1, 1, 0, 1]] * 3, bool)
    objects = {"crate": {"relations": [{"near": "can", "distance": {"max": 0.1}}]}}
    rows = LayoutTable.from_states(rows.qpos, rows.mocap_pos, rows.mocap_quat, present)
    found = kept(rows, {"some": {"of": ["can"], "count": [0, 1], "missing": "drop"}}, **objects)["crate", "0 near m"]
    assert (found.checked, found.broken, found.row) == (0, 0, -1)
