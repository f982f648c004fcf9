"""The tool centre point of a robot from outside: a site, a body or an offset, with the fingers closing along +y."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneKeyError, UnknownNameError
from sceniris_gym.scene.adopt import edit_spec
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel

FINGER = (
    '<body name="{0}" pos="{1}"><joint name="{0}" type="slide" axis="{2}" range="0 .03"/>'
    '<geom type="box" size=".005 .005 .02"/></body>'
)
# An arm of another maker: no keyframe, no site 'tcp', fingers that close along its x axis.
ARM = """
<mujoco>
  <worldbody><body name="pedestal"><geom type="box" size=".05 .05 .05"/>
    <body name="link" pos="0 0 .1"><joint name="turn" type="hinge" axis="0 0 1" range="-3 3"/>
      <geom type="box" size=".02 .02 .05"/>
      <body name="palm" pos=".3 0 .1" quat="0 1 0 0"><joint name="wrist" type="hinge" axis="0 0 1" range="-3 3"/>
        <geom type="box" size=".03 .03 .01"/><site name="grip" pos="0 0 .05"/>{fingers}
      </body></body></body></worldbody>
</mujoco>
"""


def arm(folder: Path, axes: Sequence[float], **robot: Any) -> SceneModel:
    """Build a scene of an arm whose fingers move outwards at these angles [degrees]."""
    ways = [(np.cos(a), np.sin(a)) for a in np.radians(axes)]
    fingers = [FINGER.format(f"f{i}", f"{0.01 * x} {0.01 * y} .05", f"{x} {y} 0") for i, (x, y) in enumerate(ways)]
    (folder / "arm.xml").write_text(ARM.format(fingers="".join(fingers)))
    words = {"robot": {"asset": str(folder / "arm.xml"), **robot}, "objects": {}}
    return build_model(SceneConfig.load({"floor": {"size": [1, 1]}, **words}))


def pose(scene: SceneModel) -> tuple[np.ndarray, np.ndarray]:
    """Return position and axes of the TCP at home, in the frame of the palm."""
    data = mujoco.MjData(scene.mjm)
    data.qpos[:] = scene.home_qpos
    mujoco.mj_kinematics(scene.mjm, data)
    palm, tcp = data.body("arm/palm"), data.site(scene.tcps["robot"])
    back = palm.xmat.reshape(3, 3).T
    return back @ (tcp.xpos - palm.xpos), back @ tcp.xmat.reshape(3, 3)


@pytest.mark.parametrize("tcp", ["grip", {"site": "grip"}, {"body": "palm", "offset": [0, 0, 0.05]}])
def test_a_site_a_body_or_an_offset_is_the_same_place(tmp_path: Path, tcp: Any):
    """5 cm beyond the palm. Fingers that close along x turn the frame, so that they close along y."""
    pos, axes = pose(arm(tmp_path, [0, 180], tcp=tcp))
    np.testing.assert_allclose(pos, [0, 0, 0.05], atol=1e-9)
    np.testing.assert_allclose(axes[:, 2], [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(np.abs(axes[:, 1]), [1, 0, 0], atol=1e-6)


@pytest.mark.parametrize(
    "site", ["gripperframe", "attachment_site", "hand/pinch", "grasp_site", "ee_site", "grip_site", "link_tcp"]
)
def test_a_site_of_a_usual_name_is_the_tcp_of_a_robot_without_tcp(tmp_path: Path, monkeypatch: Any, site: str):
    """As if the scene named it, so that the fingers close along y; a site `tcp` comes first, and stays as it is."""
    monkeypatch.setattr(f"{__name__}.ARM", ARM.replace('name="grip"', f'name="{site}"'))
    named, found = arm(tmp_path, [0, 180], tcp=site), arm(tmp_path, [0, 180])
    assert found.tcps == named.tcps == {"robot": "arm/tcp"}
    np.testing.assert_array_equal(pose(found)[0], pose(named)[0])
    np.testing.assert_allclose(np.abs(pose(found)[1][:, 1]), [1, 0, 0], atol=1e-6)
    monkeypatch.setattr(f"{__name__}.ARM", ARM.replace("<site", '<site name="tcp"/><site'))
    np.testing.assert_array_equal(pose(arm(tmp_path, [0, 180]))[1], np.eye(3))


def test_a_model_in_memory_gets_no_site_that_the_scene_does_not_ask_for(tmp_path: Path, monkeypatch: Any):
    """Its sites are part of the scene's hash; a site that needs no turn is the TCP there too."""
    monkeypatch.setattr(f"{__name__}.ARM", ARM.replace('name="grip"', 'name="pinch"'))
    for axes, tcp in (([0, 180], "tcp"), ([90, -90], "pinch")):
        arm(tmp_path, axes)
        spec = mujoco.MjSpec.from_file(str(tmp_path / "arm.xml"))
        for model in (spec, spec.compile()):
            scene = build_model(SceneConfig.load({"model": model, "robot": {"in_model": "pedestal"}, "objects": {}}))
            assert (scene.tcps["robot"], scene.mjm.nsite) == (tcp, 1)


