"""Objects on one of several supports, or on an object with variants: each layout draws the support.

`apple: {asset: apple, on: [table, shelf]}` becomes the members `apple/@table` and `apple/@shelf` of a group `apple`, as
for variants. An object with variants gets a member for each variant on each support. A support that has members itself
stands for all of them, because at most one is present.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

from sceniris_gym.config.bounds import BOUNDS
from sceniris_gym.config.fields import listed, locating, object_name, refuse, short
from sceniris_gym.config.loader import SUPPORT_WORDS
from sceniris_gym.config.member_names import MemberName, object_of, variant_of

_ANY = "any"
"""The key that stands for all bodies of an object with a level surface."""
Bodies = Mapping[tuple[str, str], Sequence[str]]
"""The name and the word of an `{any: NAME}`, such as ('cabinet', 'on') -> the bodies that it stands for."""

_FORMS = "should be a support, a list of supports, or a mapping of supports to weights"
_CONDITIONS = ("if", "unless")
_MOST_MEMBERS = 1000
"""Maximum number of members of an object. Each member is a body of the model with all variants."""


class _Supports(NamedTuple):
    """The supports of an object, each with its weight. Without weights, areas decide, and all weights are 1."""

    word: str
    weights: dict[str, float]
    by_area: bool


def with_supports(scene: Any, bodies: Bodies) -> Any:
    """Expand objects with several supports in a scene mapping, after its variants, and return the new mapping.

    An `{any: NAME}` that is not in `bodies` stands for the root of the object.

    Raises:
        ValidationError: Supports are given in a wrong form.
    """
    objects = scene.get("objects")
    if not isinstance(objects, Mapping) or not isinstance(scene.get("groups") or {}, Mapping):
        return scene
    parted = {object_of(str(name)) for name in objects} - {str(name) for name in objects}
    supports = [value for part in objects.values() if (value := support_of(part)[1]) is not None]
    if all(isinstance(each, str) and (each in objects or object_of(each) not in parted) for each in supports):
        return scene
    return _Expansion(scene, objects, bodies).scene()


def support_of(part: Any) -> tuple[str, Any]:
    """Return the word and the value of an object's support, as written, or '' and None."""
    given = [word for word in (*SUPPORT_WORDS, "in_") if isinstance(part, Mapping) and part.get(word) is not None]
    return (given[0], listed(part[given[0]])) if given else ("", None)


def names_any(part: Any) -> bool:
    """Return whether an `{any: NAME}` is among the supports of an object's mapping."""
    return any(map(_is_any, _listed(support_of(part)[1])))


def any_supports(scene: Mapping[str, Any]) -> set[tuple[str, str]]:
    """Return for each `{any: NAME}` of a scene mapping the name and the word, such as ('cabinet', 'on')."""
    values = [support_of(part) for part in scene.get("objects", {}).values()]
    return {(each[_ANY], word) for word, value in values for each in _listed(value) if _is_any(each)}


def supports_in(value: Any) -> list[Any]:
    """Return the names in the value of a support: a name, `{any: NAME}`, a list, or a mapping to weights."""
    if isinstance(value, Mapping) and not _is_any(value):
        return [name for name, weight in value.items() if weight]
    return [each[_ANY] if _is_any(each) else each for each in _listed(value)]


def _is_any(value: Any) -> bool:
    return isinstance(value, Mapping) and value.keys() == {_ANY} and isinstance(value[_ANY], str)


