"""Forward kinematics against MuJoCo's, witnesses in their own cells, and false accepts of arms whose reach is known."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.config.tier import Tier, Verdict
from sceniris_gym.progress import listening
from sceniris_gym.reach import measures
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.build import build_map
from sceniris_gym.reach.map import MOST_FALSE_ACCEPTS, WITNESS_CELLS, ReachMap, default_tier, map_path, why_not_map
from sceniris_gym.reach.measures import BRANCHES, POSES, gather_witnesses, measure_false_accepts, tcp_axes
from sceniris_gym.reach.solve import random_joints
from tests.oracle.exact_ik import ExactIk
from tests.reach.arms import ASSETS, MODELS, tcp_poses
from tests.reach.shapes import drum, drum_reaches

# Corners along (z, u, tilt, v): fewer than 2048, so that float16 holds the number of each in a joint.
SHAPE = (9, 6, 7, 5)
NCORNER = math.prod(SHAPE)
NJOINT = 6


@pytest.fixture(scope="module")
def coarse() -> ReachMap:
    """The map of a drum with steps of half its radius."""
    return build_map(drum(), "cpu", step=0.2, tilt_step=math.radians(90))


@pytest.fixture(scope="module")
def fine() -> ReachMap:
    """One with steps of a seventh; what a drum reaches does not depend on tilt."""
    return build_map(drum(), "cpu", step=0.06, tilt_step=math.radians(90))


def accepted(reach_map: ReachMap, way: str, num: int, seed: int) -> np.ndarray:
    """Poses that a map accepts of `num`, uniform over its box, in 'any' orientation, 'up' or 'down'; (N, 4, 4)."""
    draws = np.random.default_rng([seed, len(way)])
    poses = np.tile(np.eye(4), (num, 1, 1))
    half, high = abs(reach_map.u_low), reach_map.z_low + reach_map.step * (reach_map.nz - 1)
    poses[:, :3, 3] = draws.uniform([-half, -half, reach_map.z_low], [half, half, high], (num, 3))
    if way == "any":
        turns = Rotation.random(num, rng=draws).as_matrix()
    else:
        turns = Rotation.from_rotvec(np.outer(draws.uniform(-np.pi, np.pi, num), [0.0, 0.0, 1.0])).as_matrix()
        turns = turns if way == "up" else turns @ np.diag([1.0, -1.0, -1.0])
    poses[:, :3, :3] = turns
    return poses[reach_map.verdict(poses, "cpu") >= Verdict.MIXED_YES]


def error(share: float, *nums: int) -> float:
    """Four standard errors of a difference between shares of so many poses."""
    return 4.0 * math.sqrt(share * (1.0 - share) * sum(1.0 / num for num in nums))


def test_a_coarse_map_is_not_the_default_and_a_fine_one_is(coarse: ReachMap, fine: ReachMap):
    """Building measures both; the message has the share, and what helps."""
    assert coarse.false_accepts is not None
    assert fine.false_accepts is not None
    assert coarse.false_accepts > 4.0 * MOST_FALSE_ACCEPTS
    assert (coarse.coarse, default_tier(coarse.arm, coarse)) == (True, Tier.IK)
    why = str(why_not_map(coarse.arm, coarse, "drum.xml"))
    assert f"{coarse.false_accepts:.2%}" in why
    assert "finer steps than --step 0.2 --tilt-step 90" in why
    assert fine.false_accepts < MOST_FALSE_ACCEPTS
    assert (fine.coarse, default_tier(fine.arm, fine)) == (False, Tier.MAP)
    assert why_not_map(fine.arm, fine, "drum.xml") is None


@pytest.mark.parametrize("name", ["coarse", "fine"])
def test_the_share_is_that_of_the_closed_form(name: str, request: pytest.FixtureRequest):
    """On other poses: the largest share among those in any orientation, straight up and straight down."""
    reach_map: ReachMap = request.getfixturevalue(name)
    shares = []
    for way in ("any", "up", "down"):
        poses = accepted(reach_map, way, 100_000, 1)
        shares.append(1.0 - float(drum_reaches(poses[:, :3, 3]).mean()))
    assert reach_map.false_accepts == pytest.approx(max(shares), abs=error(max(shares), POSES, len(poses)))


@pytest.mark.parametrize("name", ["heron", "ur5e"])
def test_the_share_is_that_of_exact_inverse_kinematics(name: str):
    """For the shipped maps of arms with six joints: Heron's is limited, and wrong straight up and straight down."""
    mjm = mujoco.MjModel.from_xml_path(str(ASSETS / f"{name}.xml"))
    reach_map = ReachMap.load(map_path(name), SerialArm.from_model(mjm, name))
    truth, shares = ExactIk(mjm, name), []
    for way in ("any", "up", "down"):
        poses = accepted(reach_map, way, 8_000, 2)
        assert len(poses) > 500
        shares.append(1.0 - float(truth.reachable(poses)[0].mean()))
    measured = measure_false_accepts(reach_map, "cpu")
    assert measured == pytest.approx(max(shares), abs=error(max(*shares, 1e-3), POSES, len(poses)))
    assert (max(shares) > 0.02) is (name == "heron")


