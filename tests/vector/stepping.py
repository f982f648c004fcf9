"""Helpers of environments' tests: actions, and the state of the worlds, as it is and as plain MuJoCo has it."""

from __future__ import annotations

import mujoco
import numpy as np
import torch

from sceniris_gym.vector.vector_env import SceneVectorEnv

STATE = ("time", "qpos", "qvel", "ctrl", "act", "mocap_pos", "mocap_quat", "xpos", "site_xpos", "qacc_warmstart")


def actions(num_envs: int, ending: tuple[int, ...] = ()) -> torch.Tensor:
    """Return small actions that end the episode of the worlds `ending`."""
    action = torch.linspace(-0.5, 0.5, num_envs * 5).reshape(num_envs, 5).clone()
    action[list(ending), 0] = 1.0
    return action


def state(envs: SceneVectorEnv) -> dict[str, np.ndarray]:
    """Copy the state of the worlds to the host."""
    return {name: getattr(envs.batch.data, name).numpy().copy() for name in STATE}


def assert_equal(left: dict, right: dict, worlds: list[int] | slice = slice(None)) -> None:
    """Check that two dicts of arrays agree to the bit in some worlds."""
    for name in left:
        np.testing.assert_array_equal(np.asarray(left[name])[worlds], np.asarray(right[name])[worlds], err_msg=name)


def leaves(value) -> list[torch.Tensor]:
    """List the tensors inside nested tuples and dicts."""
    if isinstance(value, torch.Tensor):
        return [value]
    items = value.values() if isinstance(value, dict) else value
    return [leaf for item in items for leaf in leaves(item)]


def oracle(envs, world: int) -> mujoco.MjData:
    """Return plain MuJoCo's data for the state of one world."""
    d, data = envs.batch.data, mujoco.MjData(envs.compiled.mjm)
    data.qpos[:], data.qvel[:] = d.qpos.numpy()[world], d.qvel.numpy()[world]
    data.mocap_pos[:], data.mocap_quat[:] = d.mocap_pos.numpy()[world], d.mocap_quat.numpy()[world]
    mujoco.mj_forward(envs.compiled.mjm, data)
    return data