def _listed(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else [value]


class _Expansion:
    """A scene while its objects are expanded, supports before the objects on them."""

    def __init__(self, scene: Mapping, objects: Mapping[str, Any], bodies: Bodies) -> None:
        self._scene, self._written, self._bodies = scene, objects, bodies
        self._groups: dict[str, Any] = dict(scene.get("groups") or {})
        self._parts: dict[str, list[str]] = {}
        for name in objects:
            self._parts.setdefault(object_of(str(name)), []).append(name)
        self._members: dict[str, dict[str, Any]] = {}
        self._open: list[str] = []

    def scene(self) -> dict[str, Any]:
        """Return the scene with all objects expanded, in the order of the file."""
        members = {member: part for name in self._parts for member, part in self._expanded(name).items()}
        return {**self._scene, "objects": members, "groups": self._groups}

    def _expanded(self, name: str) -> dict[str, Any]:
        """Return the members of an object, or the object itself, by name."""
        if name in self._open:
            refuse(
                ("objects", name),
                "should not be on or in an object that is placed on or in it",
                self._written.get(name),
            )
        if name not in self._members:
            self._open.append(name)
            own = {member: self._written[member] for member in self._parts.get(name, ())}
            found = {member: self._supports(member, part) for member, part in own.items()}
            self._members[name] = self._on_each(name, own, found) if any(found.values()) else own
            self._open.pop()
        return self._members[name]

    def _supports(self, name: str, part: Any) -> _Supports | None:
        """Return the supports of an object or a variant, None if it needs no members for them."""
        word, value = support_of(part)
        at = ("objects", name, word)
        weights, by_area = {}, False
        if names_any(part):
            value = list(chain(*(self._bodies_of(each, word) for each in _listed(value))))
        if isinstance(value, Mapping):
            weights = dict(value)
            if not all(isinstance(each, str) for each in weights):
                refuse(at, _FORMS, value)
            numbers = [w for w in weights.values() if isinstance(w, int | float) and not isinstance(w, bool)]
            if len(numbers) < len(weights) or not all(map(BOUNDS["weight"].holds, numbers)):
                refuse(at, "should have a weight of at least 0 for each support, or be {any: OBJECT}", value)
            if not any(weights.values()):
                refuse(at, "should have a weight above 0 for at least one support", value)
        elif isinstance(value, list | tuple):
            weights, by_area = dict.fromkeys(map(str, value), 1.0), True
            if not value or not all(isinstance(each, str) for each in value):
                refuse(at, _FORMS, value)
            if len(weights) < len(value):
                refuse(at, "should name each support once", value)
        elif isinstance(value, str):
            weights = {value: 1.0}
        each = {member: weight for support, weight in weights.items() for member in self._of_support(support) if weight}
        return None if list(each) == [value] or not each else _Supports(word, each, by_area)

    def _bodies_of(self, support: Any, word: str) -> Sequence[Any]:
        """Return the bodies that an `{any: NAME}` stands for, or another support itself."""
        return self._bodies.get((support[_ANY], word), [support[_ANY]]) if _is_any(support) else [support]

    def _of_support(self, support: str) -> list[str]:
        """Return the members of a support, or the support itself."""
        owner = object_of(support)
        members = [member for member in self._expanded(owner) if member != owner]
        if support == owner and members:
            return members
        return [m for m in members if m == support or f"{owner}/{variant_of(m)}" == support] or [support]

    def _on_each(self, name: str, own: dict[str, Any], found: dict[str, _Supports | None]) -> dict[str, Any]:
        """Make the members of an object on its supports, and their group."""
        for full in (full for full in own if not isinstance(full, MemberName)):
            with locating(("objects", str(full)), full):
                object_name(str(full))
        supports = next(iter(found.values()))
        if supports is None or any(some != supports for some in found.values()):
            refuse(("objects", name), "should have the same supports for all variants, if one has several", short(own))
        group: dict[str, Any] = self._groups.get(name, {})
        if name in own:
            if name in self._groups:
                refuse(("groups", name), "should have another name: an object on several supports has it", group)
            group = {"count": 1, **{word: value for word, value in own[name].items() if word in _CONDITIONS}}
            own = {name: {word: value for word, value in own[name].items() if word not in _CONDITIONS}}
        if len(own) * len(supports.weights) > _MOST_MEMBERS:
            advice = f"should have at most {_MOST_MEMBERS:,} supports, counting the variants of each support and object"
            refuse(("objects", name, supports.word), advice, list(supports.weights)[:3])
        members, weights, splits = {}, {}, {}
        for member, part in own.items():
            for support, weight in supports.weights.items():
                made = MemberName.on(member, support)
                members[made] = {**part, supports.word: support}
                if (product := weight * group.get("weights", {}).get(member, 1.0)) != 1.0:
                    weights[made] = product
                if member in group.get("splits", {}):
                    splits[made] = group["splits"][member]
        words = {"of": tuple(members), "weights": weights, "splits": splits, "by_area": supports.by_area}
        group = {word: value for word, value in group.items() if word not in words}
        self._groups[name] = group | {word: value for word, value in words.items() if value}
        return members
