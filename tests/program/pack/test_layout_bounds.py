"""Bounds of a layout's numbers: they hold what the scene draws, and not much more."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sceniris_gym.program.pack.layout_bounds import layout_bounds
from sceniris_gym.program.plan import build_plan
from tests.program.scenes import BOX, GADGET, scene_of


def test_drawn_joints_keep_to_what_is_drawn_and_others_to_their_home(tmp_path: Path):
    """A slide is drawn, a hinge stays, a free box may be anywhere within reach and has a unit quaternion."""
    gadget, box = tmp_path / "gadget.xml", tmp_path / "box.xml"
    gadget.write_text(GADGET)
    box.write_text(BOX)
    scene = scene_of(
        {
            "gadget": {
                "asset": str(gadget),
                "kind": "fixture",
                "on": "floor",
                "joints": {"slide": {"range": [-0.1, 0.2]}},
            },
            "box": {"asset": str(box), "on": "floor"},
        }
    )
    bounds = layout_bounds(build_plan(scene))
    joints = scene.joints("gadget")
    slide, hinge = (int(scene.mjm.jnt_qposadr[joints[name]]) for name in ("slide", "hinge"))
    free = int(scene.mjm.jnt_qposadr[scene.mjm.joint("box/free").id])
    np.testing.assert_allclose(bounds["bound_qpos"][[slide, hinge]], [0.2, 0.5], atol=3e-3)
    assert (bounds["bound_qpos"][free : free + 3] > 1000).all()
    np.testing.assert_allclose(bounds["bound_qpos"][free + 3 : free + 7], 1.0, atol=3e-3)
    assert bounds["quat_qposadr"].tolist() == [free + 3]
    assert bounds["bound_mocap"].shape == (1,)
