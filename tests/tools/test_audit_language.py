"""The audit of relations, orientations and groups, on rows whose faults are known."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.tools.audit.auditor import Auditor
from sceniris_gym.tools.audit.language import Kept
from tests.tools.scenes import GAP, OBJECTS, bodies, layout, small_model

MJM = small_model()


def kept(rows: LayoutTable, groups: dict | None = None, **changes: dict[str, Any]) -> dict[tuple[str, str], Kept]:
    """Return what the audit says of rows, by object and word, where words of objects are changed."""
    objects = {name: {**part, **changes.get(name, {})} for name, part in OBJECTS.items()}
    config = SceneConfig.load({"floor": {"size": [2.0, 2.0]}, "objects": objects, "groups": groups or {}})
    found = Auditor(MJM, config, bodies(MJM)).judge_language(rows)
    return {(k.name, f"{k.word} {k.unit}"): k for k in found}


def missed(relation: dict[str, Any], **poses: tuple[float, float, float, float]) -> dict[str, float]:
    """Return by how much the crate misses a relation, by unit, where objects stand at (x, y, z, yaw)."""
    found = kept(layout(MJM, 1, **poses), crate={"relations": [relation]})
    return {k.unit: k.worst for (name, _), k in found.items() if name == "crate" and k.word[0] == "0"}


def at(x: float, y: float, yaw: float = 0.0) -> tuple[float, float, float, float]:
    """A place on the floor."""
    return (x, y, GAP, yaw)


@pytest.mark.parametrize(
    ("word", "angle", "crate", "off"),
    [
        ("left_of", 30, (-0.5, 0.0), -30.0),
        ("left_of", 30, (-0.5, -0.01), -30.0 + np.degrees(np.arctan(0.02))),
        ("left_of", 30, (-0.5, 0.5), 15.0),
        ("right_of", 90, (-0.5, 0.0), 90.0),
        ("front_of", 90, (0.3, -0.3), -45.0),
        ("back_of", 120, (0.3, -0.3), 15.0),
    ],
)
@pytest.mark.parametrize("yaw", [0.0, 2.5])
def test_angles_are_measured_from_the_heading_of_the_frame(word: str, angle: float, crate, off: float, yaw: float):
    """In the world's frame whatever the anchor's yaw is, and in the anchor's when all is turned with it."""
    relation = {word: "can", "angle": angle}
    fixed = missed({**relation, "frame": "world"}, can=at(0, 0, yaw), crate=at(*crate))
    assert np.degrees(fixed["rad"]) == pytest.approx(off, abs=1e-3)
    c, s = np.cos(yaw), np.sin(yaw)
    turned = missed(relation, can=at(0, 0, yaw), crate=at(c * crate[0] - s * crate[1], s * crate[0] + c * crate[1]))
    assert np.degrees(turned["rad"]) == pytest.approx(off, abs=1e-3)


@pytest.mark.parametrize(
    ("side", "at_yaw_0", "at_yaw_90"),
    [
        ("right", (0.5, 0.0), (0.0, 0.5)),
        ("back", (0.0, 0.5), (-0.5, 0.0)),
        ("left", (-0.5, 0.0), (0.0, -0.5)),
        ("front", (0.0, -0.5), (0.5, 0.0)),
    ],
)
def test_each_side_is_where_it_should_be(side: str, at_yaw_0: tuple, at_yaw_90: tuple):
    """In literal numbers, all the places of the other sides are wrong by a quarter or a half of a turn."""
    relation = {f"{side}_of": "can", "angle": 1}
    for yaw, place in ((0.0, at_yaw_0), (np.pi / 2, at_yaw_90)):
        for quarters, off in ((0, -1.0), (1, 89.0), (2, 179.0), (3, 89.0)):
            x, y = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters]
            crate = (x * place[0] - y * place[1], y * place[0] + x * place[1])
            found = missed(relation, can=at(0, 0, yaw), crate=at(*crate))
            assert np.degrees(found["rad"]) == pytest.approx(off, abs=1e-3)


def at_home(mjm: mujoco.MjModel) -> LayoutTable:
    """Return one row: a model of two bodies as it is written, the second a mocap body."""
    states = mjm.qpos0[None], mjm.body_pos[None, 2:], mjm.body_quat[None, 2:]
    return LayoutTable.from_states(*states, present=np.ones((1, 2), bool))


