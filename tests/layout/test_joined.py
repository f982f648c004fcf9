"""Objects joined at sites: in MuJoCo C's own poses the sites meet, and their x axes are turned as the scene says."""

from __future__ import annotations

import pickle
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.errors import InfeasibleSceneError, UnknownNameError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from tests.audit.judging import judge_language
from tests.layout.scenes import compile_on_cpu, posed, read, valid, write_mjcf

SITES = '<site name="left" pos="-.1 .02 .05" euler="0 0 180"/><site name="right" pos=".1 .02 .05" euler="0 0 20"/>'
MET = 4e-5  # m; where the sites meet is drawn in a square of 40 um


@pytest.fixture(scope="module")
def counter(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A block with a site at each end, its bounds not around its root's origin."""
    geom = '<geom type="box" size=".1 .06 .05" pos="0 .01 .05"/>'
    return write_mjcf(tmp_path_factory.mktemp("joined"), "counter", geom + SITES)


def joined(counter: str, kind: str = "fixture", gap: float = 0.03, **words: Any) -> dict[str, Any]:
    """A scene of a counter anywhere, and one that is joined to its right."""
    beside = {"of": "a", "site": "left", "of_site": "right", **words}
    objects = {
        "a": {"asset": counter, "kind": "fixture", "on": "floor"},
        "b": {"asset": counter, "kind": kind, "on": "floor", "relations": [{"beside": beside, "gap": gap}]},
    }
    return {"floor": {"size": [1.5, 1.5]}, "objects": objects}


def sites(compiled: CompiledScene, num: int, its: str = "a/right", own: str = "b/left") -> tuple[np.ndarray, ...]:
    """Return the positions of two sites in fresh layouts, the first's heading, and the second's relative to it."""
    generator = LayoutGenerator(compiled, num)
    generator.generate()
    found = []
    for data in posed(compiled, valid(read(generator.layouts))):
        axes = [data.site(name).xmat.reshape(3, 3)[:, 0] for name in (its, own)]
        headings = [np.arctan2(axis[1], axis[0]) for axis in axes]
        found.append((data.site(its).xpos[:2].copy(), data.site(own).xpos[:2].copy(), *headings))
    its_at, own_at, its_yaw, own_yaw = (np.array(column) for column in zip(*found, strict=True))
    return its_at, own_at, its_yaw, np.angle(np.exp(1j * (own_yaw - its_yaw)))


@pytest.mark.parametrize("kind", ["fixture", "free"])
@pytest.mark.parametrize(("turn", "gap"), [(180.0, 0.03), (0.0, 0.25), (-90.0, 0.1)])
def test_sites_meet_and_are_turned_as_the_scene_says(counter: str, kind: str, turn: float, gap: float):
    """The gap is along the other one's x axis; wherever that one stands, and however it is turned."""
    its, own, yaw, between = sites(compile_on_cpu(joined(counter, kind, gap, angle=turn), bank=4), 200)
    assert len(its) > 100
    ahead = np.stack([np.cos(yaw), np.sin(yaw)], 1)
    assert np.abs(own - its - gap * ahead).max() < MET
    assert np.abs(np.angle(np.exp(1j * (between - np.radians(turn))))).max() < 1e-5
    assert np.std(np.cos(yaw)) > 0.5


def test_without_a_gap_they_coincide_and_face_each_other(counter: str):
    """The default; the things themselves are kept apart as ever, so that these have the sites a bit outside."""
    scene = joined(counter)
    scene["objects"]["b"]["relations"] = [{"beside": {"of": "a", "site": "far", "of_site": "right"}}]
    folder = Path(counter).parent
    geom = '<geom type="box" size=".1 .06 .05" pos="0 0 .05"/><site name="far" pos="-.16 0 0" euler="0 0 180"/>'
    scene["objects"]["b"]["asset"] = write_mjcf(folder, "far", geom)
    its, own, _, between = sites(compile_on_cpu(scene, bank=4), 100, own="b/far")
    assert np.abs(own - its).max() < MET
    assert np.abs(np.abs(between) - np.pi).max() < 1e-5


def test_sites_on_the_very_ends_leave_no_clearance_and_the_error_says_what_to_do(counter: str):
    """A gap of nothing: the things touch wherever they are, and more room would not help."""
    says = r"because of collision.* The object is joined to 'a': give 'beside' a 'gap' of a few millimetres"
    with pytest.raises(InfeasibleSceneError, match=says) as raised:
        compile_on_cpu(joined(counter, gap=0.0))
    assert str(pickle.loads(pickle.dumps(raised.value))) == str(raised.value)


def test_one_can_be_joined_to_what_stays_where_the_model_has_it(tmp_path: Path):
    """A body of the user's model, turned and with an offset of its own."""
    (tmp_path / "room.xml").write_text(
        '<mujoco><worldbody><geom type="plane" size="3 3 .1"/>'
        f'<body name="wall" pos=".4 .3 0" euler="0 0 35"><geom type="box" size=".1 .06 .05" pos="0 .01 .05"/>{SITES}'
        "</body></worldbody></mujoco>"
    )
    crate = write_mjcf(tmp_path, "crate", '<geom type="box" size=".05 .05 .05"/><site name="me" pos="-.05 0 0"/>')
    relation = {"beside": {"of": "wall", "site": "me", "of_site": "right", "angle": 90}, "gap": 0.1}
    words = {"asset": crate, "on": "floor", "relations": [relation]}
    objects = {"wall": {"kind": "static"}, "crate": words}
    scene = {"model": str(tmp_path / "room.xml"), "floor": {"size": [2, 2]}, "objects": objects}
    its, own, yaw, between = sites(compile_on_cpu(scene, bank=1), 20, "right", "crate/me")
    assert yaw == pytest.approx(np.full(len(yaw), np.radians(55)), abs=1e-6)
    assert np.abs(own - its - 0.1 * np.array([np.cos(yaw[0]), np.sin(yaw[0])])).max() < MET
    assert between == pytest.approx(np.full(len(yaw), np.pi / 2), abs=1e-5)


@pytest.mark.parametrize("turn", [180.0, 90.0])
def test_they_meet_at_the_site_of_the_variant_that_is_there(tmp_path: Path, turn: float):
    """A row of three, each one of two blocks: long and straight, or a short one whose end is turned by 70 degrees."""
    blocks = []
    for name, half, yaw in (("long", 0.2, 0), ("corner", 0.1, 70)):
        site = f'<site name="{{}}" pos="{half + 0.01} .02 .05" euler="0 0 {{}}"/>'
        ends = site.format("right", yaw) + site.format("left", 180).replace('pos="', 'pos="-')
        door = (
            f'<body pos="{half} 0 0"><joint range="0 90"/><geom type="box" size=".01 .01 .01" pos="0 .2 .05"/></body>'
        )
        geom = f'<geom type="box" size="{half} .06 .05" pos="0 .01 .05"/>'
        blocks.append(write_mjcf(tmp_path, name, geom + ends + door))
    unit: dict[str, Any] = {"asset": blocks, "kind": "fixture", "on": "floor", "joints": {"*": {"fraction": [0, 0.1]}}}
    objects = {"a": dict(unit)}
    for before, name in ("ab", "bc"):
        beside = {"of": before, "site": "left", "of_site": "right", "angle": turn}
        objects[name] = {**unit, "relations": [{"beside": beside, "gap": 0.3}]}
    compiled = compile_on_cpu({"floor": {"size": [9, 9]}, "objects": objects}, bank=8)
    table = make_table(compiled, 200, 0)
    rows = table[table.valid]
    assert len(rows.qpos) > 150
    seen = set()
    for data in posed(compiled, rows):
        there = [min((f"{n}/long", f"{n}/corner"), key=lambda m: np.linalg.norm(data.body(m).xpos)) for n in "abc"]
        seen.add(tuple(there))
        for before, after in pairwise(there):
            its, own = data.site(f"{before}/right"), data.site(f"{after}/left")
            ahead, axis = its.xmat.reshape(3, 3)[:2, 0], own.xmat.reshape(3, 3)[:2, 0]
            assert np.linalg.norm(own.xpos[:2] - its.xpos[:2] - 0.3 * ahead) < MET
            between = np.arctan2(ahead[0] * axis[1] - ahead[1] * axis[0], ahead @ axis)
            assert np.abs(np.angle(np.exp(1j * (between - np.radians(turn))))) < 1e-5
    assert len(seen) == 8
    judge = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies)
    assert [k for k in judge_language(judge, rows) if k.broken] == []
    rows.mocap_pos[:, :, 0] *= 1.01
    assert {k.name[0] for k in judge_language(judge, rows) if k.broken and "beside" in k.word} == {"b", "c"}


def test_a_variant_without_the_site_is_named(counter: str):
    """With the sites that it has."""
    scene = joined(counter)
    scene["objects"]["a"]["asset"] = ["mug", counter]
    says = r"b\.relations\.0\.beside\.of_site: unknown site of 'a/mug' 'right'"
    with pytest.raises(UnknownNameError, match=says):
        compile_on_cpu(scene)


def test_where_the_other_one_is_absent_it_stands_anywhere(counter: str):
    """With `missing: drop`, as with all relations."""
    scene = joined(counter)
    scene["groups"] = {"some": {"of": ["a"], "count": [0, 1], "missing": "drop"}}
    compiled = compile_on_cpu(scene, bank=4)
    generator = LayoutGenerator(compiled, 100)
    generator.generate()
    rows = read(generator.layouts)
    absent = generator.layouts.present.numpy()[:, 0] == 0
    places = np.array([data.body("b").xpos[:2].copy() for data in posed(compiled, rows)])[absent]
    assert 20 < absent.sum() < 80
    assert np.ptp(places, axis=0).min() > 0.8
