"""The command that builds, draws and asks reachability maps."""

import json
import math
import os
import re
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

from benchmarks.sampled_map import canonical
from sceniris_gym import cli
from sceniris_gym.commands import reach
from sceniris_gym.config.tier import Tier
from sceniris_gym.errors import (
    ArgumentError,
    ArmError,
    MapError,
    NotSupportedError,
    ReachWarning,
    SceneKeyError,
    UnknownNameError,
)
from sceniris_gym.reach.arm import SerialArm
from tests.reach.arms import hinge, link, model, site, tcp_poses
from tests.reach.shapes import gantry, gantry_reaches, poses, random_axes


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A gantry as an MJCF file of one's own, with its coarse map beside it."""
    path = tmp_path_factory.mktemp("arm") / "gantry.xml"
    mjm, _ = gantry()
    mujoco.mj_saveLastXML(str(path), mjm)
    reach.build(reach.read_arm(str(path)), path.with_suffix(".reach"), "cpu", step=0.2, tilt_step=math.radians(30))
    return path


def answer(capfd: pytest.CaptureFixture, *arguments: str | Path) -> dict:
    """Run the command with --json, check that stdout is one line, and return what it says."""
    cli.main(["reach", *map(str, arguments), "--json", "--device", "cpu"])
    out = capfd.readouterr().out
    assert out.count("\n") == 1, out
    return json.loads(out)


def asked(tmp_path: Path, made: np.ndarray) -> Path:
    """Write poses."""
    np.save(tmp_path / "poses.npy", made)
    return tmp_path / "poses.npy"


def random_poses(num: int) -> np.ndarray:
    """TCP poses about the gantry, none of them upright."""
    pos = np.random.default_rng(0).uniform([-0.7, -0.7, 0.1], [0.7, 0.7, 0.8], (num, 3))
    return poses(pos, random_axes(num, 1), np.zeros(num))


def test_building_says_what_was_built(arm: Path, tmp_path: Path, capfd: pytest.CaptureFixture):
    """Steps, sizes and the file; what kept the state is gone, and the same map came out as before."""
    out = tmp_path / "again.reach"
    found = answer(capfd, arm, "--build", "-o", out, "--step", "0.2", "--tilt-step", "30")
    assert found["step_m"] == 0.2
    assert found["tilt_step_degrees"] == pytest.approx(30.0)
    assert found["file_bytes"] == out.stat().st_size
    assert [path.name for path in tmp_path.iterdir()] == ["again.reach"]
    assert out.read_bytes() == arm.with_suffix(".reach").read_bytes()


def test_a_map_is_described_and_drawn(arm: Path, tmp_path: Path, capfd: pytest.CaptureFixture):
    """The picture has panels in which something is reached and something is not."""
    found = answer(capfd, arm, "-o", tmp_path / "map.png", "--height", "0.4")
    assert found["joints"] == 6
    assert found["full_turn_of_base"] is found["full_turn_of_wrist"] is True
    picture = np.asarray(Image.open(tmp_path / "map.png"))
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 20


def test_poses_get_verdicts(arm: Path, tmp_path: Path, capfd: pytest.CaptureFixture):
    """By each tier, in the order of the poses; `map_strict` says yes to a part of what `map` says yes to."""
    made = random_poses(400)
    verdicts = {}
    for tier in ("map", "map_strict", "ik"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ReachWarning)  # of so coarse a map
            found = answer(capfd, arm, "--poses", asked(tmp_path, made), "-o", tmp_path / f"{tier}.npy", "--tier", tier)
        verdicts[tier] = np.load(tmp_path / f"{tier}.npy")
        assert verdicts[tier].dtype == bool
        assert verdicts[tier].shape == (400,)
        assert found == {
            "arm": "gantry",
            "tier": tier,
            "poses": 400,
            "reached": int(verdicts[tier].sum()),
            "file": str(tmp_path / f"{tier}.npy"),
        }
    assert not (verdicts["map_strict"] & ~verdicts["map"]).any()
    assert (verdicts["map"] == verdicts["ik"]).mean() > 0.9


