"""Device code's view of `reachable` and of starts: every field is there, and kernels read what the host knows."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import warp as wp
from scipy.spatial.transform import Rotation

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.program.compiled import upload_scene
from sceniris_gym.program.device_reach import Reach, Starts
from sceniris_gym.program.reach import Reaching
from sceniris_gym.reach.arm import MAX_JOINTS
from sceniris_gym.reach.solve import forward, vec8
from sceniris_gym.scene.build import build_model
from sceniris_gym.scene.model import SceneModel
from tests.layout.scenes import box_mjcf
from tests.layout.starting import starting
from tests.program.round_trip import assert_comes_back


@wp.kernel(enable_backward=False, module="unique")
def _read(
    reach: Reach,
    # Out:
    numbers: wp.array[int],
    home: wp.array[wp.vec3],
    grasp: wp.array[wp.vec3],
):
    """Follow addresses through the struct and those inside of it."""
    column = wp.tid()
    numbers[column] = reach.grasp_body[reach.reach_graspadr[column] + reach.reach_graspnum[column] - 1]
    q = vec8()
    for i in range(MAX_JOINTS):
        q[i] = reach.map.home[i]
    pos, _turn = forward(reach.arm, q)
    home[column] = pos
    grasp[column] = reach.grasp_pos[reach.reach_graspadr[column]]


def _arrays(view: Any, name: str = "Reach") -> Iterator[tuple[str, Any, Any]]:
    """Name, declared type and value of all array fields, those of structs inside too."""
    for key, var in view._cls.vars.items():
        value = getattr(view, key)
        if wp.types.is_array(var.type):
            yield f"{name}.{key}", var.type, value
        elif hasattr(value, "_cls"):
            yield from _arrays(value, f"{name}.{key}")


@pytest.fixture(params=["panda", "heron"])
def scene(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[SceneModel, Reaching]:
    """An arm with a map, and two things to reach of three."""
    cube = {"asset": box_mjcf(tmp_path, "cube", 0.04, 0.04, 0.04), "on": "floor"}
    objects = {"one": {**cube, "reachable": "ik"}, "two": cube, "three": {**cube, "reachable": "clear"}}
    robot = {"asset": request.param, "base": [0.5, -0.3, 0.1], "yaw": 70}
    model = build_model(SceneConfig.load({"floor": {"size": [2, 2]}, "robot": robot, "objects": objects}))
    reaching = upload_scene(model, "cpu").reaching
    assert reaching is not None
    return model, reaching


def test_every_field_is_filled_in_its_declared_type(scene: tuple[SceneModel, Reaching]):
    """Those of the arm and the map too: what nobody filled would be a null pointer in a kernel."""
    found = list(_arrays(scene[1].arms[0].view))
    assert len(found) > 30
    for name, declared, value in found:
        assert value is not None, name
        assert (value.dtype, value.ndim) == (declared.dtype, declared.ndim), name
        assert np.isfinite(value.numpy().astype(float)).all(), name


def test_a_kernel_reads_what_the_host_knows(scene: tuple[SceneModel, Reaching]):
    """The arm's start pose by MuJoCo C, in the frame of its base; the first and the last grasp of each column."""
    model, reaching = scene
    n = len(reaching.targets)
    numbers = wp.zeros(n, dtype=int, device="cpu")
    home, grasp = (wp.zeros(n, dtype=wp.vec3, device="cpu") for _ in range(2))
    wp.launch(_read, dim=n, inputs=[reaching.arms[0].view, numbers, home, grasp], device="cpu")
    data = mujoco.MjData(model.mjm)
    data.qpos[:] = model.home_qpos
    mujoco.mj_kinematics(model.mjm, data)
    base = Rotation.from_matrix(data.xmat[model.bodies["robot"]].reshape(3, 3))
    tcp = base.inv().apply(data.site_xpos[reaching.arms[0].arm.tcp_site] - data.xpos[model.bodies["robot"]])
    np.testing.assert_allclose(home.numpy(), np.tile(tcp, (n, 1)), atol=1e-5)
    assert numbers.numpy().tolist() == [model.bodies[name] for name in ("one", "three")]
    expected = [target.grasp_set.grasps[0].pos for target in reaching.targets]
    np.testing.assert_allclose(grasp.numpy(), expected, atol=1e-6)


def test_columns_bodies_and_joints_are_those_of_the_model(scene: tuple[SceneModel, Reaching]):
    """Columns in placement order; all of the robot but its base, parents first; the hand's first body first."""
    model, reaching = scene
    view, mjm = reaching.arms[0].view, model.mjm
    assert view.obj_reach.numpy().tolist() == [0, -1, 1]
    assert view.reach_obj.numpy().tolist() == view.reach_slot.numpy().tolist() == [0, 2]
    arm, hand = view.arm_body.numpy(), view.hand_body.numpy()
    assert {*arm, view.base_body} == {b for b in range(mjm.nbody) if mjm.body_rootid[b] == view.base_body}
    seen = {view.base_body}
    for body in arm:
        assert mjm.body_parentid[body] in seen
        seen.add(body)
    assert mjm.body_parentid[hand[0]] not in hand
    assert all(mjm.body_parentid[body] in hand for body in hand[1:])
    assert [mjm.joint(int(np.flatnonzero(mjm.jnt_qposadr == adr)[0])).name for adr in view.arm_qposadr.numpy()] == [
        *reaching.arms[0].arm.joints
    ]
    assert view.reach_below.numpy().tolist() == [True, True]
    assert view.mapped


def test_starts_are_kept_with_a_compiled_scene():
    """All fields are the same after a round trip."""
    assert_comes_back(starting(), "starts", Starts)
