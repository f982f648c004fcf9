"""The poses and figures of the table of reachability."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.reach import BOX, CYLINDERS, Asked, Subject, by_map, draw, holds, know, lookup_rate, moved, score
from sceniris_gym.commands.reach import read_arm
from sceniris_gym.config.tier import Verdict
from sceniris_gym.reach.map import ReachMap, map_path


@pytest.mark.parametrize("name", CYLINDERS)
def test_poses_fill_the_cylinder_and_the_box(name: str):
    """Evenly, with proper rotations; those of set B point straight down; a seed gives the same ones again."""
    radius, height = CYLINDERS[name]
    a, b = draw("A", name, 2000, 1), draw("B", name, 2000, 1)
    for poses in (a, b):
        turns = poses[:, :3, :3]
        np.testing.assert_allclose(turns @ np.swapaxes(turns, 1, 2), np.tile(np.eye(3), (2000, 1, 1)), atol=1e-12)
        assert (np.linalg.det(turns) > 0.0).all()
    distance = np.hypot(a[:, 0, 3], a[:, 1, 3])
    assert distance.max() < radius
    assert abs((distance < radius / 2).mean() - 0.25) < 0.04
    assert (a[:, 2, 3].min() > 0.0) and (a[:, 2, 3].max() < height)
    assert np.abs(a[:, :3, :3].mean(axis=0)).max() < 0.06
    np.testing.assert_allclose(b[:, :3, 2], np.tile([0.0, 0.0, -1.0], (2000, 1)), atol=1e-12)
    assert ((b[:, :3, 3] > BOX[0]) & (b[:, :3, 3] < BOX[1])).all()
    np.testing.assert_array_equal(a, draw("A", name, 2000, 1))
    assert (a != draw("A", name, 2000, 2)).any()


def test_moved_poses_are_the_same_to_the_arm():
    """Base and target together: the same pose up to float32. The target alone: turned about the base's axis."""
    poses = draw("A", "panda", 200, 3)
    together, turned = moved(poses, 3)
    assert np.abs(together - poses).max() < 2e-6
    assert np.abs(together - poses).max() > 0.0
    np.testing.assert_allclose(turned[:, 2], poses[:, 2], atol=1e-6)
    assert np.abs(turned - poses).max() > 1.0


def test_lookups_are_measured():
    """In lookups a second."""
    arm = read_arm("panda").arm
    assert lookup_rate(ReachMap.load(map_path("panda"), arm), "cpu", 1_000, repeats=2) > 1_000.0


def test_shares_are_counted():
    """Of all poses, and of those that are accepted."""
    accepted = np.array([True, True, True, True, False, False, False, False, False, False])
    truth = np.array([True, True, True, False, True, True, False, False, False, False])
    assert score(accepted, truth) == {
        "accuracy": 0.7,
        "false_positives": 0.1,
        "false_of_accepted": 0.25,
        "false_negatives": 0.2,
    }


def test_changes_count_beside_mixed_cells_only_where_neither_is_mixed():
    """A map that looks at world directions is seen to."""
    poses = draw("A", "panda", 400, 4)
    yes = np.ones(400, bool)
    asked = Asked(poses, yes, yes, None)
    found = by_map(lambda p: np.where(p[:, 0, 3] > 0.0, Verdict.YES, Verdict.NO), "map", asked, 4)
    assert 0.4 < found["changed"] < 0.6
    assert found["changed_beside_mixed"] > 150
    assert not holds({"tier": "map", "default": False} | found)
    found = by_map(lambda p: np.where(p[:, 0, 3] > 0.0, Verdict.YES, Verdict.MIXED_NO), "map", asked, 4)
    assert found["changed_beside_mixed"] == 0
    assert found["mixed"] > 0.3
    found = by_map(lambda p: np.where(p[:, 2, 3] > 0.5, Verdict.YES, Verdict.NO), "map", asked, 4)
    assert found["changed"] < 0.01


def test_the_truth_is_kept_and_judges_inverse_kinematics(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Each solution holds; a second run reads the file; without a map there is nothing to say of maps."""
    _, mjm, arm = read_arm("heron")
    asked = know("heron", arm, "B", 60, 5, tmp_path)
    assert asked.free is not None
    assert 0.1 < asked.reached.mean() < 0.6
    assert (asked.reached >= asked.exact).all()
    assert (asked.exact >= asked.free).all()
    monkeypatch.setattr("benchmarks.reach.ProcessPoolExecutor", None)
    again = know("heron", arm, "B", 60, 5, tmp_path)
    np.testing.assert_array_equal(asked.reached, again.reached)
    subject = Subject(mjm, arm, None, None, "cpu")
    assert subject.judge("map", asked, 5) is None
    for tier in ("solve", "ik"):
        found = subject.judge(tier, asked, 5)
        assert found is not None
        assert found["false_positives"] == 0.0
        assert found["accuracy"] > 0.98
        assert holds({"tier": tier, "default": True} | found)


@pytest.mark.parametrize("tier", ["solve", "ik"])
def test_a_false_accept_of_inverse_kinematics_breaks_the_table(tier: str):
    """One among thousands is too many, whether or not it is the arm's default."""
    row = {"tier": tier, "default": False, "accuracy": 1.0, "false_of_accepted": 0.0}
    assert holds(row | {"false_positives": 0.0})
    assert not holds(row | {"false_positives": 1e-4})
