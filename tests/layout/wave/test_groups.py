"""Groups: how many and which members are there, what becomes of the others, and of what refers to them."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from scipy import stats

from sceniris_gym.audit.auditor import Auditor
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.tables import make_table
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.related import Shapes, judged, near_middle, related, scene
from tests.layout.scenes import box_mjcf, compile_on_cpu

MEMBERS = list("abcde")
FAR = 20.0


@pytest.fixture(scope="module")
def shapes(tmp_path_factory) -> Shapes:
    """The assets."""
    return Shapes(tmp_path_factory.mktemp("shapes"))


def grouped(shapes: Shapes, count: Any, missing: str = "refuse", **others: Any) -> CompiledScene:
    """Five cubes of which some are there, and what else there is."""
    cubes = {name: {"asset": shapes.cube, "on": "floor"} for name in MEMBERS}
    return scene({**cubes, **others}, groups={"some": {"of": MEMBERS, "count": count, "missing": missing}})


@pytest.mark.parametrize("count", [2, [0, 5], [1, 3], 5, 0], ids=str)
def test_counts_and_members_are_uniform(count: Any, shapes: Shapes):
    """Each number in the interval as often as the others, and each set of that size as often as the others."""
    compiled = grouped(shapes, count)
    table = make_table(compiled, 4000, 0)
    low, high = (count, count) if isinstance(count, int) else count
    number = table.present.sum(1)
    counts = np.bincount(number, minlength=6)
    assert counts[low : high + 1].sum() == 4000
    assert stats.chisquare(counts[low : high + 1]).pvalue > 0.001 or low == high
    keys = table.present @ (1 << np.arange(5))
    for k in range(low, high + 1):
        sets = [sum(1 << i for i in chosen) for chosen in combinations(range(5), k)]
        found = [(keys[number == k] == key).sum() for key in sets]
        assert len(sets) == 1 or stats.chisquare(found).pvalue > 0.001


def test_restarts_do_not_favour_small_sets(shapes: Shapes):
    """Though five cubes hardly fit and need many restarts, five are drawn as often as none."""
    cubes = {name: {"asset": shapes.cube, "on": "floor", "clearance": 0.05} for name in MEMBERS}
    groups = {"some": {"of": MEMBERS, "count": [0, 5]}}
    compiled = scene(cubes, groups=groups, floor={"size": [0.3, 0.3]}, attempts=3, restarts=200)
    generator = LayoutGenerator(compiled, 3000)
    generator.generate()
    assert generator.layouts.first_pass_valid.numpy().mean() < 0.8
    assert (generator.layouts.status.numpy() == LayoutStatus.VALID).all()
    assert stats.chisquare(np.bincount(generator.layouts.present.numpy().sum(1), minlength=6)).pvalue > 0.001


def test_absent_objects_wait_far_away_at_rest(shapes: Shapes):
    """None of them moves within half a second, touches another, or is where another one waits."""
    drawer = near_middle(shapes.drawer, joints={"slide": {"fraction": [0, 1]}})
    compiled = scene(
        {
            "case": drawer,
            **{name: {"asset": shapes.odd, "on": "floor", "orientation": "any"} for name in "ab"},
            "mug": {"asset": shapes.bar, "in": "case/drawer"},
        },
        groups={"some": {"of": ["a", "b", "mug"], "count": 0}},
    )
    mjm = compiled.mjm
    data = mujoco.MjData(mjm)
    make_table(compiled, 1, 0).put(data, 0)
    mujoco.mj_forward(mjm, data)
    assert data.ncon == 0
    start = data.xpos.copy()
    for _ in range(round(0.5 / mjm.opt.timestep)):
        mujoco.mj_step(mjm, data)
    waiting = [compiled.scene.bodies[name] for name in ("a", "b", "mug")]
    assert np.linalg.norm(data.xpos - start, axis=1)[waiting].max() < 0.001
    assert np.abs(data.xpos[waiting, :2]).min() > FAR
    apart = [np.linalg.norm(start[i] - start[j]) for i, j in combinations(waiting, 2)]
    assert min(apart) > 1.0


def test_an_absent_fixture_has_its_joints_at_home(shapes: Shapes):
    """A case whose drawer is drawn open where it is there."""
    case = {"asset": shapes.drawer, "kind": "fixture", "on": "floor", "joints": {"slide": {"fraction": [0.5, 1]}}}
    compiled = scene({"case": case}, groups={"some": {"of": ["case"], "count": [0, 1]}})
    table = make_table(compiled, 400, 0)
    there = table.present[:, 0]
    assert 150 < there.sum() < 250
    assert (table.qpos[~there, 0] == 0.0).all()
    assert (table.qpos[there, 0] >= 0.1).all()
    assert (np.abs(table.mocap_pos[~there, 0, :2]) > FAR).all()


REFERRING = {
    "direction": {"relations": [{"front_of": "a", "distance": {"min": 0.2}}]},
    "near": {"relations": [{"near": "a", "measure": "bounds", "distance": {"max": 0.3}}]},
    "between": {"relations": [{"between": ["a", "b", "z"]}]},
    "between two": {"relations": [{"between": ["a", "b"], "width": 0.2}]},
    "beside": {"relations": [{"beside": "a", "side": "left"}]},
    "frame": {"relations": [{"left_of": "z", "frame": "a", "angle": 30}]},
    "face_to": {"orientation": {"face_to": "a", "yaw": [10, 30]}},
    "all": {
        "relations": [{"front_of": "a"}, {"left_of": "z", "frame": "b"}, {"between": ["c", "d", "e"]}],
        "orientation": {"face_to": "c"},
    },
}


@pytest.mark.parametrize("name", REFERRING)
def test_what_refers_to_the_absent_is_dropped(name: str, shapes: Shapes):
    """It holds wherever enough of it is there, and the object is placed in all worlds."""
    thing = related(shapes.bar, **REFERRING[name])
    compiled = grouped(shapes, [0, 4], "drop", z=near_middle(shapes.odd), q=thing)
    table = make_table(compiled, 1500, 0)
    assert table.valid.mean() > 0.95
    kept = judged(compiled, table)
    assert not [k for k in kept if k.broken]
    mine = [k.checked for k in kept if k.name == "q" and k.word[0].isdigit()]
    assert all(200 < checked < 1500 for checked in mine)
    assert len(mine) >= len(compiled.config.objects["q"].relations)


@pytest.mark.parametrize("name", REFERRING)
def test_what_refers_to_the_absent_is_refused_unless_it_may_be_dropped(name: str, shapes: Shapes):
    """With `missing: refuse`, the default; a group that is always whole refuses nothing."""
    thing = related(shapes.bar, **REFERRING[name])
    with pytest.raises(SceneKeyError, match="may be absent"):
        grouped(shapes, [0, 4], z=near_middle(shapes.odd), q=thing)
    assert grouped(shapes, 5, z=near_middle(shapes.odd), q=thing).object_names[-1] == "q"


def test_the_absent_are_in_nobody_s_way(shapes: Shapes):
    """The whole audit finds nothing, and what is there never touches the floor from above."""
    compiled = grouped(shapes, [0, 5], z=near_middle(shapes.odd))
    report = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies).judge(
        make_table(compiled, 500, 0), settled=100
    )
    assert not report.conflicts
    assert not report.misplaced
    assert not report.relation_violations
    assert report.depth < 1e-4
    assert not any(report.moved.values())


def test_who_is_there_is_a_matter_of_seed_and_episode(shapes: Shapes):
    """Alone or among others, and whatever came before: the same bits."""
    compiled = grouped(shapes, [0, 5], "drop", q=related(shapes.bar, {"between": ["a", "b", "c"]}))
    many = make_table(compiled, 40, 100)
    for i in (0, 7, 39):
        one = LayoutGenerator(compiled, 3, seed=[5, 100 + i, 9])
        for _ in range(2):
            one.generate()
        one.reseed(seed=[5, 100 + i, 9])
        one.generate()
        assert (one.layouts.present.numpy()[1] == many.present[i]).all()
        assert one.layouts.qpos.numpy()[1].tobytes() == many.qpos[i].tobytes()


def test_worlds_that_the_mask_leaves_out_keep_their_members(shapes: Shapes):
    """Their rows do not change by a bit; the others go on to the episode that they would have alone."""
    compiled = grouped(shapes, [0, 5], "drop", q=related(shapes.bar, {"near": "a", "distance": {"max": 0.5}}))
    generator = LayoutGenerator(compiled, 20, seed=3)
    generator.generate()
    before = [a.numpy().copy() for a in (generator.layouts.qpos, generator.layouts.present)]
    mask = np.arange(20) % 3 == 0
    generator.generate(wp.array(mask, dtype=bool, device="cpu"))
    after = [a.numpy() for a in (generator.layouts.qpos, generator.layouts.present)]
    assert all((a[~mask] == b[~mask]).all() for a, b in zip(after, before, strict=True))
    alone = LayoutGenerator(compiled, 1, seed=9)
    alone.generate()
    alone.generate()
    assert (alone.layouts.qpos.numpy()[0] == after[0][6]).all()
    assert (alone.layouts.present.numpy()[0] == after[1][6]).all()


FAR_AWAY = {
    "on a large floor": ({"floor": {"size": [80.0, 80.0]}}, {"cube": {"on": "floor"}}),
    "on a support that gets there": (
        {"floor": {"size": [69.5, 69.5]}},
        {"tower": {"on": "floor", "kind": "fixture"}, "cube": {"on": "tower"}},
    ),
    "in the air": ({}, {"cube": {"region": {"box": [[0, 0, 1], [45, 39, 2]]}}}),
}


@pytest.mark.parametrize("name", FAR_AWAY)
def test_nothing_is_placed_where_the_absent_wait(name: str, tmp_path: Path):
    """Objects that could get there are refused, since parked ones are not tested; without groups they are not."""
    words, objects = FAR_AWAY[name]
    sizes = {"cube": (0.3, 0.3, 0.3), "tower": (1.2, 1.2, 1.2)}
    cubes = {n: {"asset": box_mjcf(tmp_path, n, *sizes[n]), **part} for n, part in objects.items()}
    small = {"asset": box_mjcf(tmp_path, "small", 0.1, 0.1, 0.1), "region": {"box": [[0, 0, 1], [1, 1, 2]]}}
    some = {"groups": {"some": {"of": ["small"], "count": [0, 1]}}}
    assert scene({"small": small, **cubes}, **words).placed
    with pytest.raises(SceneKeyError, match=rf"objects\.{[*objects][-1]}: reaches .* are parked from \(40, 40\) m on"):
        scene({"small": small, **cubes}, **words, **some)


@pytest.mark.parametrize("side", [0, 1])
def test_a_scene_that_is_long_on_one_side_alone_may_have_groups(side: int, shapes: Shapes):
    """It passes the place where the absent wait, and the audit finds nothing."""
    size = [180.0, 2.0] if side == 0 else [2.0, 180.0]
    cubes = {name: {"asset": shapes.cube, "on": "floor"} for name in MEMBERS}
    compiled = scene(cubes, groups={"some": {"of": MEMBERS, "count": [0, 5]}}, floor={"size": size})
    report = Auditor(compiled.mjm, compiled.config, compiled.scene.bodies).judge(
        make_table(compiled, 200, 0), settled=20
    )
    assert not report.conflicts
    assert not report.misplaced
    assert not report.relation_violations
    assert not any(report.moved.values())


@pytest.mark.parametrize("where", ["without a plane", "with a plane far below"])
def test_more_than_a_square_of_absent_objects_lie_at_rest(where: str, tmp_path: Path):
    """Eighty that are in the air where they are there; the last ones wait in a tenth row."""
    cube = {"asset": box_mjcf(tmp_path, "cube", 0.05, 0.05, 0.05), "region": {"box": [[-1, -1, 1], [1, 1, 2]]}}
    names = [f"cube_{i}" for i in range(80)]
    model = tmp_path / "model.xml"
    model.write_text('<mujoco><worldbody><geom type="plane" size="1 1 1" pos="0 0 -1"/></worldbody></mujoco>')
    words: dict[str, Any] = {"model": str(model)} if where == "with a plane far below" else {}
    config = {"objects": dict.fromkeys(names, cube), "groups": {"some": {"of": names, "count": 0}}, **words}
    compiled = compile_on_cpu(config, bank=1)
    data = mujoco.MjData(compiled.mjm)
    make_table(compiled, 1, 0).put(data, 0)
    start = data.qpos.reshape(-1, 7)[:, :3].copy()
    for _ in range(round(0.3 / compiled.mjm.opt.timestep)):
        mujoco.mj_step(compiled.mjm, data)
    assert np.abs(data.qpos.reshape(-1, 7)[:, :3] - start).max() < 0.001


def test_a_plane_over_the_waiting_place_is_refused(tmp_path: Path):
    """A model whose ground is at half a metre has absent objects in it."""
    model = tmp_path / "model.xml"
    model.write_text(
        '<mujoco><worldbody><geom name="top" type="plane" size="1 1 1" pos="0 0 .5"/></worldbody></mujoco>'
    )
    cube = {"asset": box_mjcf(tmp_path, "cube", 0.05, 0.05, 0.05), "region": {"box": [[-1, -1, 1], [1, 1, 2]]}}
    config = {"model": str(model), "objects": {"cube": cube}}
    assert compile_on_cpu(config, bank=1).placed == ("cube",)
    with pytest.raises(SceneKeyError, match=r"the plane 'top' lies above the ground .* at \(40, 40\) m"):
        compile_on_cpu({**config, "groups": {"some": {"of": ["cube"], "count": [0, 1]}}})


def test_what_is_too_large_to_wait_is_refused(tmp_path: Path):
    """Two slabs of 3 m would lie in each other where they wait; one that is always there never does."""
    slab = {"asset": box_mjcf(tmp_path, "slab", 3.0, 0.5, 0.1), "on": "floor"}
    groups: dict[str, dict] = {"some": {"of": ["one", "two"], "count": [0, 2]}}
    with pytest.raises(SceneKeyError, match="is 3 m wide and may be absent"):
        scene({"one": slab, "two": slab}, groups=groups, floor={"size": [20.0, 20.0]})
    groups["some"]["count"] = 2
    assert scene({"one": slab, "two": slab}, groups=groups, floor={"size": [20.0, 20.0]}).placed == ("one", "two")
