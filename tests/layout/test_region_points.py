"""Regions that are points: an object's pivot is exactly on one of them, on each as often as on any other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from sceniris_gym.errors import InfeasibleSceneError, SceneKeyError
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.wave.search import default_size
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.scenes import FLOOR, Rows, box_mjcf, compile_on_cpu, make, posed

LATTICE = [[x / 10, y / 10] for x in range(-3, 4) for y in range(-3, 4)]


def _at(compiled: CompiledScene, rows: Rows, name: str) -> np.ndarray:
    """Return the position of a marker's or fixture's mocap body in each row, shape (n, 3)."""
    return rows.mocap_pos[:, int(compiled.mjm.body(name).mocapid[0])]


def _chosen(at: np.ndarray, points: list, near: float = 1e-6) -> np.ndarray:
    """Return how often each point is chosen, shape (npoint,); each row is at one of them."""
    apart = np.linalg.norm(at[:, None] - np.array(points), axis=2)
    assert apart.min(axis=1).max() < near
    return np.bincount(apart.argmin(axis=1), minlength=len(points))


def test_points_on_a_support_are_chosen_alike_in_its_frame(tmp_path: Path):
    """A slab that is moved and turned in every world; poses by MuJoCo C."""
    points = [[0.1, 0.2], [-0.25, 0.0], [0.3, -0.3], [0.0, 0.0], [0.299, 0.29]]
    objects = {
        "slab": {"asset": box_mjcf(tmp_path, "slab", 0.6, 0.6, 0.05), "kind": "fixture", "on": "floor"},
        "goal": {"kind": "marker", "on": "slab", "region": {"points": points}},
    }
    compiled = compile_on_cpu({"floor": FLOOR, "objects": objects})
    rows = make(compiled, 3000, seed=3)
    assert (rows.status == LayoutStatus.VALID).all()
    slab, local = compiled.mjm.body("slab").id, []
    for data, at in zip(posed(compiled, rows), _at(compiled, rows, "goal"), strict=True):
        local.append(data.xmat[slab].reshape(3, 3).T @ (at - data.xpos[slab]))
    there = np.array(local)
    np.testing.assert_allclose(there[:, 2], 0.0505, atol=1e-6)
    assert stats.chisquare(_chosen(there[:, :2], points)).pvalue > 0.001


def test_points_on_a_floor_have_the_bits_that_were_written():
    """No arithmetic is done on the way; one that is written twice is chosen twice as often."""
    points = [[0.1, 0.2], [0.1, 0.2], [-0.3, 0.4999]]
    goal = {"kind": "marker", "on": "floor", "region": {"points": points}}
    compiled = compile_on_cpu({"floor": FLOOR, "objects": {"goal": goal}})
    at = _at(compiled, make(compiled, 3000, seed=4), "goal")[:, :2]
    assert {tuple(p) for p in at} == {tuple(p) for p in np.array(points, np.float32)}
    assert stats.binomtest(int((at[:, 1] < 0.3).sum()), 3000, 2.0 / 3.0).pvalue > 0.001


@pytest.mark.parametrize("related", [False, True])
def test_points_in_space_are_chosen_alike(related: bool):
    """Each with its own height, alone and where a relation leaves some of them: nothing carries the object."""
    points = [[0.1, 0.2, 0.5], [0.1, 0.2, 0.7], [-0.4, 0.3, 0.7], [0.0, -0.2, 0.0], [1.5, 0.0, 0.5]]
    origin = {"kind": "marker", "region": {"points": [[0, 0, 0]]}}
    near = {"relations": [{"near": "origin", "distance": {"max": 1.0}}]} if related else {}
    goal = {"kind": "marker", "region": {"points": points}, **near}
    compiled = compile_on_cpu({"objects": {"origin": origin, "goal": goal}})
    rows = make(compiled, 3000, seed=5)
    assert (rows.status == LayoutStatus.VALID).all()
    chosen = _chosen(_at(compiled, rows, "goal"), points)
    assert stats.chisquare(chosen[:-1] if related else chosen).pvalue > 0.001
    assert (chosen[-1] == 0) == related


def test_relations_leave_points_which_are_chosen_alike():
    """A lattice around the anchor, in a ring whose twelve slices meet on some of its points, and in front of it."""
    post = {"kind": "marker", "on": "floor", "region": {"points": [[0, 0]]}, "orientation": "fixed"}
    ring = {"near": "post", "distance": {"min": 0.15, "max": 0.35}}
    goal = {"kind": "marker", "on": "floor", "region": {"points": LATTICE}, "relations": [ring, {"front_of": "post"}]}
    compiled = compile_on_cpu({"floor": FLOOR, "objects": {"post": post, "goal": goal}})
    rows = make(compiled, 6000, seed=6)
    assert (rows.status == LayoutStatus.VALID).all()
    x, y = np.array(LATTICE).T
    left = (np.hypot(x, y) > 0.15) & (np.hypot(x, y) < 0.35) & (y <= 0.0)
    edge = left & (y == 0.0)  # on the line that `front_of` ends at: within it or not, by rounding
    chosen = _chosen(_at(compiled, rows, "goal")[:, :2], LATTICE)
    assert not chosen[~left].any()
    assert stats.chisquare(chosen[left & ~edge]).pvalue > 0.001
    assert chosen[edge].max() < 1.5 * chosen[left & ~edge].mean()


def test_a_point_at_the_anchor_is_in_no_direction_from_it(tmp_path: Path):
    """Whichever way the anchor is turned on a slab that is turned, too; it is near the anchor all the same."""
    slab = {"asset": box_mjcf(tmp_path, "slab", 0.6, 0.6, 0.05), "kind": "fixture", "on": "floor"}
    post = {"kind": "marker", "on": "slab", "region": {"points": [[0.1, 0.2]]}}
    goal = {"kind": "marker", "on": "slab", "region": {"points": [[0.1, 0.2], [-0.2, 0.2], [0.25, -0.2], [0.28, 0.28]]}}
    for relation, counts in (
        ({"front_of": "post", "angle": 120}, False),
        ({"near": "post", "distance": {"max": 1.0}}, True),
    ):
        objects = {"slab": slab, "post": post, "goal": {**goal, "relations": [relation]}}
        compiled = compile_on_cpu({"floor": FLOOR, "objects": objects})
        rows = make(compiled, 500, seed=9)
        apart = np.linalg.norm(_at(compiled, rows, "goal") - _at(compiled, rows, "post"), axis=1)
        assert (apart < 1e-5).any() == counts


def test_what_stands_on_a_point_leaves_the_others(tmp_path: Path):
    """Three blocks on three points take all of them, in any order; a fourth finds none."""
    points = [[0.0, 0.0], [0.2, 0.0], [0.0, 0.2]]
    block = {"asset": box_mjcf(tmp_path, "block", 0.05, 0.05, 0.05), "kind": "fixture", "on": "floor"}
    names = ["a", "b", "c", "d"]
    scene = {"floor": FLOOR, "objects": {name: {**block, "region": {"points": points}} for name in names[:3]}}
    compiled = compile_on_cpu({**scene, "attempts": 64})
    rows = make(compiled, 500, seed=7)
    assert (rows.status == LayoutStatus.VALID).all()
    taken = np.stack([_at(compiled, rows, name)[:, :2] for name in names[:3]], axis=1)
    apart = np.linalg.norm(taken[:, :, None] - np.array(points), axis=3)
    assert np.array_equal(np.sort(apart.argmin(axis=2), axis=1), np.tile([0, 1, 2], (500, 1)))
    assert stats.chisquare(np.bincount(apart.argmin(axis=2)[:, 0], minlength=3)).pvalue > 0.001
    scene["objects"]["d"] = {**block, "region": {"points": points}}
    with pytest.raises(InfeasibleSceneError, match=r"'d' could not be placed, mostly because of collision"):
        compile_on_cpu(scene)


def test_where_no_point_is_left_the_cause_says_so():
    """A relation that none of them satisfies; none is a collision."""
    post = {"kind": "marker", "on": "floor", "region": {"points": [[0, 0]]}}
    goal = {"kind": "marker", "on": "floor", "relations": [{"near": "post", "distance": {"max": 0.1}}]}
    scene = {"floor": FLOOR, "objects": {"post": post, "goal": {**goal, "region": {"points": [[0.3, 0.3]]}}}}
    with pytest.raises(InfeasibleSceneError, match=r"Rejections: goal: empty \d+\."):
        compile_on_cpu(scene)


def test_points_are_the_same_for_any_number_of_worlds_and_size_of_the_search():
    """Bit for bit, with relations that need redraws: bounds are measured, which circles around them say little of."""
    post = {"asset": "mug", "on": "floor", "region": {"points": [[0.0, 0.0], [0.05, 0.1]]}}
    goal = {"asset": "apple", "on": "floor", "region": {"points": LATTICE}}
    near = {"near": "post", "measure": "bounds", "distance": {"max": 0.12}}
    compiled = compile_on_cpu({"floor": FLOOR, "objects": {"post": post, "goal": {**goal, "relations": [near]}}})
    size = default_size("cpu")
    rows = make(compiled, 64, seed=8)
    assert (rows.status == LayoutStatus.VALID).all()
    assert rows[:16].bits() == make(compiled, 16, seed=8).bits()
    assert rows.bits() == make(compiled, 64, seed=8, size=replace(size, candidates=max(size.candidates // 8, 1))).bits()


def test_a_point_off_its_support_is_refused():
    """By its number, with how far off it is and where the support ends."""
    goal = {"kind": "marker", "on": "floor", "region": {"points": [[0.5, 0.5], [0.1, 0.6]]}}
    says = r"objects\.goal\.on: 'floor': point 1 of the region, \[0\.1, 0\.6\], .*off the surface, by 0\.1 m\. .* Move"
    with pytest.raises(SceneKeyError, match=says):
        compile_on_cpu({"floor": FLOOR, "objects": {"goal": goal}})
