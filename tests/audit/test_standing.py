"""Places of objects against the scene's words: off the edge, above and below it, under a roof, in a region or heap."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.layout.generate import LayoutGenerator
from tests.audit.judging import MJM, auditor, causes
from tests.commands.scenes import GAP, MODEL, bodies, layout, small_config, with_row
from tests.layout.scenes import compile_on_cpu
from tests.scene.heaping import THINGS, folder, words


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


def test_a_shelf_that_leans_carries_nothing():
    """Its board is level to 0.1 degree with the gem on it, or leans by more."""
    rows, degrees = layout(MJM, 2), np.array([0.0999, 0.12])
    lean = Rotation.from_euler("y", degrees[:, None], degrees=True)
    quat = np.array(rows.mocap_quat)
    quat[:, 0] = lean.as_quat(scalar_first=True)
    qpos = np.array(rows.qpos)
    gem = MJM.joint("gem/free").qposadr[0]
    qpos[:, gem : gem + 3] = lean.apply([0, -0.04, 0.02]) + [0, 0, 2 * GAP]
    rows = replace(rows, mocap_quat=quat, qpos=qpos)
    assert [found for found in causes(rows) if found[1] == "gem"] == [(1, "gem", "support")]


def test_the_roof_is_judged_by_the_word():
    """Under the shelf's roof `on` is wrong and `inside` right, else the other way round, `in` is always right."""
    top = GAP + 0.02 + GAP
    rows = with_row(layout(MJM, 2), 1, layout(MJM, gem=(0, 0.04, top, 0)))
    assert causes(rows) == [(1, "gem", "support"), (1, "gem", "overhead")]
    assert causes(rows, gem={"on": None, "inside": "shelf"}) == [(0, "gem", "overhead")]
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
        {"points": [[0.1, 0.05], [0.05, -0.04]]},
    ],
)
def test_regions_crop_the_support(region: dict):
    """The four forms of a region, in the shelf's frame."""
    top = GAP + 0.02 + GAP
    rows = with_row(layout(MJM, 2, gem=(0.05, -0.04, top, 0)), 1, layout(MJM, gem=(-0.05, -0.04, top, 0)))
    assert causes(rows, gem={"region": region}) == [(1, "gem", "support")]


def test_points_are_exact():
    """On the board and in space: 0.1 mm beside a point, and at its mirror image, an object is misplaced."""
    top = GAP + 0.02 + GAP
    rows = with_row(layout(MJM, 3, gem=(0.05, -0.04, top, 0)), 1, layout(MJM, gem=(0.0501, -0.04, top, 0)))
    rows = with_row(rows, 2, layout(MJM, gem=(-0.05, -0.04, top, 0)))
    wrong = [(1, "gem", "support"), (2, "gem", "support")]
    assert causes(rows, gem={"region": {"points": [[0.05, -0.04]]}}) == wrong
    in_space = {"on": None, "region": {"points": [[0.4, 0.4, 0.4], [0.05, -0.04, top]]}}
    assert causes(rows, gem=in_space) == wrong
    in_space["region"] = {"points": [[0.05, -0.04, top + 1e-4]]}
    assert len(causes(rows, gem=in_space)) == 3


def test_what_touches_from_afar_is_put_down_as_high():
    """With contact margins of 2 mm a gem stands 20 um above them; as high as others it would be pushed up."""
    spec = mujoco.MjSpec.from_string(MODEL)
    spec.geom("gem").margin = 0.002
    mjm = spec.compile()
    rows = with_row(layout(mjm, 2), 1, layout(mjm, gem=(0, -0.04, GAP + 0.02 + 0.00202, 0.3)))
    report = Auditor(mjm, small_config(), bodies(mjm)).judge(rows)
    assert [(m.row, m.name, m.cause) for m in report.misplaced] == [(0, "gem", "support")]


@pytest.mark.parametrize("kind", ["fixture", "free"])
def test_heaps_are_sound_and_a_moved_thing_is_found(kind: str):
    """They touch each other and the bin as they may; 0.1 mm aside is no row, and 5 mm down is too deep."""
    compiled = compile_on_cpu(words(folder(), kind=kind), bank=2)
    generator = LayoutGenerator(compiled, 20)
    generator.generate()
    table = generator.table()
    judge = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies)
    report = judge.judge(table, settled=20)
    assert (report.conflicts, report.misplaced) == ([], [])
    assert report.allowed
    assert {why for why, *_ in report.allowed.values()} == {"they lie in a heap"}
    assert {name: report.moved[name] for name in THINGS} == dict.fromkeys(THINGS, 0)
    qpos = np.array(table.qpos)
    adr = compiled.mjm.joint("a/free").qposadr[0]
    qpos[3, adr] += 1e-4
    qpos[5, adr + 2] -= 0.005
    moved = judge.judge(type(table).from_states(qpos, table.mocap_pos, table.mocap_quat, table.present))
    assert {(m.row, m.cause) for m in moved.misplaced} == {(3, "heap"), (5, "heap")}
    assert 5 in {conflict.row for conflict in moved.conflicts}