@pytest.mark.parametrize("joint", ["", "<freejoint/>"])
def test_a_body_that_its_model_has_turned_has_its_sides_turned(joint: str):
    """A desk turned by 90 degrees, which looks to the right; a mark is seen from its own axes."""
    desk = f'<body name="desk" euler="0 0 90">{joint}<geom type="box" size=".2 .1 .1"/></body>'
    mjm = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody>{desk}<body name="mark" mocap="true" pos="0.5 0 0"/></worldbody></mujoco>'
    )
    rows = LayoutTable.from_states(
        mjm.qpos0[None], mjm.body_pos[None, 2:], mjm.body_quat[None, 2:], np.ones((1, 2), bool)
    )
    for side, off in (("front", -1.0), ("back", 179.0), ("left", 89.0), ("right", 89.0)):
        mark = {"kind": "marker", "on": "floor", "relations": [{f"{side}_of": "desk", "angle": 1}]}
        desk = {"asset": "desk", "kind": "free" if joint else "static"}
        config = SceneConfig.load({"floor": {"size": [2, 2]}, "objects": {"desk": desk, "mark": mark}})
        found = Auditor(mjm, config, {"desk": 1, "mark": 2}).judge_language(rows)
        assert {k.word: np.degrees(k.worst) for k in found}[f"0 {side}_of"] == pytest.approx(off, abs=1e-3)


def test_a_robot_is_seen_where_its_base_is():
    """Its arm reaches 1.05 m to the right of its base; a distance from it is one from the base or from its bounds."""
    arm = '<geom type="box" size=".05 .05 .1"/><geom type="box" size=".5 .02 .02" pos=".55 0 .2"/>'
    mjm = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body name="arm" pos=".1 0 0">{arm}</body>'
        '<body name="mark" mocap="true" pos=".1 -.4 0"/></worldbody></mujoco>'
    )
    rows = LayoutTable.from_states(
        mjm.qpos0[None], mjm.body_pos[None, 2:], mjm.body_quat[None, 2:], np.ones((1, 2), bool)
    )
    for measure, distance in (("origin", 0.4), ("bounds", 0.35)):
        relation = {"front_of": "robot", "angle": 1, "distance": {"max": 0.3}, "measure": measure}
        mark = {"kind": "marker", "on": "floor", "relations": [relation]}
        scene = {"floor": {"size": [2, 2]}, "robot": {"asset": "panda"}, "objects": {"mark": mark}}
        found = Auditor(mjm, SceneConfig.load(scene), {"robot": 1, "mark": 2}).judge_language(rows)
        worst = {(k.word, k.unit): k.worst for k in found}
        assert worst["0 front_of", "m"] == pytest.approx(distance - 0.3, abs=1e-9)
        assert worst["0 front_of", "rad"] < 0


def test_distances_are_between_pivots_or_between_bounds():
    """Crates of 8 cm and cans of 6 cm; a crate that is turned by 45 degrees comes nearer with its corner."""
    ring = {"min": 0.2, "max": 0.3}
    assert missed({"near": "can", "distance": ring}, can=at(0, 0), crate=at(0, 0.4))["m"] == pytest.approx(0.1)
    assert missed({"near": "can", "distance": ring}, can=at(0, 0), crate=at(0, 0.15))["m"] == pytest.approx(0.05)
    assert missed({"near": "can", "distance": ring}, can=at(0, 0), crate=at(0, 0.25))["m"] == pytest.approx(-0.05)
    bounds = {"near": "can", "measure": "bounds", "distance": ring}
    assert missed(bounds, can=at(0, 0), crate=at(0, 0.4))["m"] == pytest.approx(0.4 - 0.07 - 0.3)
    turned = missed(bounds, can=at(0, 0), crate=at(0, 0.4, np.pi / 4))["m"]
    assert turned == pytest.approx(0.4 - 0.03 - 0.04 * np.sqrt(2) - 0.3)
    assert missed(bounds, can=at(0, 0), crate=at(0, 0.01))["m"] == pytest.approx(0.2)


def test_beside_is_a_gap_and_one_span_within_the_other():
    """Too near, too far, on the wrong side, and pushed past the edge."""
    beside = {"beside": "can", "side": "right", "gap": 0.01}
    right = 0.03 + 0.01 + 0.04
    assert missed(beside, can=at(0, 0), crate=at(right, 0.01))["m"] == pytest.approx(0.0, abs=1e-9)
    assert missed(beside, can=at(0, 0), crate=at(right + 0.02, 0))["m"] == pytest.approx(0.02)
    assert missed(beside, can=at(0, 0), crate=at(right - 0.02, 0))["m"] == pytest.approx(0.02)
    assert missed(beside, can=at(0, 0), crate=at(-right, 0))["m"] == pytest.approx(2 * right)
    assert missed(beside, can=at(0, 0), crate=at(right, 0.025))["m"] == pytest.approx(0.015)
    turned = at(right * np.cos(0.7), right * np.sin(0.7), 0.7)
    assert missed(beside, can=at(0, 0, 0.7), crate=turned)["m"] == pytest.approx(0.0, abs=1e-9)


