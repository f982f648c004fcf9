"""Checks of joints that a scene file draws, against the model."""

from __future__ import annotations

from typing import NoReturn

import mujoco
import numpy as np

from sceniris_gym.config.objects import JointConfig
from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.scene.couplings import Coupling


def refuse_follower(mjm: mujoco.MjModel, coupling: Coupling, where: str) -> NoReturn:
    """Refuse to draw a joint that follows another one.

    Raises:
        SceneKeyError: Always; it names the equality.
    """
    name = mjm.joint(coupling.follower).name
    if coupling.driver is None:
        raise SceneKeyError(
            f"{where}: {coupling.label} holds '{name}' at {coupling.offset:g}, so it cannot be drawn. Leave it "
            "out, or take the equality out."
        )
    raise SceneKeyError(
        f"{where}: {coupling.label} makes '{name}' follow '{mjm.joint(coupling.driver).name}', so it cannot "
        "be drawn itself. Draw that joint instead, or take the equality out."
    )


def check_joint(mjm: mujoco.MjModel, home_qpos: np.ndarray, joint: int, config: JointConfig, where: str) -> None:
    """Check that a joint can be drawn as a scene file says.

    Raises:
        NotSupportedError: A ball joint.
        SceneKeyError: A fraction of a joint without limits, or values or a start pose with noise outside its limits.
    """
    name = mjm.joint(joint).name
    if mjm.jnt_type[joint] == mujoco.mjtJoint.mjJNT_BALL:
        raise NotSupportedError(f"{where}: '{name}' is a ball joint, which is not supported yet. Leave it out.")
    if not mjm.jnt_limited[joint]:
        if config.fraction is not None:
            raise SceneKeyError(f"{where}.fraction: '{name}' has no limits. Give a 'range' in m or rad.")
        return
    low, high = mjm.jnt_range[joint]
    start = home_qpos[mjm.jnt_qposadr[joint]]
    if config.noise is not None and not low - 1e-6 <= start <= high + 1e-6:
        raise SceneKeyError(
            f"{where}.noise: '{name}' starts at {start:g}, which should be inside its limits [{low:g}, {high:g}]. "
            "Correct the start pose, or give a 'range'."
        )
    for word in ("range", "choice", "value"):
        values = getattr(config, word)
        if values is not None and (np.less(values, low - 1e-6) | np.greater(values, high + 1e-6)).any():
            raise SceneKeyError(
                f"{where}.{word}: {values} should be inside the limits of '{name}', [{low:g}, {high:g}]."
            )
