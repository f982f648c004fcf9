"""Covers: `on` draws points below open sky, `inside` points that something covers, `in` both."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import warp as wp
from scipy import stats
from scipy.spatial.transform import Rotation
from shapely.geometry import box

from sceniris_gym.device.transforms import Pose, relative
from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.layout.layouts import Status
from sceniris_gym.placement import cover
from tests.layout.scenes import FLOOR, Rows, compile_on_cpu, make, posed, write_mjcf
from tests.oracle.uniformity import grid_p_value
from tests.placement.supports import goal_points

SHELF = """<geom type="box" size=".3 .2 .01" pos="0 0 .01"/><geom type="box" size=".3 .01 .2" pos="0 .21 .2"/>
  <geom type="box" size=".1 .2 .01" pos=".2 0 .39"/>"""


def _drawer(word: str, opening: float, geometry: str, **others) -> dict:
    cabinet = {"asset": "cabinet", "kind": "fixture", "on": "floor", "joints": {"upper": {"value": opening}}}
    goal = {"kind": "marker", word: "cabinet/upper_drawer"}
    return {"floor": FLOOR, "geometry": geometry, "objects": {"cabinet": cabinet, "goal": goal}, **others}


def _covered(compiled, rows: Rows, geometry: str) -> np.ndarray:
    """Return whether a ray of MuJoCo C straight up from the goal meets the cabinet, for each row."""
    groups = np.zeros(6, np.uint8)
    groups[3 if geometry == "physics" else 2] = 1
    goal, geom = int(compiled.mjm.body("goal").mocapid[0]), np.zeros(1, np.int32)
    up = np.array([0.0, 0.0, 1.0])
    return np.array(
        [
            mujoco.mj_ray(compiled.mjm, data, data.mocap_pos[goal].copy(), up, groups, 1, -1, geom) >= 0.0
            for data in posed(compiled, rows)
        ]
    )


@pytest.mark.parametrize("geometry", ["physics", "visual"])
@pytest.mark.parametrize("opening", [0.1, 0.25])
def test_the_cover_over_a_drawer_is_decided_by_its_opening(opening: float, geometry: str):
    """`on` draws open points, `inside` covered ones, `in` both; single refusals of `inside` are right as well."""
    rows = {}
    for word in ("on", "inside", "in"):
        compiled = compile_on_cpu(_drawer(word, opening, geometry, attempts=100))
        rows[word] = make(compiled, 300, seed=5)
        assert (rows[word].status == Status.VALID).all()
    compiled = compile_on_cpu(_drawer("in", opening, geometry))
    covered = {word: _covered(compiled, rows[word], geometry) for word in rows}
    assert not covered["on"].any()
    assert covered["inside"].all()
    assert 0.05 < covered["in"].mean() < 0.95
    once = make(compile_on_cpu(_drawer("inside", opening, geometry, attempts=1, restarts=0)), 300, seed=5)
    assert ((once.status == Status.VALID) == covered["in"]).all()


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_a_shut_drawer_has_no_open_sky(geometry: str):
    """The error names the object without a place, and what is overhead as the cause."""
    with pytest.raises(InfeasibleSceneError, match="'goal' could not be placed, mostly because of overhead"):
        compile_on_cpu(_drawer("on", 0.0, geometry))


@pytest.mark.parametrize("geometry", ["physics", "visual"])
def test_a_cover_of_the_same_body_counts(tmp_path: Path, geometry: str):
    """A shelf covered over its right third, whose cover is a surface as well."""
    shelf = {"asset": write_mjcf(tmp_path, "shelf", SHELF), "kind": "static"}
    words = {}
    for word in ("on", "inside", "in"):
        goal = {"kind": "marker", word: "shelf"}
        words[word] = goal_points({"geometry": geometry, "objects": {"shelf": shelf, "goal": goal}}, 2000)
    covered = {word: (p[:, 0] > 0.1) & (p[:, 2] < 0.3) for word, p in words.items()}
    low = {word: p[:, 2] < 0.3 for word, p in words.items()}
    assert not covered["on"].any()
    assert covered["inside"].all()
    share = 0.4 / (0.6 + 0.2)  # the cover is 0.2 m wide, the board 0.6 m, 0.4 m of which lie open
    assert stats.binomtest(int((low["on"]).sum()), 2000, 0.4 / 0.6).pvalue > 0.001
    assert stats.binomtest(int((low["in"] & ~covered["in"]).sum()), 2000, share).pvalue > 0.001
    open_board = box(-0.3, -0.2, 0.1, 0.2)
    assert grid_p_value(words["on"][low["on"], :2], open_board, 5) > 0.001


def test_a_cover_of_another_object_does_not_count(tmp_path: Path):
    """A board that hangs over the floor does not cover a crate below it: only the support's own object is asked."""
    board = write_mjcf(tmp_path, "board", '<geom type="box" size=".4 .4 .01" pos="0 0 .5"/>')
    crate = write_mjcf(tmp_path, "crate", '<geom type="box" size=".1 .1 .1" pos="0 0 .1"/>')
    objects = {
        "board": {"asset": board, "kind": "static"},
        "crate": {"asset": crate, "kind": "static"},
        "goal": {"kind": "marker", "on": "crate"},
    }
    assert len(goal_points({"objects": objects}, 50)) == 50


