"""Helpers of environments' tests: actions, and the state of the worlds, as it is and as plain MuJoCo has it."""

from __future__ import annotations

import gc
import re
from collections.abc import Callable

import mujoco
import numpy as np
import torch
import warp as wp

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


def memory_of_a_world(make: Callable[[int], SceneVectorEnv], few: int = 64) -> tuple[float, float]:
    """Return the bytes that each further world takes during a reset and a step: by the environment, and by Warp.

    Warp's figure is the peak of its allocator, with whatever mujoco_warp allocates in between.
    """
    told, taken, texts = [], [], []
    for num_envs in (1, few, 3 * few):  # the first one compiles kernels
        envs = None
        gc.collect()  # what earlier tests left would be given back in between
        with wp.ScopedMemoryTracker(print=False, report_func=texts.append) as tracker:
            tracker.clear()
            envs = make(num_envs)
            envs.reset(seed=0)
            envs.step(envs.action_space.sample())
            tracker.report()
        told.append(envs.batch.memory.needed)
        [(number, unit)] = re.findall(r"Peak usage:\s+cpu\s+([\d.]+) ([KMG])B", texts[-1])
        taken.append(float(number) * 1024.0 ** (1 + "KMG".index(unit)))
    return (told[2] - told[1]) / (2 * few), (taken[2] - taken[1]) / (2 * few)


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
