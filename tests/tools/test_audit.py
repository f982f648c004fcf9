"""The audit as a whole, on rows with known faults."""

from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.tools.audit.auditor import Auditor
from tests.tools.scenes import GAP, MODEL, OBJECTS, bodies, layout, small_config, small_model, with_row

MJM = small_model()
ORDER = list(OBJECTS)
GEOMETRIES = pytest.mark.parametrize("geometry", ["physics", "visual"])


def auditor(geometry: str = "physics", **changes: dict[str, Any]) -> Auditor:
    """Return an auditor of the small scene."""
    return Auditor(MJM, small_config(geometry, changes), bodies(MJM))


def causes(rows: LayoutTable, **changes: dict[str, Any]) -> list[tuple[int, str, str]]:
    """Return what is misplaced in rows, as (row, object, cause)."""
    return [(m.row, m.name, m.cause) for m in auditor("physics", **changes).judge(rows).misplaced]


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


def test_contact_bits_and_exclusions_are_honoured():
    """A can that collides with nothing, and a gem that is excluded from the crate, may be anywhere."""
    spec = mujoco.MjSpec.from_string(MODEL)
    spec.geom("can").contype, spec.geom("can").conaffinity = 2, 2
    spec.add_exclude(bodyname1="gem", bodyname2="crate")
    mjm = spec.compile()
    rows = layout(mjm, can=(0.3, 0, GAP, 0), gem=(0.3, 0, 0.01, 0))
    assert not Auditor(mjm, small_config(), bodies(mjm)).judge(rows).conflicts
    assert len(auditor().judge(rows).conflicts) == 3


def test_fixtures_are_kept_from_the_static_world_though_mujoco_is_silent():
    """A shelf in a static wall is a missed collision."""
    spec = mujoco.MjSpec.from_string(MODEL)
    spec.worldbody.add_geom(name="wall", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.01, 1, 1], pos=[-0.45, 0, 0])
    spec.body("crate").add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.01, 0.01, 0.01], pos=[0, 0, 0.04])
    wall = spec.worldbody.add_body(name="pillar", pos=[0, 0.4, 0])
    wall.add_geom(name="pillar", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.02, 0.5])
    mjm = spec.compile()
    report = Auditor(mjm, small_config(), bodies(mjm)).judge(layout(mjm, shelf=(0, 0.35, GAP, 0)))
    assert {frozenset(c.owners) for c in report.conflicts} == {frozenset({"shelf", "pillar"})}


def test_objects_off_their_support_are_misplaced():
    """Beside the board, above it, below it and off the floor."""
    top = GAP + 0.02 + GAP
    rows = layout(MJM, 6)
    rows = with_row(rows, 1, layout(MJM, gem=(0.1501, -0.04, top, 0)))
    rows = with_row(rows, 2, layout(MJM, gem=(0, -0.04, top + 0.0002, 0)))
    rows = with_row(rows, 3, layout(MJM, gem=(0, -0.04, top - 0.0002, 0)))
    rows = with_row(rows, 4, layout(MJM, can=(-0.5001, 0, GAP, 0)))
    rows = with_row(rows, 5, layout(MJM, gem=(0.1499, -0.04, top, 0)))
    assert causes(rows) == [(1, "gem", "support"), (2, "gem", "support"), (3, "gem", "support"), (4, "can", "support")]


def test_the_shelf_carries_its_objects_wherever_it_stands():
    """A turned and moved shelf, with the gem at the same place on it."""
    yaw, (x, y) = 1.1, (-0.1, 0.2)
    at = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]) @ [0.14, -0.09] + [x, y]
    rows = layout(MJM, shelf=(x, y, GAP, yaw), gem=(*at, GAP + 0.02 + GAP, 0), can=(-0.4, -0.4, GAP, 0))
    report = auditor().judge(rows)
    assert not report.misplaced
    assert not report.conflicts


def test_the_roof_is_judged_by_the_word():
    """Under the shelf's roof `on` is wrong and `inside` right, else the other way round, `in` is always right."""
    top = GAP + 0.02 + GAP
    rows = with_row(layout(MJM, 2), 1, layout(MJM, gem=(0, 0.04, top, 0)))
    assert causes(rows) == [(1, "gem", "support"), (1, "gem", "roof")]
    assert causes(rows, gem={"on": None, "inside": "shelf"}) == [(0, "gem", "roof")]
    assert causes(rows, gem={"on": None, "in": "shelf"}) == []


def test_a_footprint_must_lie_on_its_support_at_ratio_one():
    """At the board's edge the pivot is allowed at ratio 0, at the eroded edge a turned crate overhangs."""
    top = GAP + 0.02 + GAP
    outside, overhanging = layout(MJM, gem=(0.149, -0.04, top, 0)), layout(MJM, gem=(0.1205, -0.04, top, np.pi / 4))
    assert causes(outside) == []
    assert causes(outside, gem={"ratio_on_support": 0.5}) == [(0, "gem", "support")]
    assert causes(overhanging, gem={"ratio_on_support": 0.9}) == []
    turned = layout(MJM, crate=(0.459, 0, GAP, np.pi / 4))
    assert causes(turned, crate={"ratio_on_support": 1.0}) == [(0, "crate", "footprint")]
    assert causes(layout(MJM, crate=(0.459, 0, GAP, 0)), crate={"ratio_on_support": 1.0}) == []


@pytest.mark.parametrize(
    "region",
    [
        {"box": [[0.0, -0.1], [0.1, 0.0]]},
        {"fraction": [[0.5, 0.0], [0.8, 0.5]]},
        {"polygon": [[0, -0.1], [0.1, -0.1], [0.1, 0.0], [0.0, 0.0]]},
    ],
)
def test_regions_crop_the_support(region: dict):
    """The three forms of a region, in the shelf's frame."""
    top = GAP + 0.02 + GAP
    rows = with_row(layout(MJM, 2, gem=(0.05, -0.04, top, 0)), 1, layout(MJM, gem=(-0.05, -0.04, top, 0)))
    assert causes(rows, gem={"region": region}) == [(1, "gem", "support")]


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


def test_penetration_is_what_mujoco_measures():
    """A crate 3 mm in the floor is 3 mm deep."""
    rows = with_row(layout(MJM, 3), 1, layout(MJM, crate=(0.3, 0, -0.003, 0.5)))
    found = auditor().judge(rows).penetration
    assert found.depth == pytest.approx(0.003, abs=1e-6)
    assert found.row == 1
    assert set(found.owners or ()) == {"world", "crate"}


def test_settling_counts_what_moves_and_what_is_fast():
    """A gem that falls off is counted, objects that rest are not."""
    rows = with_row(layout(MJM, 3), 2, layout(MJM, gem=(0.4, -0.3, 0.3, 0)))
    report = auditor().judge(rows, settled=3)
    assert report.settled == 3
    assert report.moved == {"gem": 1, "can": 0, "crate": 0}
    assert report.fast == {"gem": 1, "can": 0, "crate": 0}
    assert report.top_speed > 2.0
