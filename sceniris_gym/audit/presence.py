"""Checks that the right objects are present: counts of groups, conditions, and parked poses of absent objects."""

import numpy as np

from sceniris_gym.audit.relations import Excess
from sceniris_gym.audit.scene import Seen
from sceniris_gym.config.groups import SPLITS, GroupConfig
from sceniris_gym.config.member_names import split_support
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.scene import SceneConfig

FAR = 38.0  # m, parked objects have x and y above this value, present objects do not


def excess_of_presence(config: SceneConfig, seen: Seen) -> Excess:
    """Count the violations of groups and conditions.

    Returns:
        (name, requirement, "objects") -> violation in each row, shape (nrow,). For a group, the requirement is "count",
        and the violation is the number of surplus or missing members. For an object with conditions, the requirement is
        "if", and the violation is 1 if its presence contradicts them. For a member of a group, the requirement is
        "present", and the violation is 1 if the pose contradicts the table: a present member is parked, or an absent
        member is not.
    """
    judged = _Presence(config, seen)
    found = {(name, "count", "objects"): judged.miscount(name, group) for name, group in config.groups.items()}
    for name, part in config.objects.items():
        if (may := judged.may_be(part)) is not None:
            wrong = seen.present[name] & ~may if name in judged.outer else seen.present[name] != may
            found[name, "if", "objects"] = wrong.astype(float)
        if may is not None or name in judged.outer:
            away = seen.outlines[name].pivot[:, :2].min(1) > FAR
            found[name, "present", "objects"] = (away == seen.present[name]).astype(float)
    return found


class _Presence:
    """The members that may be present in each row, given the members that are."""

    def __init__(self, config: SceneConfig, seen: Seen) -> None:
        self.config, self.seen = config, seen
        self.outer = {name: group for group in config.groups.values() for name in group.of}
        self._every = np.ones(len(next(iter(seen.present.values()))), bool)

    def there(self, name: str) -> np.ndarray:
        """Return whether an object, or a member of a group, is present in each row."""
        if name in self.config.objects:
            return self.seen.present[name]
        return np.any([self.there(member) for member in self.config.groups[name].of], axis=0)

    def may_be(self, part: ObjectConfig | GroupConfig) -> np.ndarray | None:
        """Return whether the conditions of an object or a group hold in each row, None without a condition."""
        found = [self.there(name) for name in part.if_] + [~self.there(name) for name in part.unless]
        if isinstance(part, ObjectConfig) and part.support is not None:
            below, _ = split_support(part.support.parent, self.config.objects)
            found += [self.seen.present[below]] if below in self.config.absent else []
        return np.all(found, axis=0) if found else None

    def miscount(self, name: str, group: GroupConfig) -> np.ndarray:
        """Return how many members of a group are missing or too many in each row, shape (nrow,).

        A group in another group may be left out as a whole. A member that is itself a group may be empty.
        """
        count = np.sum([self.there(member) for member in group.of], axis=0)
        weights = np.array([group.weights_in(split) for split in SPLITS])
        some, every = np.max(weights, axis=0), np.min(weights, axis=0)
        most, least = self._able(group, some), self._able(group, every)
        if name in self.outer:
            least = np.where(count == 0, 0, least)
        if any(member not in self.config.objects for member in group.of):
            least = np.zeros_like(least)
        missing, surplus = np.minimum(group.count[0], least) - count, count - np.minimum(group.count[1], most)
        return np.maximum(np.maximum(missing, surplus), 0).astype(float)

    def _able(self, group: GroupConfig, weights: np.ndarray) -> np.ndarray:
        """Return the number of members that may be present in each row, of those with a weight above 0."""
        whole = self._may_be_there(group)
        members = [self.config.objects.get(name) or self.config.groups[name] for name in group.of]
        able = [self._may_be_there(part) for part, weight in zip(members, weights, strict=True) if weight > 0.0]
        return np.sum([whole & one for one in able], axis=0) if able else np.zeros(len(whole), int)

    def _may_be_there(self, part: ObjectConfig | GroupConfig) -> np.ndarray:
        may = self.may_be(part)
        return self._every if may is None else may
