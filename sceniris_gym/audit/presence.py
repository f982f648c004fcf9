"""Check of groups: the number of present members, and the parking of absent ones."""

from __future__ import annotations

import numpy as np

from sceniris_gym.audit.language import Excess
from sceniris_gym.audit.outlines import Seen
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.scene.layout_table import LayoutTable

FAR = 38.0  # m; parked objects are beyond it along both axes, present ones are nearer to the origin


def presence(config: SceneConfig, table: LayoutTable) -> dict[str, np.ndarray]:
    """Return name of an object or robot -> rows in which it, or one of its variants, is present, shape (nrow,)."""
    names = [*config.objects, *config.all_robots]
    found = {name: table.present[:, i].astype(bool) for i, name in enumerate(names)}
    return found | {name: np.any([found[m] for m in members], axis=0) for name, members in config.variants.items()}


def excess_of_groups(config: SceneConfig, seen: Seen) -> Excess:
    """Count the violations of groups.

    Returns:
        (group or object, word, "objects") -> in each row the number of members that a group has too many or too few,
        and for every member 1 if it is parked although present, or not parked although absent. Shape (nrow,).
    """
    found = {}
    for name, group in config.groups.items():
        count = np.sum([seen.present[member] for member in group.of], axis=0)
        low, high = group.count
        found[name, "count", "objects"] = np.maximum(np.maximum(low - count, count - high), 0).astype(float)
        for member in group.of:
            away = seen.outlines[member].pivot[:, :2].min(1) > FAR
            found[member, "present", "objects"] = (away == seen.present[member]).astype(float)
    return found
