"""The maps in the repository against exact inverse kinematics."""

import mujoco
import pytest

from benchmarks.reach import ACCURACY, CYLINDERS, FALSE, draw
from sceniris_gym.config.tier import Verdict
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.map import ReachMap, map_path
from tests.oracle.exact_ik import ExactIk
from tests.reach.arms import ASSETS

N = 400


@pytest.mark.parametrize("kind", "AB")
@pytest.mark.parametrize("name", CYLINDERS)
def test_a_shipped_map_is_right(name: str, kind: str):
    """Any orientation (A) and straight down (B): as right as the table asks, up to a pose or two.

    Heron's map is limited: it is not its default, and straight down some of what it accepts is out of reach.
    """
    mjm = mujoco.MjModel.from_xml_path(str(ASSETS / f"{name}.xml"))
    shipped = ReachMap.load(map_path(name), SerialArm.from_model(mjm, name))
    poses = draw(kind, name, N, 7)
    truth = ExactIk(mjm, name).reachable(poses)[0]
    verdict = shipped.verdict(poses, "cpu")
    assert 0.2 < truth.mean() < 0.8
    accepted, certain = verdict >= Verdict.MIXED_YES, verdict == Verdict.YES
    assert shipped.limited is (name == "heron")
    asked = (ACCURACY, FALSE) if not shipped.limited or kind == "A" else (0.96, 0.1)
    assert (accepted != truth).sum() <= (1.0 - asked[0]) * N + 2
    assert (accepted & ~truth).sum() <= asked[1] * accepted.sum() + 1
    assert not (certain & ~truth).any()


def test_a_map_that_is_shifted_would_be_seen():
    """One whose codes moved up by two steps differs on more poses than the bounds allow."""
    mjm = mujoco.MjModel.from_xml_path(str(ASSETS / "ur5e.xml"))
    arm = SerialArm.from_model(mjm, "ur5e")
    whole = ReachMap.load(map_path("ur5e"), arm)
    poses = draw("B", "ur5e", N, 7)
    shifted = poses.copy()
    shifted[:, 2, 3] -= 2 * whole.step
    changed = (whole.verdict(poses, "cpu") >= Verdict.MIXED_YES) != (whole.verdict(shifted, "cpu") >= Verdict.MIXED_YES)
    assert changed.sum() > 2 * ((1.0 - ACCURACY) * N + 2)
