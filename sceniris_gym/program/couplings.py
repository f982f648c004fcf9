"""Joints that follow drawn ones: which, through which positions, and the draws that none can follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.scene.couplings import Coupling, driven_by
from sceniris_gym.scene.model import SceneModel

# By how much [m or rad] a joint may leave its limits: rounding.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Follower:
    """A joint that follows a drawn one: its coupling, and the positions that it may take [m or rad]."""

    coupling: Coupling
    low: float
    high: float


def coupling_arrays(couplings: Sequence[Coupling]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return couplings as the device has them: addresses of drivers and of followers in qpos, shapes (n,), and numbers.

    The numbers are origin, offset and a1 to a4, shape (n, 6).
    """
    return (
        np.array([c.driver_adr for c in couplings], int),
        np.array([c.adr for c in couplings], int),
        np.reshape([(c.origin, c.offset, *c.coef) for c in couplings], (-1, 6)).astype(float),
    )


def followers_of(
    scene: SceneModel, name: str, drawn: Mapping[int, Sequence[tuple[float, float]]]
) -> tuple[Follower, ...]:
    """Return the joints that follow drawn ones of an object, or of the robot, drivers before what follows them.

    Args:
        scene: The scene.
        name: The object, or the robot.
        drawn: The intervals that each drawn joint is in, by its address in qpos.

    Raises:
        NotSupportedError: A joint of something else that would follow.
        SceneKeyError: A joint that would leave its limits.
    """
    mjm = scene.mjm
    where = f"{scene.config.where}: {scene.config.key(name)}.joints"
    inside, own = {adr: list(parts) for adr, parts in drawn.items()}, set(scene.joints(name).values())
    found = []
    for c in driven_by(scene.couplings, scene.joint_configs(name)):
        follower, driver = (mjm.joint(j).name for j in (c.follower, c.driver))
        if c.follower not in own:
            raise NotSupportedError(
                f"{where}: joint '{driver}' is drawn, and {c.label} makes joint '{follower}' follow it, which is not "
                f"part of '{name}'. Make both part of one asset, leave '{driver}' out, or take the equality out."
            )
        inside[c.adr] = [c.over(*part) for part in inside[c.driver_adr]]
        low, high = float(np.min(inside[c.adr])), float(np.max(inside[c.adr]))
        if low < c.limits[0] - _ROUNDING or high > c.limits[1] + _ROUNDING:
            raise SceneKeyError(
                f"{where}: {c.label} makes joint '{follower}' follow '{driver}' to positions from {low:.4g} to "
                f"{high:.4g}, which should be inside its limits [{c.limits[0]:g}, {c.limits[1]:g}]. Draw '{driver}' "
                "from a smaller range."
            )
        found.append(Follower(c, low, high))
    return tuple(found)
