"""Labels of poses: in how many turns of base and wrist an arm reaches them, counted in closed form."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.labels import ALL_TURNS, TURNS, Labeller, end_turns
from tests.reach.arms import MODELS, hinge, link, model, site, tcp_poses
from tests.reach.shapes import gantry, gantry_depths

# Limits of base and wrist in degrees: none of them is a multiple of a turn's 22.5.
LIMITS = [(None, None), ((-100.0, 100.0), None), (None, (-50.0, 200.0)), ((-130.0, 130.0), (-145.0, 145.0))]
ARMS = ("panda", "ur5e", "heron")


def _range(limits: tuple[float, float] | None) -> str | None:
    return None if limits is None else " ".join(str(math.radians(a)) for a in limits)


@cache
def _labeller(base: tuple[float, float] | None, wrist: tuple[float, float] | None) -> tuple:
    mjm, arm = gantry(_range(base), _range(wrist))
    return mjm, arm, Labeller(arm, "cpu", starts=32, seed=0)


def _within(limits: tuple[float, float] | None, at: float) -> np.ndarray:
    """Return True for each turn that a joint at `at` degrees makes within its limits, shape (TURNS,)."""
    if limits is None:
        return np.ones(TURNS, bool)
    angles = at + 360.0 / TURNS * np.arange(TURNS)
    return np.any([(limits[0] <= a) & (a <= limits[1]) for a in (angles + 360.0 * k for k in range(-3, 4))], axis=0)


def _expected(coords: np.ndarray, base: tuple[float, float] | None, wrist: tuple[float, float] | None) -> np.ndarray:
    """Count the turns that a gantry reaches: it faces along the approach, or against it with its hand tilted back."""
    ways = [np.outer(_within(base, at), _within(wrist, at)) for at in (0.0, 180.0)]
    reached = [depth < 0.0 for depth in gantry_depths(coords)]
    either = np.logical_or(*(r[:, None, None] & way for r, way in zip(reached, ways, strict=True)))
    return either.sum(axis=(1, 2))


def _asked(num: int, seed: int) -> np.ndarray:
    """Canonical poses about the gantry's region, away from its surface and from the vertical, shape (N, 4)."""
    coords = np.random.default_rng(seed).uniform([0.1, 0.3, -0.6, -0.4], [0.8, 2.8, 0.6, 0.4], (num, 4))
    return coords[np.minimum(*map(np.abs, gantry_depths(coords))) > 5e-3]


@pytest.mark.parametrize(("base", "wrist"), LIMITS, ids=str)
def test_labels_count_the_turns_that_limits_allow(base: tuple[float, float] | None, wrist: tuple[float, float] | None):
    """Of random poses, nearly all to the turn, and none too many: a branch that no start finds makes a label low."""
    coords = _asked(1500, 1)
    count, _ = _labeller(base, wrist)[2].label(coords)
    expected = _expected(coords, base, wrist)
    assert 0.1 < (expected > 0).mean() < 0.7
    assert (count <= expected).all()
    assert (count == expected).mean() > 0.995
    assert (expected[expected > 0] == ALL_TURNS).all() == (base is None and wrist is None)


def test_joints_that_come_back_reach_the_pose():
    """By MuJoCo's kinematics, with base and wrist free to turn: position and orientation, not only the approach."""
    mjm, arm, labeller = _labeller(*LIMITS[0])
    coords = _asked(300, 2)
    count, joints = labeller.label(coords)
    found = count > 0
    assert found.any()
    reached = tcp_poses(mjm, arm, joints[found, : len(arm.joints)].astype(float))
    z, tilt, u, v = coords[found].T
    assert np.linalg.norm(reached[:, :3, 3] - np.stack([u, v, z], axis=1), axis=1).max() < 5.1e-4
    asked = Rotation.from_euler("y", tilt[:, None]).as_matrix()
    assert Rotation.from_matrix(asked.transpose(0, 2, 1) @ reached[:, :3, :3]).magnitude().max() < math.radians(0.26)
    assert not joints[:, len(arm.joints) :].any()


def test_a_warm_start_is_enough_and_none_is_none():
    """Without random starts a solution of a pose is found from itself, and from NaN, which is no start, nothing."""
    _, arm, labeller = _labeller(*LIMITS[0])
    coords = _asked(300, 3)
    count, joints = labeller.label(coords)
    coords, joints = coords[count > 0], joints[count > 0, None, : len(arm.joints)]
    nothing = np.full_like(joints, np.nan)
    assert (labeller.label(coords, np.concatenate([nothing, joints], axis=1), count=0)[0] == ALL_TURNS).all()
    assert not labeller.label(coords, nothing, count=0)[0].any()
    assert not labeller.label(coords, count=0)[0].any()


def test_more_starts_never_lower_a_label():
    """The first ones are tried first, and later ones only add turns; two halves find what all of them find."""
    labeller, coords = _labeller(*LIMITS[3])[2], _asked(400, 4)
    counts = [labeller.label(coords, count=n)[0] for n in (1, 4, 16, 32)]
    assert all((a <= b).all() for a, b in pairwise(counts))
    assert (counts[0] < counts[-1]).any()
    second = labeller.label(coords, first=16, count=16)[0]
    assert ((counts[2] > 0) | (second > 0)).tolist() == (counts[3] > 0).tolist()


@pytest.mark.parametrize("name", [*ARMS, "hanging"])
def test_a_turn_of_the_first_joint_turns_the_pose_about_the_vertical(name: str):
    """By MuJoCo, in the direction that its sign says, also of an axis that points down; one of the last rolls it."""
    if name == "hanging":
        hand = link(hinge("0 1 0") + link(hinge("0 0 -1") + site()), pos="0.3 0 0.1")
        mjm, base = model(chain=link(hinge("0 0 -1") + hand, pos="0 0 0.5")), "base"
    else:
        mjm, base = MODELS[name]()
    arm = SerialArm.from_model(mjm, base)
    signs = tuple(turn.sign for turn in end_turns(arm))
    assert signs == (-1.0, -1.0) or name != "hanging"
    joints = np.tile(0.5 * (np.maximum(arm.lower, -2.0) + np.minimum(arm.upper, 2.0)), (3, 1))
    joints[1, 0] += 0.3 * signs[0]
    joints[2, -1] += 0.3 * signs[1]
    start, based, rolled = tcp_poses(mjm, arm, joints)
    about = np.eye(4)
    about[:2, 3] = arm.axis_xy
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("z", 0.3).as_matrix()
    np.testing.assert_allclose(based, about @ turn @ np.linalg.inv(about) @ start, atol=1e-6)
    np.testing.assert_allclose(rolled, start @ turn, atol=1e-6)


def test_limits_of_turns_are_those_of_the_joints():
    """As they are where there are some; where a joint goes all around, any angle is within them."""
    for (base, wrist), limits in zip(LIMITS, [gantry(_range(b), _range(w))[1] for b, w in LIMITS], strict=True):
        for turn, given in zip(end_turns(limits), (base, wrist), strict=True):
            if given is not None:
                assert np.degrees([turn.lower, turn.upper]) == pytest.approx(given, abs=1e-4)
            else:
                assert turn.upper - turn.lower >= 2.0 * math.pi
