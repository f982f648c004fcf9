"""Building maps: an arm that reaches a region known without inverse kinematics."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.config.tier import Verdict
from sceniris_gym.errors import ArmError, MapError
from sceniris_gym.progress import listening
from sceniris_gym.reach import checkpoint
from sceniris_gym.reach.arm import SerialArm
from sceniris_gym.reach.build import build_map, reach_ball, turn_error
from sceniris_gym.reach.map import ReachMap
from tests.reach.arms import ASSETS, hinge, link, model, site, tcp_poses
from tests.reach.shapes import codes_at, gantry, gantry_depths, gantry_reaches, poses, turn

STEP, TILT_STEP = 0.16, math.radians(22.5)


@pytest.fixture(scope="module")
def built() -> ReachMap:
    """The map of a gantry that turns and rolls freely."""
    return build_map(gantry()[1], "cpu", step=STEP, tilt_step=TILT_STEP)


def asked(num: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Random TCP poses about the gantry's region, and their canonical coordinates.

    Not from straight below: there its base and wrist turn about the same axis, so just beside it it reaches less.
    """
    draws = np.random.default_rng(seed)
    z, tilt, u, v = draws.uniform([0.1, 0.45, -0.7, -0.4], [0.8, 2.7, 0.7, 0.4], (num, 4)).T
    pos, approach = np.stack([u, v, z], axis=1), np.stack([np.sin(tilt), np.zeros(num), np.cos(tilt)], axis=1)
    made = poses(pos, approach, draws.uniform(-3.0, 3.0, num))
    made = np.stack([turn(angle) @ pose for angle, pose in zip(draws.uniform(-3.0, 3.0, num), made, strict=True)])
    return made, np.stack([z, tilt, u, v], axis=1)


def test_a_built_map_knows_what_the_arm_reaches(built: ReachMap):
    """With a grid as coarse as 16 cm wrong verdicts are near an edge of the box, and few; certain ones are right."""
    made, coords = asked(20_000, 0)
    truth = gantry_reaches(coords)
    verdict = built.verdict(made, "cpu")
    wrong = (verdict >= Verdict.MIXED_YES) != truth
    assert 0.1 < truth.mean() < 0.5
    assert wrong.mean() < 0.06
    depth = np.minimum(*map(np.abs, gantry_depths(coords)))
    assert depth[wrong].max() < 0.12
    assert truth[verdict == Verdict.YES].mean() > 0.999
    assert not built.limited
    assert built.turn_error == 0.0


def test_labels_hold_at_the_corners(built: ReachMap):
    """Corner by corner, but for those within some millimetres of the surface."""
    index = np.stack(np.meshgrid(*map(np.arange, (built.nz, built.ntilt, built.nu, built.nu)), indexing="ij"), axis=-1)
    index = index.reshape(-1, 4)
    low = np.array([built.z_low, 0.0, built.u_low, built.u_low])
    coords = low + index * [built.step, built.tilt_step, built.step, built.step]
    clear = np.minimum(*map(np.abs, gantry_depths(coords))) > 6e-3
    clear &= coords[:, 1] > 0.0  # straight below base and wrist turn about the same axis
    reached = codes_at(built, index) >= 8
    assert reached.any()
    assert np.array_equal(reached[clear], gantry_reaches(coords)[clear])


def test_limits_of_base_and_wrist_are_counted():
    """With 270 degrees of base and 300 of wrist, what is reached in half of all turns is a yes, but not a certain one.

    The hand can also point backwards, by the other way to turn, but at other places: so in most there is one way.
    """
    turns = (270.0 / 360.0) * (300.0 / 360.0)
    _, arm = gantry(*(f"{-math.radians(a)} {math.radians(a)}" for a in (135.0, 150.0)))
    found = build_map(arm, "cpu", step=STEP, tilt_step=TILT_STEP)
    made, coords = asked(5_000, 3)
    ways = sum((depth < -0.05).astype(int) for depth in gantry_depths(coords))
    never = np.minimum(*gantry_depths(coords)) > 0.1
    verdict = found.verdict(made, "cpu")
    assert found.limited
    assert found.turn_error == pytest.approx(1.0 - turns, abs=0.1)
    assert (verdict[ways == 1] == Verdict.MIXED_YES).mean() > 0.85
    assert not (verdict == Verdict.YES).any()
    assert (verdict[never] <= Verdict.MIXED_NO).mean() > 0.95


def test_what_turns_decide_straight_down_counts_alone():
    """Of a pole's table each ring counts by its radius; a grid whose corners are sure does not hide it."""

    def surface(level: list[list[int]], *more: int) -> Any:
        made = np.array(level, np.uint8)
        lattice = SimpleNamespace(shape=(*made.shape, *more))
        return SimpleNamespace(level=made.ravel(), lattice=lattice)

    assert turn_error(surface([[255, 255], [0, 255]], 1, 1)) == 0.0
    assert turn_error(surface([[204, 255], [0, 51]], 1, 1)) == pytest.approx(0.4 / 2.0)
    assert turn_error(surface([[51, 255, 204]])) == pytest.approx(2 * 0.2 / (1.0 + 2 * 0.8))
    assert turn_error(surface([[0, 0, 0]])) == 0.0