def test_a_site_that_suits_is_taken_as_it_is(tmp_path: Path):
    """Nothing is added to the model: two fingers that close along y, or none."""
    for axes in ([90, -90], []):
        scene = arm(tmp_path, axes, tcp="grip")
        assert scene.tcps["robot"] == "arm/grip"
        assert scene.mjm.nsite == 1


def test_three_fingers_close_along_the_way_of_one_of_them(tmp_path: Path):
    """At 120 degrees from each other; with one opposite to two, along their common axis."""
    _, axes = pose(arm(tmp_path, [20, 140, 260], tcp="grip"))
    closing = np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
    assert np.min(np.abs((closing - np.array([20, 140, 260]) + 90) % 180 - 90)) < 1
    _, axes = pose(arm(tmp_path, [0, 170, 190], tcp="grip"))
    assert abs(axes[0, 1]) > 0.999


def test_a_yaw_that_is_given_is_kept(tmp_path: Path):
    """Roll, pitch and yaw are turns about x, then y, then z; the fingers are not measured then."""
    _, axes = pose(arm(tmp_path, [0, 180], tcp={"site": "grip", "roll": 10, "pitch": 20, "yaw": 30}))
    expected = Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix()
    np.testing.assert_allclose(axes, expected, atol=1e-9)


def test_a_robot_without_a_keyframe_starts_from_its_default(tmp_path: Path):
    """`qpos0`, also with joints that have noise; a keyframe that is asked for must be there."""
    scene = arm(tmp_path, [90, -90], tcp="grip", joints={"turn": {"noise": 0.1}})
    np.testing.assert_array_equal(scene.home_qpos, scene.mjm.qpos0)
    with pytest.raises(UnknownNameError, match="unknown keyframe 'home'"):
        arm(tmp_path, [], tcp="grip", keyframe="home")


def test_a_robot_stands_on_a_wall_or_upside_down(tmp_path: Path):
    """Its base is turned about x, then y, then z of the world."""
    scene = arm(tmp_path, [], tcp="grip", base=[0, 0, 1], roll=180, pitch=30, yaw=40)
    data = mujoco.MjData(scene.mjm)
    mujoco.mj_kinematics(scene.mjm, data)
    expected = Rotation.from_euler("xyz", [180, 30, 40], degrees=True).as_matrix()
    np.testing.assert_allclose(data.body("arm").xmat.reshape(3, 3), expected, atol=1e-9)


def test_a_robot_that_is_in_the_model_keeps_its_place_and_gets_its_tcp(tmp_path: Path):
    """From a file and from a specification; a MjModel needs the site already, and says so."""
    arm(tmp_path, [0, 180])
    spec = mujoco.MjSpec.from_file(str(tmp_path / "arm.xml"))
    robot = {"in_model": "pedestal", "tcp": "grip"}
    for model in (str(tmp_path / "arm.xml"), spec):
        scene = build_model(SceneConfig.load({"model": model, "robot": robot, "objects": {}}))
        assert scene.bodies["robot"] == scene.mjm.body("pedestal").id
        assert (scene.tcps["robot"], list(scene.joints("robot"))) == ("tcp", ["turn", "wrist", "f0", "f1"])
    with pytest.raises(SceneKeyError, match=r"robot\.tcp: would add a site .* whose \+z is the approach axis"):
        build_model(SceneConfig.load({"model": spec.compile(), "robot": robot, "objects": {}}))
    with pytest.raises(UnknownNameError, match=r"robot\.in_model: unknown body of the model 'pedestel'.*'pedestal'"):
        build_model(SceneConfig.load({"model": spec, "robot": {"in_model": "pedestel"}, "objects": {}}))


@pytest.mark.parametrize(
    ("tcp", "says"),
    [
        ("gripp", r"robot\.tcp: unknown robot site or body 'gripp'.*'grip'.*palm"),
        ({"site": "palm"}, "unknown robot site 'palm'.*grip"),
        ({"body": "grip"}, "unknown robot body 'grip'.*palm"),
    ],
)
def test_a_tcp_that_is_not_there_is_refused_with_those_that_are(tmp_path: Path, tcp: Any, says: str):
    """By the key of the scene file."""
    with pytest.raises(UnknownNameError, match=says):
        arm(tmp_path, [], tcp=tcp)


def test_place_on_adds_the_tcp_that_a_compiled_model_needs(tmp_path: Path):
    """Then the MjModel is taken as it is, and the site is found where it was put."""
    arm(tmp_path, [0, 180])
    spec = mujoco.MjSpec.from_file(str(tmp_path / "arm.xml"))
    robot = {"in_model": "pedestal", "tcp": {"body": "palm", "offset": [0, 0, 0.05]}}
    edit_spec(spec, {"robot": robot, "objects": {}})
    scene = build_model(SceneConfig.load({"model": spec.compile(), "robot": {"in_model": "pedestal"}, "objects": {}}))
    site = scene.mjm.site(scene.tcps["robot"])
    np.testing.assert_allclose(site.pos, [0, 0, 0.05], atol=1e-9)
    assert scene.mjm.body(int(site.bodyid[0])).name == "palm"
