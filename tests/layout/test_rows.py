"""Rows of open furniture: units stand flush by MuJoCo C's poses and the boxes of their own files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sceniris_gym
from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.commands.replay import replay
from sceniris_gym.errors import FallbackWarning, InfeasibleSceneError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.part import chosen_objects
from tests.audit.judging import judge_language
from tests.layout.related import drawer_mjcf
from tests.layout.rows import GAP, OPEN, Units, joints_of, root_corners, row_of, stands
from tests.layout.scenes import box_mjcf, compile_on_cpu, make, posed, read, valid
from tests.layout.sizes import made, sizes
from tests.layout.test_redraw import redraw, worlds_of

VARIED = pytest.mark.parametrize("variants", [False, True], ids=["one", "variants"])
FLUSH = 1e-4  # m
HEADING = 1e-6  # rad
SIDES = {"right": (1.0, 0.0), "back": (0.0, 1.0), "left": (-1.0, 0.0), "front": (0.0, -1.0)}


@pytest.fixture(scope="module")
def units(tmp_path_factory: pytest.TempPathFactory) -> Units:
    """Assets of built units, by kind."""
    folder = tmp_path_factory.mktemp("units")
    sceniris_gym.furniture(folder, n=24, seed=0)
    return {
        kind: [str(path) for path in sorted(folder.glob(f"{kind}_*.xml"))]
        for kind in ("base_drawers", "base_doors", "base_lid", "base_shelves", "counter")
    }


def varied(units: Units, i: int) -> list[str]:
    """Return variants of a unit: drawers, doors, and one without joints."""
    return [units[kind][i] for kind in ("base_drawers", "base_doors", "base_shelves")]


def two(units: Units, variants: bool) -> list[Any]:
    """Return the assets of a row of two, with or without variants."""
    return [varied(units, 0), varied(units, 1)] if variants else [units["base_drawers"][0], units["base_doors"][0]]


def assert_flush(compiled: Any, num: int):
    """All layouts are fresh, gaps are right, backs are in line, and headings are those of the unit before."""
    found, fresh = joints_of(compiled, num)
    assert fresh >= 0.99 * num
    for joint in found:
        assert np.abs(joint.gap - GAP).max() < FLUSH
        assert np.abs(joint.back).max() < FLUSH
        assert np.abs(joint.yaw).max() < HEADING


def test_a_row_of_open_units_is_flush(units: Units):
    """Doors, drawers and a lid are drawn open, in a row of four that is itself turned a little."""
    assets = [units["base_doors"][0], units["base_drawers"][0], units["base_doors"][1], units["base_lid"][0]]
    compiled = compile_on_cpu(row_of(assets), bank=4)
    assert_flush(compiled, 1000)
    kept = stands(compiled, 200)
    assert {k.word for k in kept} >= {"0 beside", "with"}
    assert [k for k in kept if k.broken] == []


def test_open_doors_do_not_keep_furniture_apart(units: Units):
    """Two units with doors, and one that always stays where it is: the gap is between what no joint moves."""
    assets = [units["base_doors"][0], units["base_doors"][1]]
    apart = {"relations": [{"beside": "unit_0", "side": "right", "gap": GAP}], "orientation": "fixed"}
    scene = row_of(assets, **apart)
    scene["objects"]["unit_0"]["orientation"] = "fixed"
    still = row_of(assets, **apart)
    still["objects"]["unit_0"] = {"asset": assets[0], "kind": "static", "joints": OPEN}
    for each in (scene, still):
        (joint,), fresh = joints_of(compile_on_cpu(each, bank=4), 200)
        assert fresh == 200
        assert np.abs(joint.gap - GAP).max() < FLUSH


def test_a_row_turns_a_corner(units: Units):
    """A chest whose left end is at the back, and a unit to the right of it along the other wall."""
    assets = [units["base_doors"][0], units["base_drawers"][0], units["base_lid"][0], units["base_drawers"][1]]
    scene = row_of(assets)
    scene["objects"]["unit_2"]["orientation"] = {"with": "unit_1", "yaw": [-90, -90]}
    compiled = compile_on_cpu(scene, bank=4)
    found, fresh = joints_of(compiled, 200)
    assert fresh >= 190
    for joint, turn in zip(found, (0.0, -np.pi / 2, 0.0), strict=True):
        assert np.abs(joint.gap - GAP).max() < FLUSH
        assert np.abs(joint.back).max() < FLUSH
        assert np.abs(joint.yaw - turn).max() < HEADING


ALIGNED = [(s, a) for s in SIDES for a in (*SIDES, "middle") if a == "middle" or not np.dot(SIDES[s], SIDES[a])]


@pytest.mark.parametrize(("side", "align"), ALIGNED)
@pytest.mark.parametrize("frame", ["anchor", "robot"])
def test_ends_are_in_line_on_every_side(side: str, align: str, frame: str, tmp_path: Path):
    """Of two blocks of different sizes, the anchor turned anyhow; a robot's front is along x, and its left along y."""
    small, large = box_mjcf(tmp_path, "small", 0.1, 0.06, 0.05), box_mjcf(tmp_path, "large", 0.3, 0.2, 0.05)
    relation = {"beside": "unit_0", "side": side, "gap": GAP, "align": align, "frame": frame}
    scene = row_of([large, small], relations=[relation])
    scene["objects"]["unit_0"].update(region={"box": [[-0.5, -0.5], [0.5, 0.5]]}, orientation={"yaw": [-180, 180]})
    turned = dict(SIDES)
    if frame == "robot":
        scene["robot"] = {"asset": drawer_mjcf(tmp_path, "robot"), "base": [1.5, 1.5, 0.0], "yaw": 30}
        scene["objects"]["unit_0"]["orientation"] = {"with": "robot"}
        turned = {"front": (1.0, 0.0), "left": (0.0, 1.0), "back": (-1.0, 0.0), "right": (0.0, -1.0)}
    compiled, to = compile_on_cpu(scene, bank=4), np.array(turned[side])
    (joint,), fresh = joints_of(compiled, 50, to[None])
    assert fresh == 50
    assert np.abs(joint.gap - GAP).max() < FLUSH
    is_left = align != "middle" and np.dot(turned[align], [-to[1], to[0]]) > 0.0
    off = 0.5 * (joint.back + joint.front) if align == "middle" else joint.back if is_left else joint.front
    assert np.abs(off).max() < FLUSH
    assert np.abs(joint.back - joint.front).min() > 0.05
    assert [k for k in stands(compiled, 50) if k.broken] == []