@pytest.mark.parametrize(
    ("name", "degrees", "limited"),
    [("heron", (150.0, 160.0), True), ("heron", (158.0, 165.0), True), ("panda", None, False)],
)
def test_an_arm_is_limited_by_what_it_reaches_from_above(name: str, degrees: tuple[float, float] | None, limited: bool):
    """Heron's verdicts on poses straight down depend on turns, also with more of them; a Panda finds another way."""
    arm = SerialArm.from_model(mujoco.MjModel.from_xml_path(str(ASSETS / f"{name}.xml")), name)
    if degrees is not None:
        lower, upper = arm.lower.copy(), arm.upper.copy()
        upper[[0, -1]] = np.radians(degrees)
        lower[[0, -1]] = -upper[[0, -1]]
        arm = replace(arm, lower=lower, upper=upper)
    assert build_map(arm, "cpu", step=0.2, tilt_step=math.radians(45)).limited is limited


def test_a_build_that_was_stopped_goes_on(built: ReachMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Stopped in each of its stages, it ends with the very same map, and solves nothing twice."""
    monkeypatch.setattr(checkpoint, "_SECONDS", 0.0)
    arm, state = gantry()[1], tmp_path / "state"
    stages = ["grid: corners", "grid: neighbours", "grid: surface along u", "pole0: corners", "pole0: surface"]
    begun: list[str] = []
    for stage in stages:

        def stop(what: str, done: int, total: int, stage: str = stage) -> None:
            begun.append(what)
            if what.startswith(stage):
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt), listening(stop):
            build_map(arm, "cpu", step=STEP, tilt_step=TILT_STEP, state=state)
    again = build_map(arm, "cpu", step=STEP, tilt_step=TILT_STEP, state=state)
    for name in ReachMap.__dataclass_fields__:
        assert name == "arm" or np.array_equal(getattr(again, name), getattr(built, name)), name
    assert begun.count("pole0: corners") <= 2


def test_a_state_of_another_build_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Another seed, or a file that is none: nothing is mixed up, nothing overwritten."""
    monkeypatch.setattr(checkpoint, "_SECONDS", 0.0)
    arm, state = gantry()[1], tmp_path / "state"

    def stop(what: str, done: int, total: int) -> None:
        if what.startswith("grid: neighbours"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), listening(stop):
        build_map(arm, "cpu", step=0.4, tilt_step=1.0, state=state)
    with pytest.raises(MapError, match="the state is from a different build"):
        build_map(arm, "cpu", step=0.4, tilt_step=1.0, seed=1, state=state)
    state.write_text("nothing")
    with pytest.raises(MapError, match="not the saved state of a build"):
        build_map(arm, "cpu", step=0.4, tilt_step=1.0, state=state)


def test_an_arm_that_no_map_fits_is_refused():
    """The message says why, and what to do."""
    leaning = model(chain=link(hinge("0 0.1 1") + link(hinge("0 0 1") + site())))
    with pytest.raises(ArmError, match=r"cannot have a reachability map: the first joint .* `reachable: ik`"):
        build_map(SerialArm.from_model(leaning, "base"), "cpu")


@pytest.mark.parametrize(
    ("steps", "words"), [((0.0, 0.1), "positive"), ((0.1, -1.0), "positive"), ((1e-3, 0.01), "at most .* corners")]
)
def test_steps_that_make_no_grid_are_refused(steps: tuple[float, float], words: str):
    """None, negative, or more corners than addresses."""
    with pytest.raises(MapError, match=words):
        build_map(gantry()[1], "cpu", step=steps[0], tilt_step=steps[1])


@pytest.mark.parametrize("steps", [(1e9, 0.1), (1e-30, 0.1), (1e-320, 0.1), (math.inf, 0.1), (0.1, 9.0), (0.1, 1e-30)])
def test_steps_that_no_arm_has_are_refused(steps: tuple[float, float]):
    """They made maps of a few corners that said yes to everything, or overflowed."""
    with pytest.raises(MapError, match=r"step should be from .* m for a reach of"):
        build_map(gantry()[1], "cpu", step=steps[0], tilt_step=steps[1])


@pytest.mark.parametrize("name", ["gantry", "tall"])
def test_nothing_is_reached_outside_of_the_ball(name: str):
    """The ball about the second joint holds the TCP at 20,000 random joints, and is not much too large."""
    tall = link(hinge("0 1 0", pos="0 0 0.1") + link(hinge("1 0 0") + site(), pos="0 0.1 0.5"), pos="0 0.2 0.3")
    mjm = gantry()[0] if name == "gantry" else model(chain=link(hinge("0 0 1") + tall, pos="0.3 0 0.2"))
    arm = SerialArm.from_model(mjm, "base")
    height, radius = reach_ball(arm, "cpu")
    draws = np.random.default_rng(5)
    joints = draws.uniform(np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi), (20_000, len(arm.joints)))
    away = np.linalg.norm(tcp_poses(mjm, arm, joints)[:, :3, 3] - [*arm.axis_xy, height], axis=1)
    assert away.max() < radius < 1.1 * away.max() + 0.01
