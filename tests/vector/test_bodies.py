"""Heights of bodies against all points that physics collides of them, and contacts where things were put."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
import torch

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentTypeError, NotSupportedError, UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.bodies import Bounds, ContactSensor
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.driving import Drive

NAMES = ("can", "banana", "block")

SCENE = {
    "floor": {"size": [2.0, 2.0]},
    "robot": {"asset": "panda", "base": [0.1, 0.2, 0.3], "yaw": 40},
    "objects": {
        "goal": {"kind": "marker", "on": "floor"},
        "can": {"asset": "can", "on": "floor", "ratio_on_support": 1, "region": {"box": [[0.4, -0.3], [0.6, -0.2]]}},
        "banana": {"asset": "banana", "on": "floor", "region": {"box": [[0.4, 0.5], [0.6, 0.6]]}},
        "block": {"asset": "block", "on": "floor", "ratio_on_support": 1, "region": {"box": [[0.4, 0.2], [0.6, 0.3]]}},
    },
}
TOUCH_SCENE = {
    "floor": {"size": [2.0, 2.0]},
    "robot": {"asset": "panda"},
    "objects": {
        "block": {"asset": "block", "on": "floor", "ratio_on_support": 1, "region": {"box": [[0.4, 0.2], [0.6, 0.3]]}},
        "can": {"asset": "can", "on": "floor", "ratio_on_support": 1, "region": {"box": [[0.4, -0.3], [0.6, -0.2]]}},
    },
}


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return a CompiledScene with three things, built once."""
    return compile_scene(SceneConfig.load(SCENE, {"bank": 8}), "cpu")


def lowest_points(envs: SceneVectorEnv) -> np.ndarray:
    """Return how high over the base the lowest vertex of each body is [m], by plain MuJoCo; shape (num_envs, 3)."""
    mjm, found = envs.compiled.mjm, np.zeros((envs.num_envs, len(NAMES)))
    data = mujoco.MjData(mjm)
    for i, qpos in enumerate(envs.batch.data.qpos.numpy()):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(mjm, data)
        for j, name in enumerate(NAMES):
            heights = []
            for g in np.flatnonzero((mjm.geom_bodyid == mjm.body(name).id) & (mjm.geom_contype > 0)):
                assert mjm.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH
                first, count = mjm.mesh_vertadr[mjm.geom_dataid[g]], mjm.mesh_vertnum[mjm.geom_dataid[g]]
                vertices = mjm.mesh_vert[first : first + count]
                heights.append(data.geom_xpos[g][2] + (vertices @ data.geom_xmat[g].reshape(3, 3).T)[:, 2].min())
            found[i, j] = min(heights) - data.body("panda").xpos[2]
    return found


def test_the_lowest_corner_is_not_above_the_lowest_point(compiled):
    """Turned at random it is at most 4 cm below it, with a block at most 4 mm; standing it is the origin."""
    envs = SceneVectorEnv(Drive, 64, scene=compiled)
    envs.reset(seed=0)
    s, bounds = envs.state, Bounds(envs.state, NAMES)
    torch.testing.assert_close(bounds.lowest(s.poses(NAMES)), s.poses(NAMES)[:, :, 2], rtol=0, atol=1e-6)
    qpos, rng = envs.batch.data.qpos.numpy(), np.random.default_rng(0)
    for name in NAMES:
        address = compiled.mjm.joint(f"{name}/free").qposadr[0]
        quat = rng.normal(size=(64, 4))
        qpos[:, address : address + 3] = rng.uniform(-0.5, 0.5, (64, 3))
        qpos[:, address + 3 : address + 7] = quat / np.linalg.norm(quat, axis=1, keepdims=True)
    envs.batch.data.qpos.assign(qpos)
    envs.batch.update()
    below = lowest_points(envs) - bounds.lowest(s.poses(NAMES)).numpy()
    assert below.min() > -1e-6
    assert (below.max(axis=0) < [0.02, 0.04, 0.004]).all()


def test_bodies_without_bounds_are_refused(compiled):
    """A name that the scene does not have, and a body of which nothing collides."""
    envs = SceneVectorEnv(Drive, 1, scene=compiled)
    with pytest.raises(UnknownNameError, match=r"Bounds: unknown body 'cat'.*can"):
        Bounds(envs.state, ("cat",))
    with pytest.raises(NotSupportedError, match="body 'goal' has no geom that collides"):
        Bounds(envs.state, ("can", "goal"))


def test_a_single_string_is_one_name(compiled):
    """Not a name for each of its letters."""
    s = SceneVectorEnv(Drive, 2, scene=compiled).state
    assert torch.equal(Bounds(s, "can").lowest(s.poses(["can"])), Bounds(s, ["can"]).lowest(s.poses(["can"])))
    assert ContactSensor(s, "banana", "block")(s).shape == (2, 1, 1)
    with pytest.raises(ArgumentTypeError, match="Bounds: names should be one name or several names"):
        Bounds(s, 3)  # pyrefly: ignore[bad-argument-type]


def test_contacts_of_the_last_step_are_told_by_world_and_body():
    """Both things stand on the floor; in one world the block was put against the can."""
    envs = SceneVectorEnv(
        Drive, 3, scene=compile_scene(SceneConfig.load(TOUCH_SCENE, {"bank": 8}), "cpu"), autoreset_mode="Disabled"
    )
    task: Any = envs.task
    task.move = lambda s, action: None
    envs.reset(seed=0)
    touch = ContactSensor(envs.state, ("block", "can", "panda/left_finger"), ("world", "can"))
    assert not touch(envs.state).any(), "nothing has been stepped yet"
    for _ in range(5):
        envs.step(torch.zeros(3, 8))
    standing = torch.tensor([[True, False], [True, False], [False, False]])
    assert torch.equal(touch(envs.state), standing.expand(3, 3, 2))
    block, can = (envs.compiled.mjm.joint(f"{name}/free").qposadr[0] for name in ("block", "can"))
    qpos = envs.batch.data.qpos.numpy()
    qpos[1, block : block + 3] = qpos[1, can : can + 3] + [0.05, 0.0, 0.0]
    envs.batch.data.qpos.assign(qpos)
    envs.step(torch.zeros(3, 8))
    found = touch(envs.state)
    assert found[:, 0, 1].tolist() == [False, True, False]
    reverse = ContactSensor(envs.state, ("can",), ("block",))(envs.state)
    assert reverse.flatten().tolist() == [False, True, False]
    envs.reset(options={"reset_mask": torch.tensor([False, True, False])})
    assert not touch(envs.state)[1].any()
    assert touch(envs.state)[[0, 2], 0, 0].all()
    with pytest.raises(UnknownNameError, match=r"unknown body 'cat'.*can"):
        ContactSensor(envs.state, ("cat",), ("can",))