def test_without_the_other_unit_it_stands_anywhere_with_the_heading_of_its_support(units: Units):
    """With `missing: drop`, as all references."""
    assets = [units["base_doors"][0], units["base_drawers"][0]]
    scene = row_of(assets, orientation={"with": "unit_0", "yaw": [30, 30]})
    scene["groups"] = {"some": {"of": ["unit_0"], "count": [0, 1], "missing": "drop"}}
    compiled = compile_on_cpu(scene, bank=4)
    generator = LayoutGenerator(compiled, 100)
    generator.generate()
    absent = generator.layouts.present.cpu().numpy()[:, 0] == 0
    assert 20 < absent.sum() < 80
    found = []
    for data in posed(compiled, read(generator.layouts)[absent]):
        body = data.body("unit_1")
        found.append([*body.xpos[:2], np.arctan2(body.xmat[3], body.xmat[0])])
    x, y, yaw = np.array(found).T
    assert min(np.ptp(x), np.ptp(y)) > 3.0
    assert np.abs(yaw - np.radians(30)).max() < HEADING
    assert [k for k in stands(compiled, 100) if k.broken] == []


def test_a_unit_follows_the_variant_that_is_there(units: Units, tmp_path: Path):
    """Blocks of two widths: an open unit stands beside either of them, with its heading."""
    wide, narrow = box_mjcf(tmp_path, "wide", 0.9, 0.5, 0.4), box_mjcf(tmp_path, "narrow", 0.4, 0.5, 0.4)
    scene = row_of([wide, units["base_doors"][0]])
    del scene["objects"]["unit_0"]["asset"]
    scene["objects"]["unit_0"]["variants"] = {"wide": {"asset": wide}, "narrow": {"asset": narrow}}
    compiled = compile_on_cpu(scene, bank=4)
    kept = [k for k in stands(compiled, 200) if k.name == "unit_1"]
    assert {(k.word, k.checked, k.broken) for k in kept} >= {("0 beside", 200, 0), ("with", 200, 0)}


