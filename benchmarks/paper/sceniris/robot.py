"""The robot of an imported scene, which the caller names, and `robot_position`, where the configuration has it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.paper.sceniris.keys import KeyReader, numbers
from benchmarks.paper.sceniris.placement import GROUND
from sceniris_gym.config.bounds import MOST_FAR
from sceniris_gym.config.fields import FLOOR, reading, short
from sceniris_gym.config.robot import RobotConfig

_KEY = "robot_position"
_NEAR = 1e-9  # m: equal but for rounding
_NO_FLOOR = (0.0, 0.0)
_HALF_EDGE = 1e-4  # m, of bounds that have no width along an axis


def robot_words(
    robot: str | Mapping[str, Any] | None, env: KeyReader
) -> tuple[dict[str, Any] | None, tuple[float, float]]:
    """Return the words for the robot, which stands at `robot_position` unless told otherwise; None without a robot.

    The original documents a single position as that of the robot, and several as bounds of it; its check of reach uses
    the world's origin all the same. The base is drawn within bounds on the floor; of bounds in space it takes the
    middle, since a drawn base stands on the lowest point of its robot. With `in_scene: false` no robot stands there,
    but reach is judged from there. A `base` that the caller gives, or one that is drawn, takes precedence, with a
    warning where it contradicts the positions.

    Args:
        robot: The robot as the caller gives it: an asset, or a mapping as in a scene file.
        env: The configuration's `env`; the key is taken from it.

    Returns:
        The words, and the smallest size of a floor [m] that contains bounds on it.

    Raises:
        SceneKeyError: The robot or the positions are wrong.
    """
    positions = _positions(env)
    if robot is None:
        if positions is not None:
            env.leave_out(_KEY)
            env.notes.advise(
                f"'{_KEY}' is carried over if read_sceniris gets a 'robot', which then stands there; "
                "robot={'asset': 'panda', 'in_scene': False} only judges what it could reach from there."
            )
        return None, _NO_FLOOR
    words: Any = {"asset": robot} if isinstance(robot, str) else robot
    with reading("read_sceniris: robot"):
        config = RobotConfig.model_validate(words)
    words = dict(words)
    if positions is None:
        return words, _NO_FLOOR
    low, high = positions.min(axis=0), positions.max(axis=0)
    if config.in_model is not None:
        env.leave_out(_KEY)
        env.notes.advise("A robot that is in the model stands as the model has it.")
        return words, _NO_FLOOR
    env.ignore(_KEY)
    if "base" in config.model_fields_set:
        if ((config.base < low - _NEAR) | (config.base > high + _NEAR)).any():
            env.change(_KEY, f"the robot stands at the 'base' that it was given, {list(config.base)}")
        return words, _NO_FLOOR
    if config.placing is not None:
        env.change(_KEY, "the base of the robot is drawn, as it was said to be")
        return words, _NO_FLOOR
    middle = 0.5 * (low + high)
    if (low != high).any():
        if not positions[:, 2].any() and config.roll == config.pitch == 0.0:
            return _drawn(words, config.yaw, low[:2], high[:2], env)
        env.change(_KEY, f"the robot stands at {middle.tolist()}, the middle of its bounds; reach is from there alone")
    env.made("robot.base", _KEY)
    return words | {"base": middle.tolist()}, _NO_FLOOR


def _drawn(
    words: dict[str, Any], yaw: float, low: np.ndarray, high: np.ndarray, env: KeyReader
) -> tuple[dict[str, Any], tuple[float, float]]:
    """Return the words for a base that is drawn on the floor within bounds [m], and the floor that this needs."""
    size = 2.0 * np.maximum(np.abs(low), np.abs(high))
    if (size > 2.0 * MOST_FAR).any():
        raise env.wrong(_KEY, f"should be within {MOST_FAR:g} m of the world's origin")
    flat = np.where(low == high, _HALF_EDGE, 0.0)
    box = [(low - flat).tolist(), (high + flat).tolist()]
    env.made("robot.region", _KEY)
    kept = {word: value for word, value in words.items() if word not in ("yaw", "roll", "pitch")}
    drawn = {"on": FLOOR, "region": {"box": box}, "orientation": {"yaw": [yaw, yaw]}}
    x, y = size + 2.0 * flat
    return kept | drawn, (float(x), float(y))


def _positions(env: KeyReader) -> np.ndarray | None:
    """Return the positions [m], shape (n, 3), without taking the key; None if there are none.

    Raises:
        SceneKeyError: They are no positions.
    """
    value = env.value(_KEY)
    if value is None:
        return None
    found = np.atleast_2d(numbers(value))
    if found.shape[1:] != (3,) or not len(found):
        raise env.wrong(_KEY, f"{short(value)} should be a position [x, y, z], or a list of them")
    found[np.abs(found[:, 2]) <= GROUND, 2] = 0.0
    return found
