"""Steps of an own loop, and the arrays of Data that tests compare."""

import mujoco_warp as mjw
import numpy as np

from sceniris_gym.sim.randomizer import ResetRandomizer

STATE = ("time", "qpos", "qvel", "act", "ctrl", "mocap_pos", "mocap_quat", "qacc_warmstart", "xfrc_applied", "M")
DERIVED = ("xpos", "xquat", "geom_xpos", "geom_xmat", "site_xpos", "site_xmat")


def snapshot(d: mjw.Data, names: tuple[str, ...] = STATE + DERIVED) -> dict[str, np.ndarray]:
    """Copy arrays of `d` to the host."""
    return {name: getattr(d, name).numpy().copy() for name in names}


def step(randomizer: ResetRandomizer, n: int = 5) -> None:
    """Step all worlds and make kinematics current, as an environment does."""
    for _ in range(n):
        mjw.step(randomizer.model, randomizer.data)
    mjw.kinematics(randomizer.model, randomizer.data)