@VARIED
def test_a_redraw_joins_a_unit_where_the_other_one_is_now(units: Units, variants: bool):
    """The last of a row is placed again; doors of the unit before it have meanwhile been opened by hand."""
    compiled = compile_on_cpu(row_of(two(units, variants)), bank=4)
    worlds = worlds_of(compiled)
    for name in compiled.config.variants.get("unit_0", ("unit_0",)):
        for joint in compiled.scene.joints(name).values():
            worlds.qpos[:, compiled.mjm.jnt_qposadr[joint]] = compiled.mjm.jnt_range[joint, 1]
    found = redraw(compiled, chosen_objects(compiled, "unit_1", "here"), worlds)
    rows = valid(read(found))
    assert np.array_equal(found.present.numpy(), worlds.present)
    (joint,) = joints_of(compiled, rows=rows)[0]
    assert len(joint.gap) > 10
    assert np.abs(joint.gap - GAP).max() < FLUSH
    assert np.abs(joint.back).max() < FLUSH
    assert np.abs(joint.yaw).max() < HEADING


@VARIED
def test_a_stored_row_is_served_as_it_was_made(units: Units, variants: bool):
    """From a table, from its seed, and from its id."""
    compiled = compile_on_cpu(row_of(two(units, variants)), bank=4)
    table = make_table(compiled, 20, 3)
    stored = StoredLayouts(compiled, table, 20)
    stored.generate()
    assert np.array_equal(stored.layouts.qpos.cpu().numpy(), table.qpos)
    assert np.array_equal(stored.layouts.present.cpu().numpy(), table.present)
    assert np.array_equal(make(compiled, 20, seed=3).mocap_pos, table.mocap_pos)
    again = replay(compiled, LayoutId.parse(compiled.layout_id(3 + 7, 0)))
    for name in ("qpos", "mocap_pos", "mocap_quat", "present"):
        assert np.array_equal(getattr(again, name)[0], getattr(table, name)[7]), name


def test_a_row_of_variants_has_the_same_bits_in_any_search(units: Units):
    """Few trials at once or many, and a few worlds of many."""
    compiled = compile_on_cpu(row_of([varied(units, i) for i in range(3)]), bank=4)
    first, *others = (made(compiled, size, 12) for size in [None, *list(sizes("cpu").values())[1::4]])
    assert all(other == first for other in others)
    assert make(compiled, 40, seed=5)[:7].bits() == make(compiled, 7, seed=5).bits()


def test_a_kitchen_of_other_units_in_every_layout(units: Units):
    """Six units along a wall, of a folder of files: all are flush, whichever are drawn, also in the split eval."""
    folder = Path(units["counter"][0]).parent
    scene = row_of([varied(units, 0)] * 6)
    for unit in scene["objects"].values():
        unit.update(asset=f"{folder.name}/base_*.xml", holdout=0.2)
    (folder.parent / "kitchen.yaml").write_text(json.dumps(scene))
    compiled = compile_on_cpu(str(folder.parent / "kitchen.yaml"), bank=4)
    assert_flush(compiled, 1000)
    train, held_out = (make_table(compiled, 200, 0, split=split) for split in ("train", "eval"))
    assert train.present.any(axis=0).sum() == 6 * 13
    assert np.array_equal(held_out.present.any(axis=0), ~train.present.any(axis=0))
    for joint in joints_of(compiled, rows=held_out)[0]:
        assert np.abs(joint.gap - GAP).max() < FLUSH
        assert np.abs(joint.back).max() < FLUSH


