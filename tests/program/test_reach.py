"""What an arm is to reach, on the host: its map and tier, or why it has none, and the grasps as kernels see them."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.tier import Tier
from sceniris_gym.errors import MapError, ReachWarning, UnknownNameError
from sceniris_gym.program.plan import build_plan
from sceniris_gym.program.reach import build_reaching
from sceniris_gym.scene.model import build_model
from tests.layout.crane import crane_map, crane_mjcf, crane_scene
from tests.layout.grasped import arm_mjcf
from tests.layout.scenes import box_mjcf, write_mjcf


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the assets of these tests are."""
    return tmp_path_factory.mktemp("reach")


@pytest.fixture(scope="module")
def cube(folder: Path) -> str:
    """A cube of 4 cm, which is taken at half its height."""
    return box_mjcf(folder, "cube", 0.04, 0.04, 0.04)


def reaching(scene: dict[str, Any]) -> Any:
    """What of a scene is to be reachable, on the host alone."""
    model = build_model(SceneConfig.load(scene))
    return build_reaching(model, build_plan(model), "cpu")


def test_an_arm_without_a_map_is_told_how_to_build_one(folder: Path, cube: str):
    """For a map tier; `ik` needs none, and decides by default."""
    asset = crane_mjcf(folder, "unmapped")
    for tier in ("map", "map_strict"):
        with pytest.raises(
            MapError, match=r"objects\.thing\.reachable: .*'sceniris-gym reach .*--build -o .*unmapped\.reach'"
        ):
            reaching(crane_scene(asset, cube, reachable=tier))
    for word in ("ik", True):
        assert reaching(crane_scene(asset, cube, reachable=word)).targets[0].tier == Tier.IK


def test_a_map_that_is_built_later_decides_nothing_until_the_scene_names_it(folder: Path, cube: str):
    """It lies where the command writes it: the tier and the hash stay, and both change with the word."""
    asset = crane_mjcf(folder, "later")
    scene = crane_scene(asset, cube, reachable=True)
    before = build_model(SceneConfig.load(scene)).hash
    path = crane_map(asset)
    assert reaching(scene).targets[0].tier == Tier.IK
    assert build_model(SceneConfig.load(scene)).hash == before
    scene["robot"]["map"] = str(path)
    assert reaching(scene).targets[0].tier == Tier.MAP
    assert build_model(SceneConfig.load(scene)).hash != before


def test_a_map_that_is_not_there_is_refused(folder: Path, cube: str):
    """By the key that names it, whatever the tier."""
    scene = crane_scene(crane_mjcf(folder, "lost"), cube, reachable="ik")
    scene["robot"]["map"] = str(folder / "nowhere.reach")
    with pytest.raises(MapError, match=r"robot\.map: .*nowhere\.reach: there is no such reachability map") as told:
        reaching(scene)
    assert str(told.value).endswith(f"--build -o {folder / 'nowhere.reach'}.")  # where the scene looks for it


def test_a_map_of_another_arm_is_refused(folder: Path, cube: str):
    """The crane's turntable is limited after its map was made."""
    asset = crane_mjcf(folder, "changed")
    crane_map(asset)
    crane_mjcf(folder, "changed", turn=3.1)
    with pytest.raises(MapError, match=r"robot\.map: .*changed\.reach"):
        reaching(crane_scene(asset, cube))


@pytest.mark.parametrize(
    ("form", "error", "says"),
    [
        ({"tilt": 0.1}, {}, "first joint"),
        ({"offset": 0.02}, {}, "TCP is 20 mm off"),
        ({}, {"turn_error": 0.2}, "a map does not know"),
        (
            {},
            {"false_accepts": 0.0051},
            r"too coarse: 0\.51% of the poses .* \(build it with finer steps than --step 0\.2",
        ),
    ],
    ids=["leaning", "off axis", "limited", "coarse"],
)
def test_an_arm_that_a_map_does_not_fit_goes_through_ik(
    folder: Path, cube: str, form: dict[str, Any], error: dict[str, Any], says: str
):
    """With a warning where a map was asked for, without one where the default was."""
    asset = crane_mjcf(folder, f"odd_{'_'.join([*form, *error])}", **form)
    if error:
        crane_map(asset, **error)
    with pytest.warns(ReachWarning, match=f"objects.thing.reachable: .*{says}.*, so 'ik' decides"):
        assert reaching(crane_scene(asset, cube)).targets[0].tier == Tier.IK
    with warnings.catch_warnings():
        warnings.simplefilter("error", ReachWarning)
        assert reaching(crane_scene(asset, cube, reachable=True)).targets[0].tier == Tier.IK
        assert reaching(crane_scene(asset, cube, reachable="clear")).targets[0].tier == Tier.CLEAR


@pytest.mark.parametrize("false_accepts", [None, 0.0, 0.005])
def test_a_map_that_is_right_often_enough_decides(folder: Path, cube: str, false_accepts: float | None):
    """So does one from before this was measured; nothing is said about it."""
    asset = crane_mjcf(folder, f"right_{false_accepts}")
    crane_map(asset, false_accepts=false_accepts)
    with warnings.catch_warnings():
        warnings.simplefilter("error", ReachWarning)
        for word in ("map", True):
            assert reaching(crane_scene(asset, cube, reachable=word)).targets[0].tier == Tier.MAP


