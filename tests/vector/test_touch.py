"""Contacts between bodies, against the places where things were put."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import UnknownNameError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.vector.touch import Touch
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.vector.driving import Drive

SCENE = {
    "floor": {"size": [2.0, 2.0]},
    "robot": {"asset": "panda"},
    "objects": {
        "block": {"asset": "block", "on": "floor", "ratio_on_support": 1, "region": {"box": [[0.4, 0.2], [0.6, 0.3]]}},
        "can": {"asset": "can", "on": "floor", "ratio_on_support": 1, "region": {"box": [[0.4, -0.3], [0.6, -0.2]]}},
    },
}


def test_contacts_of_the_last_step_are_told_by_world_and_body():
    """Both things stand on the floor; in one world the block was put against the can."""
    envs = SceneVectorEnv(
        Drive, 3, scene=compile_scene(SceneConfig.load(SCENE, {"bank": 8}), "cpu"), autoreset_mode="Disabled"
    )
    task: Any = envs.task
    task.move = lambda s, action: None
    envs.reset(seed=0)
    touch = Touch(envs.state, ("block", "can", "panda/left_finger"), ("world", "can"))
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
    reverse = Touch(envs.state, ("can",), ("block",))(envs.state)
    assert reverse.flatten().tolist() == [False, True, False]
    envs.reset(options={"reset_mask": torch.tensor([False, True, False])})
    assert not touch(envs.state)[1].any()
    assert touch(envs.state)[[0, 2], 0, 0].all()
    with pytest.raises(UnknownNameError, match=r"unknown body 'cat'.*can"):
        Touch(envs.state, ("cat",), ("can",))