def test_the_share_depends_on_the_seed_alone(fine: ReachMap, coarse: ReachMap):
    """The same map gives the same share again; another seed has other poses."""
    assert measure_false_accepts(coarse, "cpu") == coarse.false_accepts
    other = measure_false_accepts(replace(coarse, seed=1), "cpu")
    assert other != coarse.false_accepts
    assert coarse.false_accepts is not None
    assert other == pytest.approx(coarse.false_accepts, abs=error(coarse.false_accepts, POSES, POSES))


@pytest.mark.parametrize("pole", [0, 1])
def test_what_is_wrong_straight_up_or_down_counts_alone(fine: ReachMap, pole: int, monkeypatch: pytest.MonkeyPatch):
    """A table that accepts everything of one pole is seen beside a grid that is right."""
    monkeypatch.setattr(measures, "POSES", 512)
    poles = fine.poles.copy()
    poles[pole] = 15
    share = measure_false_accepts(replace(fine, poles=poles), "cpu")
    assert share is not None
    assert share > 0.3


def test_a_map_that_accepts_next_to_nothing_has_no_share(fine: ReachMap):
    """Nor does a set count of which hardly a pose is accepted."""
    nothing, codes = np.zeros_like(fine.poles), np.zeros_like(fine.codes)
    assert measure_false_accepts(replace(fine, poles=nothing, codes=codes), "cpu") is None
    tiny = nothing.copy()
    tiny[0, 2, 0] = 15  # far below what is reached
    assert measure_false_accepts(replace(fine, poles=tiny, codes=codes), "cpu") is None
    assert measure_false_accepts(replace(fine, poles=tiny), "cpu") == pytest.approx(fine.false_accepts, abs=0.002)


def test_progress_is_told(fine: ReachMap):
    """Set by set."""
    told: list[tuple[str, int, int]] = []
    with listening(lambda *step: told.append(step)):  # pyrefly: ignore[bad-argument-type]
        measure_false_accepts(fine, "cpu")
    assert told == [("false accepts", n, 3) for n in (1, 2, 3)]