def test_ik_is_exact(arm: Path, tmp_path: Path, capfd: pytest.CaptureFixture):
    """Poses of the gantry are reached wherever its closed form says so, but for those on the very edge."""
    made = random_poses(600)
    answer(capfd, arm, "--poses", asked(tmp_path, made), "-o", tmp_path / "ik.npy", "--tier", "ik")
    truth = gantry_reaches(canonical(made[:, :3, 3], made[:, :3, 2], np.zeros(2)))
    assert (np.load(tmp_path / "ik.npy") == truth).mean() > 0.99


def test_an_arm_that_hits_itself_is_not_there():
    """Two links of a planar arm: stretched out it reaches, folded up its tip is in its base."""
    tip = link(hinge("0 0 1", "-3 3") + '<geom size="0.04" pos="0.3 0 0"/>' + site("0.3 0 0"), pos="0.3 0 0")
    mjm = model(chain='<geom size="0.1"/>' + link(hinge("0 0 1") + tip))
    arm = SerialArm.from_model(mjm, "base")
    joints = np.array([[0.3, 0.4], [0.3, 2.9], [-1.0, -2.9], [1.0, -1.5]])
    assert reach.hits_itself(mjm, arm, joints).tolist() == [False, True, True, False]
    kept = reach.judge_poses(mjm, arm, None, tcp_poses(mjm, arm, joints), Tier.IK, "cpu")
    assert kept.tolist() == [True, False, False, True]


def test_without_a_map_poses_are_solved(tmp_path: Path, capfd: pytest.CaptureFixture):
    """An arm with no map yet, and one that can have none, say why their default tier is `ik`."""
    mjm, _ = gantry()
    path = tmp_path / "new.xml"
    mujoco.mj_saveLastXML(str(path), mjm)
    found = answer(capfd, path, "--poses", asked(tmp_path, random_poses(20)), "-o", tmp_path / "out.npy")
    assert found["tier"] == "ik"
    assert (
        "it has no map yet (build one, on a GPU in seconds, on a CPU core in hours: sceniris-gym reach"
        in found["why_ik"]
    )
    mujoco.mj_saveLastXML(str(path), model(chain=link(hinge("0 0.3 1") + link(hinge() + site()))))
    found = answer(capfd, path)
    assert found["default_tier"] == "ik"
    assert "degrees off the z axis" in found["why_ik"]
    given = reach.read_arm(str(path))
    with pytest.raises(MapError, match=r"cannot have a map: .* Use --tier ik"):
        reach.judge(given, None, tmp_path / "poses.npy", tmp_path / "out.npy", Tier.of("map"), "cpu")


def test_clear_needs_a_layout(arm: Path, tmp_path: Path):
    """Poses alone have none."""
    given, poses_file = reach.read_arm(str(arm)), asked(tmp_path, random_poses(2))
    with pytest.raises(NotSupportedError, match="--poses gives none"):
        reach.judge(given, None, poses_file, tmp_path / "out.npy", Tier.of("clear"), "cpu")


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (np.zeros((4, 4)), "holds float64 of shape"),
        (np.zeros((3, 4, 4)), "pose 0 is not a rigid"),
        (np.full((1, 4, 4), np.nan), "pose 0 is not a rigid"),
        (np.stack([np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0])]), "pose 1 is not a rigid"),
        (np.array([["a"]]), "holds <U1"),
    ],
)
def test_a_file_that_holds_no_poses_is_refused(arm: Path, tmp_path: Path, made: np.ndarray, words: str):
    """The form that is right is named."""
    with pytest.raises(ArgumentError, match=words):
        reach.read_poses(asked(tmp_path, made))
    with pytest.raises(ArgumentError, match="no such file"):
        reach.read_poses(tmp_path / "none.npy")
    os.mkfifo(tmp_path / "pipe.npy")
    with pytest.raises(ArgumentError, match="a pipe or a device, not a file"):
        reach.read_poses(tmp_path / "pipe.npy")
    (tmp_path / "text.npy").write_text("no array")
    with pytest.raises(ArgumentError, match="cannot read"):
        reach.read_poses(tmp_path / "text.npy")