def test_between_is_a_hull_or_a_strip():
    """Two anchors make a strip of a width, three a triangle, three on a line a strip again."""
    two = {"between": ["can", "gem"], "width": 0.1}
    ends = {"can": at(-0.5, 0.5), "gem": at(0.5, 0.5)}
    assert missed(two, **ends, crate=at(0.1, 0.56))["m"] == pytest.approx(0.01)
    assert missed(two, **ends, crate=at(0.52, 0.5))["m"] == pytest.approx(0.02)
    assert missed(two, **ends, crate=at(0.49, 0.54))["m"] == pytest.approx(0.0)
    own = {"between": ["can", "gem"]}
    assert missed(own, **ends, crate=at(0.1, 0.56, 0.3))["m"] == pytest.approx(0.02)
    three = {"between": ["can", "shelf", "gem"], "width": 0.1}
    assert missed(three, **ends, shelf=at(0, -0.5), crate=at(0, 0.52))["m"] == pytest.approx(0.02)
    assert missed(three, **ends, shelf=at(0, -0.5), crate=at(0, 0.49))["m"] == pytest.approx(0.0)
    on_line = at(0, 0.5024)  # its tray makes its bounds reach 5 mm further to the front than to the back
    assert missed(three, **ends, shelf=on_line, crate=at(0, 0.56))["m"] == pytest.approx(0.01, abs=1e-4)


@pytest.mark.parametrize(
    ("orientation", "yaw", "off"),
    [
        ("fixed", 0.1, 0.1),
        ({"yaw": [150, 210]}, np.radians(-140), np.radians(10)),
        ({"yaw": [150, 210]}, np.radians(-160), np.radians(-10)),
        ({"face_to": "can"}, np.radians(90), 0.0),
        ({"face_to": "can"}, np.radians(-90), np.pi),
        ({"face_to": "can", "yaw": [10, 20]}, np.radians(75), np.radians(25)),
    ],
)
def test_headings_are_measured(orientation: Any, yaw: float, off: float):
    """Whatever full turns are between; the front is -y, and the can is to the right of the crate."""
    found = kept(layout(MJM, can=at(0.5, 0), crate=at(0, 0, yaw)), crate={"orientation": orientation})
    word = "yaw rad" if isinstance(orientation, str) or "face_to" not in orientation else "face_to rad"
    assert found["crate", word].worst == pytest.approx(off, abs=1e-5)
    assert found["crate", word].broken == (off > 1e-3)


def test_what_leans_is_not_upright_and_what_stands_on_an_edge_is_not_stable():
    """A crate that leans by 10 degrees, and one that lies on another face."""
    rows = layout(MJM, 2)
    adr = MJM.jnt_qposadr[MJM.joint("crate/free").id] + 3
    for row, angle in enumerate((np.radians(10), np.pi / 2)):
        rows.qpos[row, adr : adr + 4] = [np.cos(angle / 2), np.sin(angle / 2), 0, 0]
    assert kept(rows)["crate", "upright rad"].broken == 2
    stable = kept(rows, crate={"orientation": "stable"})["crate", "stable m"]
    assert (stable.broken, stable.row) == (1, 0)
    assert stable.worst == pytest.approx(0.04 * (np.cos(np.radians(10)) - np.sin(np.radians(10))), abs=1e-6)


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


def test_absent_objects_are_judged_by_nothing_else():
    """An absent crate that stands in a can is no conflict, is not misplaced, and has no relations."""
    rows = layout(MJM, 2, crate=(-0.3, 0.0, 0.5, 0.0), can=(-0.3, 0.0, 0.5, 0.0))
    config = {"floor": {"size": [1.0, 1.0]}, "objects": OBJECTS, "groups": {"some": {"of": ["crate"], "count": [0, 1]}}}
    auditor = Auditor(MJM, SceneConfig.load(config), bodies(MJM))
    present = np.array([[1, 1, 1, 1], [1, 1, 1, 0]], bool)
    report = auditor.judge(LayoutTable.from_states(rows.qpos, rows.mocap_pos, rows.mocap_quat, present))
    assert {c.row for c in report.conflicts} == {0}
    assert {(m.row, m.name) for m in report.misplaced} == {(0, "crate"), (0, "can"), (1, "can")}
    assert report.relation_violations == 1


def test_relations_of_many_rows_are_judged_quickly():
    """Four relations in 20,000 rows take seconds, not minutes; the worst row is named."""
    relations = [{"near": "can", "measure": "bounds", "distance": {"max": 0.6}}, {"right_of": "can"}]
    relations += [{"between": ["can", "gem", "shelf"], "width": 0.1}, {"beside": "can", "side": "right"}]
    rows = layout(MJM, 20000)
    rows.qpos[17000] = layout(MJM, crate=at(0.9, 0.0)).qpos[0]
    found = kept(rows, crate={"relations": relations})
    assert (found["crate", "0 near m"].broken, found["crate", "0 near m"].row) == (1, 17000)
    assert found["crate", "3 beside m"].broken == 20000