@pytest.mark.parametrize(
    ("along", "turned", "corner"),
    [
        ("right", 2, {"side": "right", "align": "back", "yaw": -90}),
        ("right", 3, {"side": "front", "align": "right", "yaw": -90}),
        ("left", 2, {"side": "left", "align": "back", "yaw": 90}),
    ],
    ids=["out of the corner", "in front of the corner", "to the left"],
)
def test_a_row_of_variants_turns_a_corner(units: Units, along: str, turned: int, corner: dict[str, Any]):
    """The last of four units are along another wall."""
    scene = row_of(
        [varied(units, 0), varied(units, 1), [units["base_shelves"][3], units["base_lid"][0]], varied(units, 2)]
    )
    sides, yaws = [along] * 3, [0.0] * 3
    sides[turned - 1], yaws[turned - 1] = corner["side"], corner["yaw"]
    for i in range(1, 4):
        unit = scene["objects"][f"unit_{i}"]
        unit["joints"] = {"*": {"fraction": [0.0, 0.3]}}
        unit["relations"][0].update(side=sides[i - 1], align=corner["align"] if i == turned else "back")
        unit["orientation"]["yaw"] = [yaws[i - 1]] * 2
    compiled = compile_on_cpu(scene, bank=4)
    found, fresh = joints_of(compiled, 200, np.array([SIDES[side] for side in sides]))
    assert fresh >= 190
    for joint, side, yaw in zip(found, sides, yaws, strict=True):
        assert np.abs(joint.gap - GAP).max() < FLUSH
        assert np.abs(joint.front if side == "left" else joint.back).max() < FLUSH
        assert np.abs(joint.yaw - np.radians(yaw)).max() < HEADING


def test_the_audit_finds_a_unit_that_stands_off_in_a_row_of_variants(units: Units):
    """By 1 mm, to the side and to the front, in any world; unit 1 is then off, and unit 2 which stands beside it."""
    compiled = compile_on_cpu(row_of([varied(units, i) for i in range(3)]), bank=4)
    judge, table = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies), make_table(compiled, 16, 0)
    mocap = compiled.mjm.body_mocapid[[compiled.scene.bodies[name] for name in compiled.config.variants["unit_1"]]]
    for axis in range(2):
        moved = replace(table, mocap_pos=table.mocap_pos.copy())
        moved.mocap_pos[:, mocap, axis] += 0.001
        kept = [k for k in judge_language(judge, moved) if "beside" in k.word]
        assert sum(k.checked for k in kept) == sum(k.broken for k in kept) == 2 * 16
        assert all(0.0009 < k.worst < 0.0011 for k in kept)


def test_a_row_that_is_longer_than_its_wall_comes_from_the_bank(units: Units):
    """Layouts are fresh exactly in worlds whose units fit; a warning or an error names a unit and its relation."""
    scene = row_of([units["counter"][0], *[varied(units, i) for i in range(3)]])
    scene["objects"]["unit_0"] |= {"region": {"points": [[0, 0]]}, "orientation": "fixed"}
    free = compile_on_cpu(scene, bank=4)
    widths = np.array([np.ptp(root_corners(str(part.asset))[:, 0]) for part in free.config.objects.values()])
    drawn = make_table(free, 300, 0)
    row = np.array([widths[there] for there in drawn.present])
    at = row @ [0.5, 1.0, 1.0, 0.5] + 3 * GAP
    end = at[row[:, 1] == row[:, 1].max()].min() + 0.06  # the widest second unit fits with some others
    assert np.abs(at - end).min() > 1e-3
    scene["objects"]["unit_3"]["region"] = {"box": [[-1, -1], [end, 1]]}
    with pytest.warns(FallbackWarning, match=r"'unit_3/.* wider 'beside unit_2, right, gap 0\.004 m, align back'"):
        compiled = compile_on_cpu(scene, bank=16)
    table = make_table(compiled, 300, 0)
    assert 50 < (at < end).sum() < 250
    assert np.array_equal(table.valid, at < end)
    for joint in joints_of(compiled, rows=table)[0]:
        assert np.abs(joint.gap - GAP).max() < FLUSH
    scene["objects"]["unit_3"]["region"] = {"box": [[-1, -1], [0.5, 1]]}
    with pytest.raises(InfeasibleSceneError, match=r"'unit_3/.*empty.*'beside unit_2"):
        compile_on_cpu(scene, bank=4)