@wp.kernel(enable_backward=False)
def _crosses(
    point: wp.array[wp.vec3],
    half: wp.array[wp.vec3],
    pos: wp.array[wp.vec3],
    rot: wp.array[wp.mat33],
    out: wp.array[bool],
):
    i = wp.tid()
    frame = Pose()
    frame.pos = pos[i]
    frame.rot = rot[i]
    out[i] = cover._crosses_box(half[i], relative(cover._upward(point[i]), frame))


def _above(point: np.ndarray, half: np.ndarray, pos: np.ndarray, rot: np.ndarray) -> np.ndarray:
    """In double precision: is any of the 5 m from 0.1 mm over each point on within its box? By what its sides leave."""
    start = np.einsum("nij,ni->nj", rot, point + [0.0, 0.0, 1e-4] - pos)
    low, high = np.zeros(len(point)), np.full(len(point), 5.0)
    for axis in range(3):
        for sign in (1.0, -1.0):  # sign * (start + t * along) <= half
            along, room = sign * rot[:, 2, axis], half[:, axis] - sign * start[:, axis]
            with np.errstate(divide="ignore", invalid="ignore"):
                limit = room / along
            high = np.where(along > 0.0, np.minimum(high, limit), high)
            low = np.where(along < 0.0, np.maximum(low, limit), low)
            low = np.where((along == 0.0) & (room < 0.0), np.inf, low)
    return low <= high


def test_a_box_covers_a_point_where_a_line_straight_up_crosses_it():
    """Turned any way, upright, or flat on a side; beginning and ending inside of it too; to 5 um."""
    n, rng = 60_000, np.random.default_rng(2)
    point, half = rng.uniform(-0.3, 0.3, (n, 3)), rng.uniform(0.002, 0.3, (n, 3))
    pos = rng.uniform([-0.3, -0.3, -0.5], [0.3, 0.3, 0.8], (n, 3))
    pos[: n // 3, 2] += 4.8
    turns = Rotation.random(n, rng=rng).as_matrix()
    turns[::3] = Rotation.from_rotvec(rng.uniform(-4, 4, (n, 1)) * [0.0, 0.0, 1.0]).as_matrix()[::3]
    turns[::7] = np.eye(3)
    arrays = [wp.array(a, dtype=wp.vec3, device="cpu") for a in (point, half, pos)]
    out = wp.zeros(n, dtype=bool, device="cpu")
    inputs = [*arrays, wp.array(turns, dtype=wp.mat33, device="cpu")]
    wp.launch(_crosses, dim=n, inputs=inputs, outputs=[out], device="cpu")
    found = out.numpy()
    assert not (found & ~_above(point, half + 5e-6, pos, turns)).any()
    assert not (~found & _above(point, half - 5e-6, pos, turns)).any()
    assert 0.1 < found.mean() < 0.5
