"""Blame for collisions: the pairs of geoms that a rejected candidate hits, by their distances in closed form."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.layout.blame import _REMEDIES, Blame, _least_likely, _of_collision, _of_leaning, _rejections
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from tests.layout.scenes import full_tray, make, posed, valid

SIZE, CLEARANCE = 0.1, 0.001


def test_a_rejected_candidate_hits_what_it_is_too_near_to(tmp_path: Path):
    """Crates along the axes: those placed before that are within the clearance, the worst first, and no others."""
    compiled = full_tray(tmp_path)
    generator = LayoutGenerator._recording(compiled, 100, seed=1, rejected=200)
    generator.generate()
    view, mjm, data = generator.layouts.view, compiled.mjm, mujoco.MjData(compiled.mjm)
    count, blame = int(view.rejected_count.numpy()[0]), Blame(compiled)
    assert 20 < count < 200
    for number, qpos in zip(view.rejected_object.numpy()[:count], view.rejected_qpos.numpy()[:count], strict=True):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(mjm, data)
        centres = qpos.reshape(3, 7)[:, :2]
        gaps = np.abs(centres - centres[number]) - SIZE  # along x and y; negative where shadows overlap
        apart = np.where(gaps.max(axis=1) > 0, np.linalg.norm(np.maximum(gaps, 0.0), axis=1), gaps.max(axis=1))
        expected = sorted((float(apart[i]), i) for i in range(number) if apart[i] < CLEARANCE)
        hits = blame.hits(data, int(number))
        assert [hit.names.count("geom") for hit in hits] == [2] * len(expected) != []
        bodies = [[mjm.body(int(mjm.geom_bodyid[g])).name for g in hit.geoms] for hit in hits]
        assert bodies == [[f"crate_{number}", f"crate_{i}"] for _, i in expected]
        for hit, (gap, _) in zip(hits, expected, strict=True):
            assert hit.margin == CLEARANCE
            # crates of 5 cm height: none is deeper than that
            assert abs(hit.distance - max(gap, -0.05)) < 1e-5


def test_nothing_is_to_blame_in_a_layout(tmp_path: Path):
    """For any of its objects."""
    compiled = full_tray(tmp_path)
    blame, rows = Blame(compiled), valid(make(compiled, 100))
    assert len(rows.qpos) > 10
    for data in posed(compiled, rows):
        assert not any(blame.hits(data, number) for number in range(3))


def test_variants_of_an_object_do_not_crowd_a_floor_together():
    """A can that has no place in front of a wall of six variants is not told that the floor is full."""
    assets = ["bottle", "can", "cereal_box", "mug", "orange", "tin"]
    spot = {"on": "floor", "region": {"points": [[0.0, 0.0]]}}
    scene = {
        "floor": {"size": [4, 4]},
        "objects": {"first": {"asset": assets, **spot}, "other": {"asset": "can", **spot}},
    }
    with pytest.raises(InfeasibleSceneError) as raised:
        compile_scene(scene, "cpu")
    assert "'other' could not be placed, mostly because of collision" in str(raised.value)
    assert "were full" not in str(raised.value)


def test_rejections_are_listed_by_object_and_cause():
    """Those that rejected something; of many objects those with the most."""
    counts = {
        "can": {"collision": 0, "overhead": 0},
        "apple": {"collision": 7, "overhead": 2},
        "pear": {"collision": 41, "overhead": 0},
    }
    assert _rejections(counts) == "apple: collision 7, overhead 2; pear: collision 41"
    many = counts | {name: {"empty": n} for n, name in enumerate(("fig", "lime", "plum"), 10)}
    assert _rejections(many) == "pear: collision 41; lime: empty 11; plum: empty 12; and 2 other objects less often"


def test_the_object_that_is_least_likely_to_be_placed_is_blamed():
    """By the restarts that failed at it and those that went on; a stage after placing comes after all objects."""
    cases = {
        ("bar", "collision"): {"can": 20183, "bar": 34609, "mug": 10},  # one restart reached the mug
        ("mug", "collision"): {"can": 20183, "bar": 34609, "mug": 9000},
        ("can", "collision"): {"can": 10, "bar": 0, "mug": 0},
    }
    for blamed, rejected in cases.items():
        assert _least_likely({name: {"overhead": 0, "collision": n} for name, n in rejected.items()}, 10) == blamed
    late = {"can": {"collision": 5000, "no_ik": 300}, "mug": {"collision": 900, "no_ik": 0}}
    assert _least_likely(late, 10) == ("can", "no_ik")
    rare = {"can": {"collision": 90000, "no_ik": 2}, "mug": {"collision": 900, "no_ik": 0}}
    assert _least_likely(rare, 10) == ("can", "collision")


def test_the_advice_for_a_scene_without_layouts_depends_on_the_cause():
    """Each names the word of the scene that would help."""
    assert "clearance" in _of_collision(None, None)
    assert _of_collision("It is full.", None) == "It is full."
    assert "'gap'" in _of_collision("It is full.", "shelf")
    assert "'inside'" in _REMEDIES["overhead"]
    for cause in ("unreachable", "no_ik", "blocked"):
        assert "'reachable'" in _REMEDIES[cause]
    for words in ("'mass' or 'ipos'", "wider support", "'stands: false'"):
        assert words in _REMEDIES["falls"]
    assert "neighbours" not in _REMEDIES["falls"]
    assert "joints" in _of_leaning("cabinet/upper_drawer", "fixed")
    turned = _of_leaning("cabinet/upper_drawer", "stable")
    assert "'cabinet/upper_drawer'" in turned
    assert "'cabinet'" in turned
    assert "'orientation: stable'" in turned
