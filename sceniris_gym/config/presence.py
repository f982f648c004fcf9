"""The present objects of a layout: groups and conditions as draws, and the order of their dependence.

A *draw* chooses among members, which are objects or other groups. A condition of an object or a group in no group makes
one more draw, with this single member. What is on an object that may be absent has the condition that the object is
present.
"""

from __future__ import annotations

import graphlib
from collections.abc import Collection, Iterable, Mapping
from functools import cached_property
from itertools import chain
from typing import NamedTuple

from sceniris_gym.config.groups import SPLITS, GroupConfig
from sceniris_gym.config.member_names import SUPPORT, object_of, split_support
from sceniris_gym.config.objects import ObjectConfig

_GROUP = "groups."
"""The beginning of the keys of groups. It keeps a group apart from an object of the same name."""


class Term(NamedTuple):
    """A condition: one of the objects `of` is present or, if `holds` is false, all are absent."""

    holds: bool
    of: tuple[str, ...]


class Member(NamedTuple):
    """A member of a draw: its key, its objects (several for a group), and the terms that all have to hold."""

    key: str
    objects: tuple[str, ...]
    terms: tuple[Term, ...]


class Draw(NamedTuple):
    """A group, and its members in the order of `GroupConfig.of`."""

    group: GroupConfig
    members: tuple[Member, ...]


