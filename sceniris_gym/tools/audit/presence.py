"""Checks of groups: how many members are there, and that absent ones are far away."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sceniris_gym.config.fields import ROBOT
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.layout_table import LayoutTable
from sceniris_gym.tools.audit.outlines import Outline

FAR = 38.0  # m; along both axes, what takes part in a scene with groups is nearer to the origin than that


def presence(config: SceneConfig, rows: LayoutTable) -> dict[str, np.ndarray]:
    """Return object name (and "robot") -> rows in which it is there, shape (nrow,)."""
    names = [*config.objects, *([ROBOT] if config.robot is not None else [])]
    return {name: rows.present[:, i].astype(bool) for i, name in enumerate(names)}


def excess(
    config: SceneConfig, outlines: Mapping[str, Outline], present: Mapping[str, np.ndarray]
) -> dict[tuple[str, str, str], np.ndarray]:
    """Count what is wrong with groups.

    Returns:
        (group or object, word, "objects") -> in each row how many members are too many or too few, and for every member
        whether it is far away although it is there or the other way round. Shape (nrow,).
    """
    found = {}
    for name, group in config.groups.items():
        count = np.sum([present[member] for member in group.of], axis=0)
        low, high = group.count
        found[name, "count", "objects"] = np.maximum(np.maximum(low - count, count - high), 0).astype(float)
        for member in group.of:
            away = outlines[member].pivot[:, :2].min(1) > FAR
            found[member, "present", "objects"] = (away == present[member]).astype(float)
    return found