def test_what_is_no_arm_is_refused():
    """A name that is not shipped, and an asset without a TCP."""
    with pytest.raises(UnknownNameError, match=r"unknown arm 'pandas'\. Did you mean 'panda'"):
        reach.read_arm("pandas")
    with pytest.raises((UnknownNameError, ArmError), match="tcp"):
        reach.read_arm("mug")


def test_an_mjcf_that_has_no_arm_is_refused(tmp_path: Path):
    """No body at all, and one that no joint moves."""
    path = tmp_path / "none.xml"
    path.write_text("<mujoco/>")
    with pytest.raises(SceneKeyError, match=r"robot\.asset: an asset should have a body"):
        reach.read_arm(str(path))
    path.write_text("<mujoco><worldbody><body><geom size='0.1'/><site name='tcp'/></body></worldbody></mujoco>")
    with pytest.raises(ArmError, match=r"arm 'none': no joint is between this body and the site"):
        reach.read_arm(str(path))


def test_an_arm_without_a_site_is_told_its_tcp(tmp_path: Path):
    """By a word of the scene, as `--set` has it."""
    link = "<body name='hand'><joint axis='0 0 1'/><geom size='0.1'/></body>"
    (tmp_path / "own.xml").write_text(f"<mujoco><worldbody><body name='b'>{link}</body></worldbody></mujoco>")
    _, _, arm = reach.read_arm(str(tmp_path / "own.xml"), {"robot.tcp": "hand"})
    assert (arm.name, len(arm.joints)) == ("own", 1)


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_positions_that_are_no_numbers_are_refused(tmp_path: Path, number: float):
    """A rotation alone is no pose."""
    made = np.tile(np.eye(4), (3, 1, 1))
    made[2, 1, 3] = number
    with pytest.raises(ArgumentError, match="pose 2 is not a rigid transform"):
        reach.read_poses(asked(tmp_path, made))


def test_the_advice_never_overwrites_another_arms_map(arm: Path, tmp_path: Path, capfd: pytest.CaptureFixture):
    """With --map the own map is named, or how to build one where it is looked for; an own MJCF by its path."""
    poses_file, out = asked(tmp_path, random_poses(2)), tmp_path / "out.npy"
    panda = reach.map_path("panda")
    with pytest.raises(MapError, match=r"links, limits or TCP differ\. Leave out --map") as told:
        reach.judge(reach.read_arm(str(arm)), panda, poses_file, out, Tier.of("map"), "cpu")
    assert "--build" not in str(told.value)
    mjm, _ = gantry()
    new = tmp_path / "new.xml"
    mujoco.mj_saveLastXML(str(new), mjm)
    build = f"sceniris-gym reach {new} --build -o {new.with_suffix('.reach')}"
    for path in (panda, poses_file, None):
        with pytest.raises(MapError) as told:
            reach.judge(reach.read_arm(str(new)), path, poses_file, out, Tier.of("map"), "cpu")
        assert str(told.value).endswith((f"{build}.", f"{build})."))
    new.with_suffix(".reach").write_text("damaged")
    with pytest.raises(MapError, match="the file is damaged, or not a reachability map") as told:
        reach.judge(reach.read_arm(str(new)), None, poses_file, out, Tier.of("map"), "cpu")
    assert str(told.value).endswith(f"Build it again: {build}.")


def test_a_map_goes_where_it_is_looked_for(tmp_path: Path, capfd: pytest.CaptureFixture):
    """Without -o beside the MJCF; elsewhere the answer says how it is used."""
    mjm, _ = gantry()
    mujoco.mj_saveLastXML(str(tmp_path / "new.xml"), mjm)
    steps = ("--step", "0.4", "--tilt-step", "60")
    found = answer(capfd, tmp_path / "new.xml", "--build", *steps)
    assert found["file"] == str(tmp_path / "new.reach")
    assert "used_with" not in found
    assert answer(capfd, tmp_path / "new.xml", "-o", tmp_path / "a.png")["step_m"] == 0.4
    found = answer(capfd, tmp_path / "new.xml", "--build", *steps, "-o", tmp_path / "other.reach")
    assert found["used_with"] == f"--map {tmp_path / 'other.reach'}"
    assert reach.default_map("panda") == Path("panda.reach")


