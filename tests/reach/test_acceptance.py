"""The share of accepted poses that are out of reach, against arms whose reach is known in closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.config.tier import Tier, Verdict
from sceniris_gym.progress import listening
from sceniris_gym.reach import acceptance
from sceniris_gym.reach.acceptance import POSES, measure_false_accepts
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.build import build_map
from sceniris_gym.reach.map import MOST_FALSE_ACCEPTS, ReachMap, default_tier, map_path, why_not_map
from tests.oracle.exact_ik import ExactIk
from tests.reach.arms import ASSETS
from tests.reach.shapes import drum, drum_reaches


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
    monkeypatch.setattr(acceptance, "POSES", 512)
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
    with listening(lambda *step: told.append(step)):
        measure_false_accepts(fine, "cpu")
    assert told == [("false accepts", n, 3) for n in (1, 2, 3)]
