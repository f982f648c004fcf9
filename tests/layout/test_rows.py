"""Rows of open furniture: units stand flush by MuJoCo C's poses and the boxes of their own files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sceniris_gym
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.layout.tables import make_table
from tests.layout.related import drawer_mjcf
from tests.layout.rows import GAP, OPEN, Units, joints_of, row_of, stands
from tests.layout.scenes import box_mjcf, compile_on_cpu, make, posed, read, valid
from tests.layout.test_redraw import redraw, worlds_of

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


def assert_flush(compiled: Any, assets: list[str], num: int, sides: np.ndarray | None = None, turn: float = 0.0):
    """All layouts are fresh, gaps are right, backs are in line, and headings are those of the unit before."""
    found, fresh = joints_of(compiled, assets, num, sides)
    assert fresh >= 0.99 * num
    for joint in found:
        assert np.abs(joint.gap - GAP).max() < FLUSH
        assert np.abs(joint.back).max() < FLUSH
        assert np.abs(joint.yaw - turn).max() < HEADING


def test_a_row_of_open_units_is_flush(units: Units):
    """Doors, drawers and a lid are drawn open, in a row of four that is itself turned a little."""
    assets = [units["base_doors"][0], units["base_drawers"][0], units["base_doors"][1], units["base_lid"][0]]
    compiled = compile_on_cpu(row_of(assets), bank=4)
    assert_flush(compiled, assets, 1000)
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
        (joint,), fresh = joints_of(compile_on_cpu(each, bank=4), assets, 200)
        assert fresh == 200
        assert np.abs(joint.gap - GAP).max() < FLUSH


def test_a_row_turns_a_corner(units: Units):
    """A chest whose left end is at the back, and a unit to the right of it along the other wall."""
    assets = [units["base_doors"][0], units["base_drawers"][0], units["base_lid"][0], units["base_drawers"][1]]
    scene = row_of(assets)
    scene["objects"]["unit_2"]["orientation"] = {"with": "unit_1", "yaw": [-90, -90]}
    compiled = compile_on_cpu(scene, bank=4)
    found, fresh = joints_of(compiled, assets, 200)
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
    (joint,), fresh = joints_of(compiled, [large, small], 50, to[None])
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


def test_a_redraw_joins_a_unit_where_the_other_one_is_now(units: Units):
    """The last of a row is placed again; a door of the unit before it has meanwhile been opened by hand."""
    assets = [units["base_drawers"][0], units["base_doors"][0]]
    compiled = compile_on_cpu(row_of(assets), bank=4)
    worlds = worlds_of(compiled)
    for joint in compiled.scene.joints("unit_0").values():
        worlds.qpos[:, compiled.mjm.jnt_qposadr[joint]] = compiled.mjm.jnt_range[joint, 1]
    rows = valid(read(redraw(compiled, ("unit_1",), worlds)))
    (joint,) = joints_of(compiled, assets, rows=rows)[0]
    assert len(joint.gap) > 10
    assert np.abs(joint.gap - GAP).max() < FLUSH
    assert np.abs(joint.back).max() < FLUSH
    assert np.abs(joint.yaw).max() < HEADING


def test_a_stored_row_is_served_as_it_was_made(units: Units):
    """From a table, and again from its seed."""
    assets = [units["base_drawers"][0], units["base_doors"][0]]
    compiled = compile_on_cpu(row_of(assets), bank=4)
    table = make_table(compiled, 20, 3)
    stored = StoredLayouts(compiled, table, 20)
    stored.generate()
    assert np.array_equal(stored.layouts.qpos.cpu().numpy(), table.qpos)
    assert np.array_equal(make(compiled, 20, seed=3).mocap_pos, table.mocap_pos)