class Presence:
    """The draws of a scene, and conclusions from its conditions that hold in every layout.

    Objects have their names as keys, and groups 'groups.NAME'.

    Args:
        objects: The objects of the scene.
        groups: Its groups.
    """

    def __init__(self, objects: Mapping[str, ObjectConfig], groups: Mapping[str, GroupConfig]) -> None:
        self._objects, self._groups = objects, groups
        self.groups = {_GROUP + name: group for name, group in groups.items()}
        self.outer = {self.key(name): key for key, group in self.groups.items() for name in group.of}

    def __reduce__(self) -> tuple[type[Presence], tuple]:
        """Pickle only the words. The rest is computed from them."""
        return Presence, (self._objects, self._groups)

    def key(self, name: str) -> str:
        """Return the key of an object or a group. An object goes before a group of the same name."""
        return name if name in self._objects or _GROUP + name not in self.groups else _GROUP + name

    def leaves(self, key: str) -> tuple[str, ...]:
        """Return the objects of a group, also inside its groups, or the object itself."""
        if key in self._objects:
            return (key,)
        if key not in self.groups:  # a variant with a member on each of several supports
            return tuple(name for name in self._objects if name.startswith(key + SUPPORT))
        return tuple(dict.fromkeys(chain(*(self.leaves(self.key(name)) for name in self.groups[key].of))))

    @cached_property
    def absent(self) -> dict[str, str]:
        """Object that may be absent -> the key of the group that may leave it out, or the object if it has a condition.

        An object with a carrier that may be absent has the condition that its carrier is present.
        """
        found = {name for name in self._objects if self._is_optional(name)}
        while more := {name for name in self._objects if self.carrier(name) in found} - found:
            found |= more
        return {name: self.outer.get(name, name) for name in self._objects if name in found}

    def _is_optional(self, key: str) -> bool:
        """Return whether a condition or a group may leave out an object or a group."""
        outer = self.outer.get(key)
        above = outer is not None and (not self.groups[outer].always_whole or self._is_optional(outer))
        return above or self.has_words(key)

    def carrier(self, name: str) -> str:
        """Return the supporting object of an object, '' for another support."""
        support = self._objects[name].support
        owner = "" if support is None else split_support(support.parent, self._objects)[0]
        return owner if owner in self._objects else ""

    @cached_property
    def draws(self) -> dict[str, Draw]:
        """The draws, by key: all groups in the order of the file, then one for each other condition."""
        found = {key: (group, [self.key(name) for name in group.of]) for key, group in self.groups.items()}
        for key in (*self._objects, *self.groups):
            if key not in self.outer and self.terms(key):
                found["if " + key] = GroupConfig(of=(key,), count=(1, 1)), [key]
        later = {key: self._later(key) for key in self.groups}
        return {
            key: Draw(group, tuple(Member(m, self.leaves(m), self._terms(m, key, later)) for m in of))
            for key, (group, of) in found.items()
        }

    def _later(self, key: str) -> tuple[Term, ...]:
        """Return the conditions of a group that name other members of the group around it.

        These are drawn after the group around it. So its own members have the conditions instead.
        """
        outer = self.outer.get(key)
        beside = set() if outer is None or self.is_object(key) else {*self.leaves(outer)}
        return tuple(term for term in self.terms(key) if not beside.isdisjoint(term.of))

    def _terms(self, member: str, draw: str, later: Mapping[str, tuple[Term, ...]]) -> tuple[Term, ...]:
        """Return the conditions of a member in a draw."""
        own = (term for term in self.terms(member) if term not in later.get(member, ()))
        return (*own, *later.get(draw, ()))

    @cached_property
    def member_keys(self) -> list[str]:
        """The keys of the members of all draws, in the order of `draws`."""
        return [member.key for draw in self.draws.values() for member in draw.members]

    @cached_property
    def order(self) -> list[int]:
        """The indices of the draws in the order of dependence.

        Raises:
            CycleError: Conditions depend on each other in a circle, or a group contains itself.
        """
        number = {key: i for i, key in enumerate(self.draws)}
        return [number[key] for key in graphlib.TopologicalSorter(self.dependence()).static_order()]

    @property
    def has_conditions(self) -> bool:
        """True if a draw depends on another one."""
        return any(self.dependence().values()) or any(m.terms for draw in self.draws.values() for m in draw.members)

    @property
    def parks(self) -> bool:
        """True if resets may park a body of the simulation, where all variants of an object share one body."""
        return any(key not in self.groups or not (self.is_object(key) and self.is_sure(key)) for key in self.draws)

    def dependence(self) -> dict[str, list[str]]:
        """Return each draw with the draws that come before it."""
        decides = {key: "if " + key for key in (*self._objects, *self.groups) if "if " + key in self.draws} | self.outer
        needed = {}
        for key, draw in self.draws.items():
            named = chain(*(term.of for member in draw.members for term in member.terms), [key])
            needed[key] = list(dict.fromkeys(decides[name] for name in named if name in decides))
        return needed

    def terms(self, key: str) -> tuple[Term, ...]:
        """Return the conditions of an object or a group, without the groups that contain it."""
        part = self.groups.get(key) or self._objects[key]
        found = [Term(True, self.leaves(self.key(name))) for name in part.if_]
        if part.unless:
            found.append(Term(False, tuple(chain(*(self.leaves(self.key(name)) for name in part.unless)))))
        if key not in self.groups and (below := self.carrier(key)) in self.absent:
            found.append(Term(True, (below,)))
        if key in self.groups and key in self.outer and self.is_object(key):
            below = [self.carrier(name) for name in self.groups[key].of]
            found += [Term(True, tuple(dict.fromkeys(below)))] if all(name in self.absent for name in below) else []
        return tuple(found)

    def is_object(self, key: str) -> bool:
        """Return whether a key stands for an object of the scene file, which may be a group of members."""
        return key not in self.groups or all(_GROUP + object_of(name) == key for name in self.groups[key].of)

    def implies(self, name: str, other: str) -> bool:
        """Return whether every layout with an object or a robot has another object or group, too."""
        return self.is_sure(other) or (name in self._objects and self.key(other) in self.must(name))

    def is_sure(self, name: str) -> bool:
        """Return whether an object or a group, given by its name or its key, is present in every layout."""
        if (key := self.key(name)) not in self.groups:
            return key not in self.absent
        return all(self.is_sure_with(key, self.groups[key].weights_in(split)) for split in SPLITS)

    def is_sure_with(self, key: str, weights: Iterable[float]) -> bool:
        """Return whether a group is present in every layout with these weights of its members."""
        group = self.groups[key]
        members = [self.key(name) for name, weight in zip(group.of, weights, strict=True) if weight > 0.0]
        if key in self.outer or self.has_words(key) or group.count[0] == 0:
            return False
        if any(m not in self.groups and not self.terms(m) for m in members):
            return True
        below = {self.carrier(m) for m in members if m not in self.groups and not self.has_words(m)}
        return any(
            self.is_sure(over) for name in below if (over := self.outer.get(name)) and below >= {*self.leaves(over)}
        )

    @cached_property
    def _sure(self) -> list[str]:
        """The keys of all groups that are present in every layout."""
        return [key for key in self.groups if self.is_sure(key)]

    def conflict(self, *keys: str) -> str | None:
        """Return an object or group that cannot be present if all `keys` are, None if their conditions agree."""
        must, never = self._follow(keys)
        sure = [*sorted(never - self.absent.keys()), *self._sure]
        return next((key for key in (*sorted(must), *sure) if never.issuperset(self.leaves(key))), None)

    @cached_property
    def excluded(self) -> dict[str, set[str]]:
        """Object that may be absent -> objects that are in no layout with it, as far as `_follow` tells."""
        found = {name: self._alone[name] for name in self.absent}
        return {
            name: {
                other
                for other, (also_must, also_never) in found.items()
                if not (never.isdisjoint(also_must) and must.isdisjoint(also_never))
            }
            for name, (must, never) in found.items()
        }

    def must(self, key: str) -> set[str]:
        """Return the keys of all objects and groups that are in every layout with an object or a group."""
        return self._alone[key][0]

    @cached_property
    def _alone(self) -> dict[str, tuple[set[str], set[str]]]:
        """Object or group -> the result of `_follow` for this key alone."""
        return {key: self._follow([key]) for key in (*self._objects, *self.groups)}

    def _follow(self, keys: Iterable[str], known: Collection[str] = ()) -> tuple[set[str], set[str]]:
        """Return the keys that are in every layout with all of `keys`, and the objects that are in none of them.

        What `known` keys need and exclude is left out. The other members of a group of one are excluded.
        """
        must, never, todo = set(known), set(), [*keys]
        while todo:
            if (key := todo.pop()) in must:
                continue
            must.add(key)
            part = self.groups.get(key) or self._objects.get(key)
            if part is None:  # a variant that is no object itself
                todo += [self.outer[name] for name in self.leaves(key)[:1]]
                continue
            todo += [self.key(name) for name in part.if_]
            excluded = [self.key(name) for name in part.unless]
            if isinstance(part, ObjectConfig):
                todo += [name for name in [self.carrier(key)] if name in self.absent]
            elif must.isdisjoint(members := [self.key(name) for name in part.of]):
                each = [self._follow([member], must) for member in members]
                must |= set.intersection(*(found for found, _ in each))
                never |= set.intersection(*(found for _, found in each))
            if (outer := self.outer.get(key)) is not None:
                todo.append(outer)
                if self.groups[outer].count[1] == 1:
                    excluded += [other for name in self.groups[outer].of if (other := self.key(name)) != key]
            never.update(*map(self.leaves, excluded))
        return must, never

    def has_words(self, key: str) -> bool:
        """Return whether an object or a group has an `if` or an `unless` itself."""
        part = self.groups.get(key) or self._objects[key]
        return bool(part.if_ or part.unless)
