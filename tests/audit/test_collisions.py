"""Missed collisions and false alarms, on rows with known faults and against MuJoCo's own distances."""

import mujoco
import numpy as np
import pytest

from tests.audit.judging import GEOMETRIES, MJM, auditor
from tests.commands.scenes import GAP, OBJECTS, layout, with_row
from tests.versions import since_4

ORDER = list(OBJECTS)


@since_4("mj_geomDistance says 0 of some shapes that are apart")
def test_conflicts_are_the_pairs_that_mujoco_finds_too_near():
    """Crowded random rows: a pair is reported exactly where MuJoCo's own distance is below the clearance."""
    rng = np.random.default_rng(3)
    judge = auditor()
    rows = layout(MJM, 200)
    for i in range(len(rows)):
        crowd = {name: tuple(rng.uniform([-0.07, -0.07, 0.0, -3.0], [0.07, 0.07, 0.12, 3.0])) for name in ORDER[1:]}
        rows = with_row(rows, i, layout(MJM, 1, **crowd))
    found = {(c.row, c.geoms) for c in judge.judge(rows).conflicts}
    data = mujoco.MjData(MJM)
    checked = 0
    for i in range(len(rows)):
        rows.put(data, i)
        mujoco.mj_kinematics(MJM, data)
        for pair in judge.collisions.pairs:
            first, second = (judge.collisions.solids[k].geom for k in (pair.first, pair.second))
            if "world" in pair.owners:
                continue  # planes, and what stands on them, have a test of their own
            surplus = mujoco.mj_geomDistance(MJM, data, first, second, 1.0, None) - pair.clearance
            if abs(surplus) > 1e-4:
                assert ((i, (first, second)) in found) == (surplus < 0), (i, pair.owners, surplus)
                checked += 1
    assert len(found) > 200
    assert checked > 2000


@GEOMETRIES
def test_a_pair_within_its_clearance_is_a_missed_collision(geometry: str):
    """The larger clearance of two objects counts, less the tolerance of 0.01 mm."""
    touching = 0.3 - 0.04 - 0.03
    near = [layout(MJM, crate=(0.3, 0, GAP, 0), can=(touching - d, 0, GAP, 0)) for d in (0.00198, 0.002005)]
    found = [auditor(geometry, can={"clearance": 0.002}).judge(rows).conflicts for rows in near]
    assert [len(f) for f in found] == [1, 0]
    assert found[0][0].distance == pytest.approx(0.00198, abs=1e-5)


@GEOMETRIES
def test_an_object_may_touch_what_carries_it_but_not_sink_in(geometry: str):
    """A gem and a crate 0.05 mm into their supports are missed collisions, one that just touches is none."""
    sunk = layout(MJM, gem=(0, -0.04, GAP + 0.02 - 5e-5, 0), crate=(0.3, 0, -5e-5, 0.5))
    flat = {name: {"gap": 0.00002} for name in ("gem", "crate")}
    pairs = {frozenset(c.owners) for c in auditor(geometry, **flat).judge(sunk).conflicts}
    assert pairs == {frozenset({"gem", "shelf"}), frozenset({"crate", "world"})}
    touching = layout(MJM, gem=(0, -0.04, GAP + 0.02, 0), crate=(0.3, 0, 0, 0.5))
    assert not auditor(geometry, **flat).judge(touching).conflicts


@GEOMETRIES
def test_rejected_candidates_are_false_alarms_only_if_they_keep_their_clearance(geometry: str):
    """Candidates that touch, come too near, are enclosed, or are free; what is placed later is not there yet."""
    touching = 0.3 - 0.04 - 0.03
    rows = layout(MJM, 6)
    for i, d in ((0, -0.001), (1, 0.0009), (2, 0.0012), (4, 0.01)):
        rows = with_row(rows, i, layout(MJM, crate=(0.3, 0, GAP, 0), can=(touching - d, 0, GAP, 0)))
    rows = with_row(rows, 3, layout(MJM, crate=(0, -0.04, 0.03, 0)))  # encloses the gem, touches the shelf
    rows = with_row(rows, 5, layout(MJM, crate=(0.3, 0, GAP, 0), can=(touching, 0, GAP, 0)))
    candidate = ["crate", "crate", "crate", "crate", "crate", "can"]
    alarms = auditor(geometry).judge_rejected(rows, candidate, ORDER)
    assert [alarm.row for alarm in alarms] == [2, 4, 5]
    assert alarms[0].surplus == pytest.approx(0.0002, abs=1e-5)
    assert set(alarms[0].owners or ()) == {"can", "crate"}
