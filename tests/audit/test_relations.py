"""The audit of relations and orientations, on rows whose faults are known; and counts over rows, of groups too."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.audit import relations
from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.config.relations import KINDS, Relation
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.layout_table import LayoutTable
from tests.audit.judging import MJM, at, judge_language, kept, missed
from tests.commands.scenes import layout
from tests.layout.related import drawer_mjcf
from tests.layout.scenes import box_mjcf


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


@pytest.mark.parametrize(
    ("side", "align", "crate", "off"),
    [
        ("right", "front", (0.08, 0.01), 0.0),
        ("right", "front", (0.08, 0.03), 0.02),
        ("right", "back", (0.08, 0.01), 0.02),
        ("right", "middle", (0.08, 0.01), 0.01),
        ("left", "back", (-0.08, -0.01), 0.0),
        ("back", "left", (0.01, 0.08), 0.0),
        ("back", "right", (0.01, 0.08), 0.02),
        ("front", "right", (-0.03, -0.08), 0.02),
    ],
)
def test_aligned_ends_are_those_of_the_sides(side: str, align: str, crate: tuple[float, float], off: float):
    """A crate of 8 cm beside a can of 6 cm, as they stand and with both turned."""
    relation = {"beside": "can", "side": side, "gap": 0.01, "align": align}
    assert missed(relation, can=at(0, 0), crate=at(*crate))["m"] == pytest.approx(off, abs=1e-9)
    x, y = np.array([[np.cos(2.0), -np.sin(2.0)], [np.sin(2.0), np.cos(2.0)]]) @ crate
    assert missed(relation, can=at(0, 0, 2.0), crate=at(x, y, 2.0))["m"] == pytest.approx(off, abs=1e-9)


def test_beside_furniture_is_beside_its_root(tmp_path: Path):
    """Two cases with drawers out by 10 and 20 cm, in rows written by hand: the front of the other one is off by 3 mm.

    A bar in front of them keeps off the drawer.
    """
    case: dict[str, Any] = {"asset": drawer_mjcf(tmp_path, "case"), "kind": "fixture", "on": "floor"}
    case["joints"] = {"slide": {"fraction": [0, 1]}}
    row = {"beside": "a", "side": "right", "gap": 0.05, "align": "front"}
    bar = {"beside": "a", "side": "front", "gap": 0.02}
    block = {"asset": box_mjcf(tmp_path, "block", 0.1, 0.04, 0.04), "on": "floor", "relations": [bar]}
    objects = {"a": case, "b": {**case, "relations": [row]}, "block": block}
    scene = build_model(SceneConfig.load({"floor": {"size": [2, 2]}, "objects": objects}))
    for off in (0.0, 0.003):
        qpos = np.zeros((1, scene.mjm.nq))
        qpos[0, [scene.mjm.joint(f"{name}/slide").qposadr[0] for name in "ab"]] = 0.1, 0.2
        adr = scene.mjm.joint("block/free").qposadr[0]
        qpos[0, adr : adr + 7] = [0.0, -0.1 - 0.099 - 0.02 - 0.02, 0.02, 1.0, 0.0, 0.0, 0.0]
        places = np.array([[[0.0, 0.0, 0.0], [0.35, off, 0.0]]])
        table = LayoutTable.from_states(qpos, places, np.tile([1.0, 0, 0, 0], (1, 2, 1)), np.ones((1, 3), bool))
        found = {
            k.name: k for k in judge_language(Auditor(scene.mjm, scene.config, scene.bodies), table) if "0" in k.word
        }
        assert found["b"].worst == pytest.approx(off, abs=1e-6)
        assert found["block"].worst == pytest.approx(0.0, abs=1e-6)


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


def test_sites_that_should_meet_are_found_where_they_are(tmp_path: Path):
    """In rows written by hand: as they should be, moved by 3 mm, and turned by 2 degrees about the site."""
    (tmp_path / "block.xml").write_text(
        '<mujoco><worldbody><body name="block"><geom type="box" size=".1 .1 .1"/><site name="end" pos=".1 .02 0"/>'
        "</body></worldbody></mujoco>"
    )
    words = {"asset": str(tmp_path / "block.xml"), "kind": "fixture", "on": "floor"}
    relation = {"beside": {"of": "a", "site": "end", "of_site": "end"}, "gap": 0.05}
    scene = build_model(
        SceneConfig.load({"floor": {"size": [2, 2]}, "objects": {"a": words, "b": {**words, "relations": [relation]}}})
    )
    yaw = np.radians([180.0, 180.0, 182.0])
    turned = np.stack([np.cos(yaw) * 0.1 - np.sin(yaw) * 0.02, np.sin(yaw) * 0.1 + np.cos(yaw) * 0.02], 1)
    at_site = np.array([[0.15, 0.02], [0.15, 0.023], [0.15, 0.02]])
    places = np.zeros((3, 2, 3))
    places[:, 1, :2] = at_site - turned
    quats = np.zeros((3, 2, 4))
    quats[:, 0, 0], quats[:, 1, 0], quats[:, 1, 3] = 1.0, np.cos(yaw / 2), np.sin(yaw / 2)
    table = LayoutTable.from_states(np.zeros((3, 0)), places, quats, np.ones((3, 2), bool))
    auditor = Auditor(scene.mjm, scene.config, scene.bodies)
    for row, (metres, radians) in enumerate([(0.0, 0.0), (0.003, 0.0), (0.0, np.radians(2.0))]):
        found = {k.unit: k for k in judge_language(auditor, table[slice(row, row + 1)]) if k.word.startswith("0")}
        assert found["m"].worst == pytest.approx(metres, abs=1e-6)
        assert found["rad"].worst == pytest.approx(radians, abs=1e-6)
        assert (found["m"].broken, found["rad"].broken) == (metres > 0.0, radians > 0.0)


def test_every_kind_of_relation_is_judged():
    """By a measure of its own, or by that of its base."""
    assert all(relations._missed.dispatch(kind) is not relations._missed.dispatch(Relation) for kind in KINDS)


@pytest.mark.parametrize(
    ("orientation", "yaw", "off"),
    [
        ("fixed", 0.1, 0.1),
        ({"yaw": [150, 210]}, np.radians(-140), np.radians(10)),
        ({"yaw": [150, 210]}, np.radians(-160), np.radians(-10)),
        ({"face_to": "can"}, np.radians(90), 0.0),
        ({"face_to": "can"}, np.radians(-90), np.pi),
        ({"face_to": "can", "yaw": [10, 20]}, np.radians(75), np.radians(25)),
        ({"with": "can"}, np.radians(60), np.radians(20)),
        ({"with": "can", "yaw": [15, 30]}, np.radians(60), np.radians(-5)),
    ],
)
def test_headings_are_measured(orientation: Any, yaw: float, off: float):
    """Whatever full turns are between; the front is -y, and the can is to the right of the crate, turned by 40."""
    found = kept(layout(MJM, can=at(0.5, 0, np.radians(40)), crate=at(0, 0, yaw)), crate={"orientation": orientation})
    word = next((word for word in ("face_to", "with") if word in orientation), "yaw")
    assert found["crate", f"{word} rad"].worst == pytest.approx(off, abs=1e-5)
    assert found["crate", f"{word} rad"].broken == (off > 1e-3)


def test_nothing_faces_what_is_at_its_own_pivot():
    """So any heading is right there; 0.1 mm apart it is not."""
    for apart, broken in ((0.0, 0), (2e-6, 0), (1e-4, 1)):
        rows = layout(MJM, can=at(apart, 0), crate=at(0, 0, -1.5))
        assert kept(rows, crate={"orientation": {"face_to": "can"}})["crate", "face_to rad"].broken == broken


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
