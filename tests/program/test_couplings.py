"""Joints that follow drawn ones: through which positions they pass, and how the device has them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sceniris_gym.program.couplings import coupling_arrays
from sceniris_gym.program.plan import build_plan
from tests.program.scenes import pack
from tests.scene.test_couplings import placed

TIE = '<joint name="gear" joint1="right" joint2="left" polycoef="0 .5"/>'


def test_a_follower_passes_through_what_its_driver_is_drawn_from(tmp_path: Path):
    """Intervals and choices; noise ends where the follower meets its limit."""
    for words, low, high in (
        ({"range": [-0.1, 0.3]}, -0.05, 0.15),
        ({"choice": [0.0, 0.2]}, 0.0, 0.1),
        ({"value": 0.2}, 0.1, 0.1),
    ):
        (o,) = build_plan(placed(tmp_path, TIE, {"left": words})).objects
        (follower,) = o.followers
        np.testing.assert_allclose(o.spans[follower.adr], (low, high), atol=1e-12)
    steep = TIE.replace(".5", "4")
    (o,) = build_plan(placed(tmp_path, steep, {"*": {"noise": 0.2}})).objects
    np.testing.assert_allclose(o.joint_ranges[0].intervals, [(-0.025, 0.05)], atol=1e-8)
    assert build_plan(placed(tmp_path, steep, {})).objects[0].followers == ()


def test_the_device_gets_addresses_and_numbers_of_each_object_s_followers(tmp_path: Path):
    """Lists of length 0 for what has none."""
    packed = pack(placed(tmp_path, TIE, {"left": {"noise": 0.1}}))
    assert packed.listed("pair", "follow", "follow_qposadr") == [1]
    assert packed.listed("pair", "follow", "follow_driveradr") == [0]
    np.testing.assert_allclose(packed["follow_coef"], [[0, 0, 0.5, 0, 0, 0]])
    assert coupling_arrays(())["follow_coef"].shape == (0, 6)
