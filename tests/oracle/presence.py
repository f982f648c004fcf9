"""The objects of a layout, enumerated with exact fractions from the words of a scene file as docs/language has them.

It reads `objects` and `groups` as plain mappings, and knows nothing of the package: a tree of all draws, with the
probability of each leaf. An *item* is (object, variant, support), with '' for an object without variants, or with one
support. A support is the name in the scene file, so it is the object, not its variant.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from fractions import Fraction
from itertools import permutations
from typing import Any

Item = tuple[str, str, str]
Decided = dict[str, Item | None]
"""Object -> what is there of it, None if it is absent."""

WORDS = ("on", "inside", "in")


def outcomes(
    scene: Mapping[str, Any], areas: Mapping[tuple[str, str], float] | None = None
) -> dict[frozenset, Fraction]:
    """Return the probability of each set of items.

    Args:
        scene: the scene file as a mapping.
        areas: (object, support) -> area, for objects that list several supports.
    """
    return _Tree(scene, areas or {}).outcomes()


class _Tree:
    def __init__(self, scene: Mapping[str, Any], areas: Mapping[tuple[str, str], float]) -> None:
        self.objects, self.groups, self.areas = scene["objects"], scene.get("groups", {}), areas
        self.outer = {member: name for name, group in self.groups.items() for member in group["of"]}

    def outcomes(self) -> dict[frozenset, Fraction]:
        """Walk the whole tree."""
        found: dict[frozenset, Fraction] = {}
        for chance, there in self.walk({}, {}):
            items = frozenset(item for item in there.values() if item is not None)
            found[items] = found.get(items, Fraction(0)) + chance
        return found

    def walk(self, there: Decided, taken: dict[str, bool]) -> Iterator[tuple[Fraction, Decided]]:
        """Yield all ways to decide the rest. `taken` says of each member of a drawn group whether it was drawn."""
        for name, group in self.groups.items():
            if name + "." not in taken and self.ready(name, there, taken):
                for chance, chosen in self.draw(name, group, there, taken):
                    rest = taken | {name + ".": True} | {m: m in chosen for m in group["of"]}
                    yield from ((chance * p, d) for p, d in self.walk(there, rest))
                return
        for name in self.objects:
            if name not in there and (name not in self.outer or name in taken) and self.known(name, there, taken):
                for chance, item in self.choose(name, there):
                    item = item if self.may(name, there) and taken.get(name, True) else None
                    yield from ((chance * p, d) for p, d in self.walk(there | {name: item}, taken))
                return
        assert len(there) == len(self.objects), "circular"
        yield Fraction(1), there

    def ready(self, name: str, there: Decided, taken: dict[str, bool]) -> bool:
        """Return whether all that decides on a group's members is decided."""
        inside = name not in self.outer or name in taken
        before = [m for m in self.groups[name]["of"] if not self.is_later(m)]
        return inside and all(self.known(m, there, taken) for m in (name, *before))

    def is_later(self, name: str) -> bool:
        """Return whether a group in a group has a condition on another member of that group, decided after its draw."""
        if name not in self.groups or name not in self.outer:
            return False
        named = {leaf for word in ("if", "unless") for each in self.names(name, word) for leaf in self.leaves(each)}
        return not named.isdisjoint(self.leaves(self.outer[name]))

    def known(self, name: str, there: Decided, taken: dict[str, bool]) -> bool:
        """Return whether all is decided that the conditions of an object or a group name."""
        named = [leaf for word in ("if", "unless") for each in self.names(name, word) for leaf in self.leaves(each)]
        return all(leaf in there for leaf in (*named, *self.supports(name)) if leaf in self.objects)

    def names(self, name: str, word: str) -> list[str]:
        """Return the names in an `if` or an `unless`."""
        value = (self.objects.get(name) or self.groups.get(name))[word] if word in self.part(name) else []
        return [value] if isinstance(value, str) else list(value)

    def part(self, name: str) -> Mapping[str, Any]:
        """Return the words of an object or a group."""
        return self.objects[name] if name in self.objects else self.groups[name]

    def leaves(self, name: str) -> list[str]:
        """Return the objects of a group; of a single variant, its object."""
        if name in self.objects or name not in self.groups:
            return [name.partition("/")[0]]
        return [leaf for member in self.groups[name]["of"] for leaf in self.leaves(member)]

    def supports(self, name: str) -> dict[str, Fraction]:
        """Return the supports of an object, by the object's name in the scene, with their weights."""
        part = self.part(name)
        value = next((part[word] for word in WORDS if word in part), None) if name in self.objects else None
        if isinstance(value, Mapping):
            return {support.partition("/")[0]: Fraction(weight) for support, weight in value.items()}
        if isinstance(value, list):
            return {support: Fraction(self.areas[name, support]) for support in value}
        return {} if value is None else {value.partition("/")[0]: Fraction(1)}

    def holds(self, name: str, there: Decided) -> bool:
        """Return whether an object, a variant, or a member of a group is present."""
        owner, _, variant = name.partition("/")
        if variant:
            item = there[owner]
            return item is not None and item[1] == variant
        return any(there[leaf] is not None for leaf in self.leaves(name))

    def may(self, name: str, there: Decided) -> bool:
        """Return whether an object or a group can be there."""
        if not all(self.holds(each, there) for each in self.names(name, "if")):
            return False
        if any(self.holds(each, there) for each in self.names(name, "unless")):
            return False
        supports = self.supports(name)
        return not supports or bool(self.under(name, there))

    def under(self, name: str, there: Decided) -> dict[str, Fraction]:
        """Return the supports that are present, with weights above 0."""
        fixed = {support for support in self.supports(name) if support not in self.objects}
        return {
            support: weight
            for support, weight in self.supports(name).items()
            if weight and (support in fixed or there[support] is not None)
        }

    def choose(self, name: str, there: Decided) -> Iterator[tuple[Fraction, Item | None]]:
        """Yield the variants and supports of an object."""
        part = self.objects[name]
        assets = part["asset"] if isinstance(part.get("asset"), list) else []
        variants = part.get("variants") or {asset: {} for asset in assets} or {"": {}}
        weights = {variant: Fraction(words.get("weight", 1)) for variant, words in variants.items()}
        places, several = self.under(name, there) or {"": Fraction(1)}, len(self.supports(name)) > 1
        for variant, weight in weights.items():
            for support, share in places.items():
                chance = weight / sum(weights.values()) * share / sum(places.values())
                yield chance, (name, variant, support if several else "")

    def draw(
        self, name: str, group: Mapping[str, Any], there: Decided, taken: dict[str, bool]
    ) -> Iterator[tuple[Fraction, tuple[str, ...]]]:
        """Yield the members that a group draws: first their number, then members one after the other."""
        if not taken.get(name, True) or not self.may(name, there):
            yield Fraction(1), ()
            return
        weights = {m: Fraction(group.get("weights", {}).get(m, 1)) for m in group["of"]}
        able = [m for m in group["of"] if weights[m] and (self.is_later(m) or self.may(m, there))]
        low, high = group["count"] if isinstance(group["count"], list) else (group["count"],) * 2
        for count in range(low, high + 1):
            for chosen in permutations(able, min(count, len(able))):
                chance, left = Fraction(1, high - low + 1), sum(weights[m] for m in able)
                for member in chosen:
                    chance *= weights[member] / left
                    left -= weights[member]
                yield chance, chosen