def test_a_robot_without_a_tcp_is_refused(folder: Path, cube: str):
    """The robot has no site `tcp`."""
    stump = write_mjcf(folder, "stump", '<geom type="box" size="0.1 0.1 0.1"/>')
    keyed = Path(stump).read_text().replace("</worldbody>", '</worldbody><keyframe><key name="home"/></keyframe>')
    Path(stump).write_text(keyed)
    with pytest.raises(
        UnknownNameError, match=r"robot\.asset: 'tcp' should name .*: unknown site 'tcp'.* Valid: stump\."
    ):
        reaching(crane_scene(stump, cube, reachable="ik"))


def test_a_scene_without_anything_to_reach_has_no_arm_to_prepare(folder: Path, cube: str):
    """Though there is a robot."""
    assert reaching(crane_scene(crane_mjcf(folder, "idle"), cube, reachable=False)) is None


@pytest.mark.parametrize("robot", ["panda", "ur5e", "heron", "picker"])
def test_the_hand_moves_with_the_tcp_as_the_device_is_told(robot: str, folder: Path, cube: str):
    """In random joint states MuJoCo finds the hand's first body where it is from the TCP, whatever the fingers do."""
    asset = arm_mjcf(folder) if robot == "picker" else robot  # a picker's hand does not point straight down at home
    objects = {"cube": {"asset": cube, "on": "floor", "reachable": "ik"}}
    stands = {"asset": asset, "base": [0.3, 0.1, 0.2], "yaw": 40.0}
    model = build_model(SceneConfig.load({"floor": {"size": [2, 2]}, "robot": stands, "objects": objects}))
    found = build_reaching(model, build_plan(model), "cpu")
    assert found is not None
    view, arm = found.arms[0].view, found.arms[0].arm
    mjm, data, hand = model.mjm, mujoco.MjData(model.mjm), int(view.hand_body.numpy()[0])
    pos, turn = np.array(view.hand_pos), Rotation.from_quat(np.array(view.hand_quat), scalar_first=True)
    own = [j for j in range(mjm.njnt) if mjm.jnt_bodyid[j] in model.subtree("robot")]
    draws = np.random.default_rng(0)
    for _ in range(20):
        data.qpos[mjm.jnt_qposadr[own]] = draws.uniform(*mjm.jnt_range[own].T)
        mujoco.mj_kinematics(mjm, data)
        tcp = Rotation.from_matrix(data.site_xmat[arm.tcp_site].reshape(3, 3))
        np.testing.assert_allclose(data.site_xpos[arm.tcp_site] + tcp.apply(pos), data.xpos[hand], atol=1e-6)
        np.testing.assert_allclose((tcp * turn).as_matrix(), data.xmat[hand].reshape(3, 3), atol=1e-6)


def test_the_device_finds_the_grasps_of_every_variant(folder: Path, cube: str):
    """Of two things to reach and two that need not be, one of them in many poses; what need not be has none."""
    slab = box_mjcf(folder, "slab", 0.2, 0.15, 0.05)
    objects = {
        "first": {"asset": slab, "on": "floor", "orientation": "stable"},
        "slab": {"asset": slab, "on": "floor", "orientation": "stable", "reachable": "ik"},
        "other": {"asset": cube, "on": "floor"},
        "cube": {"asset": cube, "on": "slab", "reachable": "clear"},
    }
    scene = {"floor": {"size": [2, 2]}, "robot": {"asset": "panda"}, "objects": objects}
    model = build_model(SceneConfig.load(scene))
    plan = build_plan(model)
    found = build_reaching(model, plan, "cpu")
    assert found is not None
    assert found.names == ("slab", "cube")
    view, variant, sizes = found.arms[0].view, 0, []
    for number, o in enumerate(plan.objects):
        column = int(view.obj_reach.numpy()[number])
        assert column == (found.names.index(o.name) if o.name in found.names else -1)
        for v in range(len(o.variants)):
            adr, num = int(view.variant_graspadr.numpy()[variant]), int(view.variant_graspnum.numpy()[variant])
            variant += 1
            sizes.append(num)
            if column < 0:
                assert num == 0
                continue
            target = found.targets[column]
            first, count = target.grasp_set.spans[v]
            expected = target.grasp_set.grasps[first : first + count]
            assert target.number == number
            assert num == count
            for name in ("body", "pos", "quat", "opening"):
                values = getattr(view, f"grasp_{name}").numpy()[adr : adr + num]
                np.testing.assert_allclose(values.ravel(), np.ravel([getattr(g, name) for g in expected]), atol=1e-6)
    assert variant == len(view.variant_graspadr) == 6 + 6 + 1 + 1
    assert len(view.grasp_body) == sum(sizes) > 32
    assert 0 in sizes[6:12]  # lying it is 15 cm wide, and the gripper opens 8 cm
