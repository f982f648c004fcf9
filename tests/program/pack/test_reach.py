"""The views of arms as kernels see them: where the hand is, and the grasps of every variant."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.program.compiled import upload_scene
from sceniris_gym.scene.build import build_model
from tests.layout.grasped import arm_mjcf
from tests.layout.scenes import box_mjcf


@pytest.mark.parametrize("robot", ["panda", "ur5e", "heron", "picker"])
def test_the_hand_moves_with_the_tcp_as_the_device_is_told(robot: str, folder: Path, cube: str):
    """In random joint states MuJoCo finds the hand's first body where it is from the TCP, whatever the fingers do."""
    asset = arm_mjcf(folder) if robot == "picker" else robot  # a picker's hand does not point straight down at home
    objects = {"cube": {"asset": cube, "on": "floor", "reachable": "ik"}}
    stands = {"asset": asset, "base": [0.3, 0.1, 0.2], "yaw": 40.0}
    model = build_model(SceneConfig.load({"floor": {"size": [2, 2]}, "robot": stands, "objects": objects}))
    found = upload_scene(model, "cpu").reaching
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
    compiled = upload_scene(build_model(SceneConfig.load(scene)), "cpu")
    plan, found = compiled.plan, compiled.reaching
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