def test_one_command_at_a_time(arm: Path, tmp_path: Path, capfd: pytest.CaptureFixture):
    """Nothing that is asked for is passed over in silence."""
    with pytest.raises(SystemExit):
        cli.main(["reach", str(arm), "--build", "--poses", str(asked(tmp_path, random_poses(2)))])
    assert "--build and --poses cannot be combined" in capfd.readouterr().err


@pytest.mark.parametrize("height", [math.nan, math.inf, 50.0, -50.0])
def test_a_height_without_a_map_is_refused(arm: Path, tmp_path: Path, height: float):
    """Above, below, and nowhere."""
    with pytest.raises(MapError, match=r"--height .*: should be from -?\d.* to \d.* m"):
        reach.show(reach.read_arm(str(arm)), None, tmp_path / "a.png", height, "cpu")


def test_a_picture_is_a_png(arm: Path, tmp_path: Path):
    """Another suffix is refused before any work is done."""
    for draw in (
        lambda out: reach.show(reach.read_arm(str(arm)), None, out, 0.1, "cpu"),
        lambda out: cli.check.__wrapped__("mid", picture=out),  # pyrefly: ignore[missing-attribute]
    ):
        with pytest.raises(NotSupportedError, match=r"a\.jpg: a picture should be a PNG"):
            draw(tmp_path / "a.jpg")


def test_a_map_that_depends_on_turns_is_used_with_a_warning(tmp_path: Path):
    """As a scene does; the default tier needs none."""
    down = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (2, 1, 1))
    down[:, :3, 3] = [0.4, 0.0, 0.1]
    poses_file, out = asked(tmp_path, down), tmp_path / "out.npy"
    for tier in ("map", "map_strict"):
        with pytest.warns(ReachWarning, match=rf"heron --tier {tier}: .*its map is wrong about 2\.4%"):
            reach.judge(reach.read_arm("heron"), None, poses_file, out, Tier.of(tier), "cpu")
    with warnings.catch_warnings():
        warnings.simplefilter("error", ReachWarning)
        found = reach.judge(reach.read_arm("heron"), None, poses_file, out, None, "cpu")
        reach.judge(reach.read_arm("panda"), None, poses_file, out, Tier.of("map"), "cpu")
    assert found["tier"] == "ik"
    assert "which maps ignore" in found["why_ik"]


def test_a_map_that_is_too_coarse_says_so(arm: Path, tmp_path: Path, capfd: pytest.CaptureFixture):
    """Once built and whenever it is described, with the share that it accepts wrongly; asked for, it is used."""
    found = answer(capfd, arm, "--build", "-o", tmp_path / "again.reach", "--step", "0.2", "--tilt-step", "30")
    shown = answer(capfd, arm, "-o", tmp_path / "a.png", "--height", "0.4")
    share = found["false_accepts"]
    assert share > 0.02
    assert shown["false_accepts"] == share
    says = rf"too coarse: {share:.2%} of the poses that it accepts, .* finer steps than --step 0\.2 --tilt-step 30\)"
    for told in (found, shown):
        assert told["default_tier"] == "ik"
        assert re.search(says, told["why_ik"])
    poses_file, out = asked(tmp_path, random_poses(20)), tmp_path / "out.npy"
    with pytest.warns(ReachWarning, match=f"--tier map: its map is {says}"):
        assert reach.judge(reach.read_arm(str(arm)), None, poses_file, out, Tier.MAP, "cpu")["tier"] == "map"
    with warnings.catch_warnings():
        warnings.simplefilter("error", ReachWarning)
        judged = reach.judge(reach.read_arm(str(arm)), None, poses_file, out, None, "cpu")
    assert (judged["tier"], judged["why_ik"]) == ("ik", shown["why_ik"])


def test_a_map_that_was_not_measured_is_used():
    """The shipped ones are such; their default is what it was."""
    for name, tier in (("panda", "map"), ("ur5e", "map"), ("heron", "ik")):
        given = reach.read_arm(name)
        found = reach.describe(given, reach.find_map(given, None))
        assert (found["false_accepts"], found["default_tier"]) == (None, tier)