def _cell(corner: np.ndarray) -> np.ndarray:
    """The coarse cell (z, tilt, u, v) of each corner, shape (N, 4)."""
    z, u, tilt, v = np.unravel_index(corner, SHAPE)
    meters, radians = WITNESS_CELLS
    return np.stack([z // meters, tilt // radians, u // meters, v // meters], axis=1)


def _solutions(share: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Random labels, of which so many are not 0, and random joints; the first one is the number of the corner."""
    draws = np.random.default_rng(seed)
    level = np.where(draws.random(NCORNER) < share, draws.integers(1, 256, NCORNER), 0).astype(np.uint8)
    joints = draws.uniform(-2.0, 2.0, (NCORNER, NJOINT)).astype(np.float16)
    joints[:, 0] = np.arange(NCORNER)
    return level, joints


def _chosen(cells: np.ndarray, joints: np.ndarray) -> list[tuple[tuple[int, ...], np.ndarray]]:
    """Index of each cell that has witnesses, and the numbers of the corners they are of."""
    found = []
    for index in np.ndindex(cells.shape[:4]):
        adr, num = cells[index]
        if num:
            found.append((index, joints[adr : adr + num, 0].astype(int)))
    return found


@pytest.mark.parametrize("share", [0.002, 0.05, 1.0])
def test_a_cell_has_witnesses_where_any_of_its_corners_is_reached(share: float):
    """One to four, each the solution of a reached corner of that very cell; no row is in no cell or in two."""
    level, solutions = _solutions(share, 0)
    cells, joints = gather_witnesses(SHAPE, level, solutions)
    found = _chosen(cells, joints)
    assert {index for index, _ in found} == {tuple(row) for row in _cell(np.flatnonzero(level)).tolist()}
    for index, corners in found:
        assert 1 <= len(corners) <= BRANCHES
        assert len(set(corners)) == len(corners)
        assert level[corners].all()
        assert (_cell(corners) == index).all()
    adr, num = cells[cells[..., 1] > 0].T
    assert np.sort(np.concatenate([np.arange(a, a + n) for a, n in zip(adr, num, strict=True)])).tolist() == [
        *range(len(joints))
    ]
    numbers = joints[:, 0].astype(int)
    np.testing.assert_array_equal(joints, solutions[numbers])


def test_cells_cover_the_grid_and_the_last_ones_may_be_smaller():
    """As many along each axis as it takes, in the order (z, tilt, u, v); arrays are as a map keeps them."""
    cells, joints = gather_witnesses(SHAPE, *_solutions(1.0, 1))
    meters, radians = WITNESS_CELLS
    z, u, tilt, v = SHAPE
    assert cells.shape == (*(math.ceil(n / s) for n, s in ((z, meters), (tilt, radians), (u, meters), (v, meters))), 2)
    assert (cells.dtype, joints.dtype) == (np.int32, np.float16)
    assert joints.shape[1] == NJOINT


def test_the_first_witness_of_a_cell_is_one_that_is_reached_in_most_turns():
    """No corner of its cell has a higher label."""
    level, solutions = _solutions(0.3, 2)
    highest: dict[tuple[int, ...], int] = {}
    for index, label in zip(_cell(np.arange(NCORNER)).tolist(), level, strict=True):
        highest[tuple(index)] = max(highest.get(tuple(index), 0), int(label))
    for index, corners in _chosen(*gather_witnesses(SHAPE, level, solutions)):
        assert level[corners[0]] == highest[index]


def test_every_branch_of_a_cell_has_a_witness():
    """Solutions of three ways to bend an arm, spread over all corners: each cell keeps one of each, and no copies."""
    level, solutions = _solutions(1.0, 3)
    branch = np.random.default_rng(4).integers(0, 3, NCORNER)
    ways = np.array([[1.0, -1.5, 0.5, 2.0], [-1.0, 1.5, 0.5, -2.0], [1.0, 0.0, -2.0, 0.5]])
    solutions[:, 1:-1] = ways[branch] + np.random.default_rng(5).uniform(-0.01, 0.01, (NCORNER, 4))
    found = _chosen(*gather_witnesses(SHAPE, level, solutions))
    full = [corners for index, corners in found if (_cell(np.arange(NCORNER)) == index).all(1).sum() > 30]
    assert len(full) > 2
    for corners in full:
        assert sorted(branch[corners]) == [0, 1, 2]


def test_turns_of_base_and_wrist_make_no_branch():
    """Solutions that differ in the first and last joint alone are one: those joints follow the pose."""
    level, solutions = _solutions(1.0, 6)
    solutions[:, 1:-1] = 0.5
    assert all(len(corners) == 1 for _, corners in _chosen(*gather_witnesses(SHAPE, level, solutions)))


def test_where_nothing_is_reached_there_are_no_witnesses():
    """The cells are there and empty."""
    cells, joints = gather_witnesses(SHAPE, np.zeros(NCORNER, np.uint8), _solutions(0.5, 7)[1])
    assert not cells.any()
    assert joints.shape == (0, NJOINT)


@pytest.mark.parametrize("name", MODELS)
def test_positions_and_approach_axes_are_those_of_mujoco(name: str):
    """In the base's frame, wherever the base stands; to the rounding of float32."""
    mjm, base = MODELS[name]()
    arm = SerialArm.from_model(mjm, base)
    joints = random_joints(arm, 300, seed=1)
    pos, approach = tcp_axes(arm, joints, "cpu")
    expected = tcp_poses(mjm, arm, joints)
    assert pos.shape == approach.shape == (300, 3)
    assert np.linalg.norm(pos - expected[:, :3, 3], axis=1).max() < 2e-6
    assert np.linalg.norm(approach - expected[:, :3, 2], axis=1).max() < 2e-6


def test_one_row_is_answered_as_it_is_among_others():
    """Bit by bit; no rows have no answers."""
    mjm, base = MODELS["panda"]()
    arm = SerialArm.from_model(mjm, base)
    joints = random_joints(arm, 7, seed=2)
    together = tcp_axes(arm, joints, "cpu")
    for i in range(7):
        alone = tcp_axes(arm, joints[i : i + 1], "cpu")
        assert all(np.array_equal(a[0], b[i]) for a, b in zip(alone, together, strict=True))
    assert all(len(a) == 0 for a in tcp_axes(arm, joints[:0], "cpu"))
