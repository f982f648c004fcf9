"""What follows drawn joints: through which positions, and the draws that cannot be followed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.program.couplings import coupling_arrays
from sceniris_gym.program.plan import build_plan
from tests.layout.scenes import write_mjcf
from tests.program.scenes import pack, scene_of
from tests.scene.test_couplings import placed

TIE = '<joint name="gear" joint1="right" joint2="left" polycoef="0 .5"/>'


def test_a_follower_passes_through_what_its_driver_is_drawn_from(tmp_path: Path):
    """Intervals and choices; noise ends where the follower meets its limit."""
    for words, low, high in (
        ({"range": [-0.1, 0.3]}, -0.05, 0.15),
        ({"choice": [0.0, 0.2]}, 0.0, 0.1),
        ({"value": 0.2}, 0.1, 0.1),
    ):
        ((f,),) = (o.followers for o in build_plan(placed(tmp_path, TIE, {"left": words})).objects)
        np.testing.assert_allclose((f.low, f.high), (low, high), atol=1e-12)
    steep = TIE.replace(".5", "4")
    (o,) = build_plan(placed(tmp_path, steep, {"*": {"noise": 0.2}})).objects
    np.testing.assert_allclose(o.joint_ranges[0].intervals, [(-0.025, 0.05)], atol=1e-8)
    assert build_plan(placed(tmp_path, steep, {})).objects[0].followers == ()


def test_draws_that_take_a_follower_beyond_its_limits_are_refused(tmp_path: Path):
    """With the positions, the limits and what to draw less of."""
    with pytest.raises(SceneKeyError) as caught:
        build_plan(placed(tmp_path, TIE.replace(".5", "-1"), {"left": {"fraction": [0, 1]}}))
    for text in (
        "objects.pair.joints",
        "equality 'pair/gear' (joint)",
        "'pair/right' follow 'pair/left'",
        "from -0.3 to 0.1",
        "[-0.1, 0.2]",
        "Draw 'pair/left' from a smaller range",
    ):
        assert text in str(caught.value)


def test_a_joint_of_something_else_cannot_follow(tmp_path: Path):
    """Two objects of an own model; where nothing is drawn both stay as they are."""
    doors = "".join(
        f'<body name="{n}" pos="{x} 0 0"><joint name="{n}"/><geom size=".1"/></body>' for x, n in enumerate("ab")
    )
    (tmp_path / "own.xml").write_text(
        f"<mujoco><worldbody>{doors}</worldbody><equality><joint joint1='a' joint2='b'/></equality></mujoco>"
    )
    objects: dict[str, Any] = {"a": {"kind": "static"}, "b": {"kind": "static"}}
    build_plan(scene_of(objects, model=str(tmp_path / "own.xml")))
    objects["b"]["joints"] = {"b": {"range": [0, 1]}}
    with pytest.raises(
        NotSupportedError, match=r"objects.b.joints: joint 'b' is drawn.*joint 'a' follow.*not part of 'b'"
    ):
        build_plan(scene_of(objects, model=str(tmp_path / "own.xml")))


def test_the_device_gets_addresses_and_numbers_of_each_object_s_followers(tmp_path: Path):
    """Lists of length 0 for what has none."""
    packed = pack(placed(tmp_path, TIE, {"left": {"noise": 0.1}}))
    assert packed.listed("pair", "follow", "follow_qposadr") == [1]
    assert packed.listed("pair", "follow", "follow_driveradr") == [0]
    np.testing.assert_allclose(packed["follow_coef"], [[0, 0, 0.5, 0, 0, 0]])
    assert coupling_arrays(())[2].shape == (0, 6)


def test_a_support_leans_with_a_joint_that_follows(tmp_path: Path):
    """As it does with one that is drawn itself."""
    tray = """<geom type="box" size=".1 .1 .01"/>
      <body name="knob" pos=".3 0 .2"><joint name="knob" axis="0 0 1" range="-30 30"/><geom size=".01"/></body>
      <body name="tray" pos="0 0 .2"><joint name="tilt" axis="1 0 0" range="-30 30"/>
        <geom type="box" size=".1 .1 .01"/></body>"""
    rest = '<equality><joint joint1="tilt" joint2="knob"/></equality>'
    asset = write_mjcf(tmp_path, "stand", tray, rest)
    stand = {"asset": asset, "kind": "fixture", "on": "floor"}
    for joints, tilts in (({}, False), ({"knob": {"noise": 0.2}}, True)):
        scene = scene_of({"stand": {**stand, "joints": joints}, "apple": {"asset": "apple", "on": "stand/tray"}})
        assert build_plan(scene).objects[-1].tilts == tilts
