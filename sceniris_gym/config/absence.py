"""Checks of groups and conditions, and of references to objects that may be absent."""

import graphlib
from collections.abc import Sequence
from itertools import combinations

from sceniris_gym.config.groups import GroupConfig
from sceniris_gym.config.member_names import object_of
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.scene_words import SceneWords
from sceniris_gym.errors import SceneKeyError, UnknownNameError, in_a_cycle

# In a group with more members, the check of its `count` only leaves out members that are never present.
_MOST_COMPARED = 16


def check_presence(scene: SceneWords, where: str) -> None:
    """Check groups, conditions, and references to objects that may be absent. Errors begin with `where`.

    Raises:
        SceneKeyError: A member cannot be absent. Conditions are circular, contradict each other or name an object that
            cannot be absent. A reference needs an object that may be absent.
        UnknownNameError: A condition names an unknown object or group.
    """
    _check_areas(scene, where)
    _check_members_can_be_absent(scene, where)
    written = [(scene.key(name), name, part) for name, part in scene.objects.items()]
    written += [(f"groups.{label}", label, group) for label, group in scene.groups.items()]
    for key, name, part in written:
        for word, names in (("if", part.if_), ("unless", part.unless)):
            for other in names:
                _check_condition(scene, name, part, other, f"{where}: {key}.{word}")
    try:
        graphlib.TopologicalSorter(scene.presence.dependence()).prepare()
    except graphlib.CycleError as error:
        cycle = [key.removeprefix("if ").removeprefix("groups.") for key in error.args[1][:0:-1]]
        raise in_a_cycle(where, cycle, "objects are present depending on each other") from None
    for key, name, part in written:
        if part.if_ or part.unless or key.startswith("groups."):
            _check_possible(scene, scene.presence.key(name), part, f"{where}: {key}")
    for name, part in scene.parts.items():
        _check_references(scene, name, part, f"{where}: {scene.key(name)}")


def _check_areas(scene: SceneWords, where: str) -> None:
    """Check that only objects on several supports have `by_area`."""
    for label, group in scene.groups.items():
        if group.by_area and label not in scene.variants:
            raise SceneKeyError(f"{where}: groups.{label}.by_area: is no key of a scene file. Leave it out.")


def _check_members_can_be_absent(scene: SceneWords, where: str) -> None:
    """Check that resets place all members of groups and all objects with conditions."""
    group_of = {name: group for group, part in scene.groups.items() for name in part.of if name in scene.objects}
    for name, part in scene.objects.items():
        if part.is_placed or not (name in group_of or part.if_ or part.unless):
            continue
        path, cure = f"objects.{name}", "Give it a support or a 3D region, or leave out its 'if' and 'unless'."
        if (group := group_of.get(name)) in scene.variants:
            path, cure = f"objects.{group}", "Give all variants a support or a 3D region."
        elif group is not None:
            path, cure = f"groups.{group}.of", "Give it a support or a 3D region, or remove it from the group."
        raise SceneKeyError(f"{where}: {path}: '{name}' keeps its pose from the model and cannot be absent. {cure}")


def _check_condition(scene: SceneWords, name: str, part: ObjectConfig | GroupConfig, other: str, where: str) -> None:
    """Check a name in `if` or `unless`."""
    if other in scene.all_robots:
        raise SceneKeyError(f"{where}: '{other}' is a robot and never absent. Name an object or a group.")
    if not scene.presence.leaves(scene.presence.key(other)):
        raise UnknownNameError("object or group", other, where, [*scene.objects, *scene.groups])
    if other in (name, object_of(name)) or (isinstance(part, GroupConfig) and other in part.of):
        raise SceneKeyError(f"{where}: '{other}' should be another object or group, not '{name}' or a part of it.")
    if other in scene.objects and not scene.objects[other].is_placed:
        raise SceneKeyError(
            f"{where}: '{other}' keeps its pose from the model and is never absent. Name an object that resets place."
        )


def _check_possible(scene: SceneWords, key: str, part: ObjectConfig | GroupConfig, where: str) -> None:
    """Check that an object with conditions may be present, and that a group may have its greatest `count`."""
    presence = scene.presence
    if (never := presence.conflict(key)) is not None:
        raise SceneKeyError(
            f"{where}: its conditions exclude each other: it needs '{never.removeprefix('groups.')}', which is absent "
            "in every layout with it. Change its 'if', its 'unless', or its groups."
        )
    if isinstance(part, GroupConfig):
        members = [member for name in part.of if presence.conflict(member := presence.key(name)) is None]
        most = _most_together(scene, members) if part.count[1] > 1 else len(members)
        if most < part.count[1]:
            raise SceneKeyError(
                f"{where}.count: at most {most} of its members can be present together, because of their conditions. "
                f"Give a count of at most {most}."
            )


def _most_together(scene: SceneWords, members: Sequence[str]) -> int:
    """Return the greatest number of members whose conditions agree with each other."""
    if len(members) > _MOST_COMPARED:
        return len(members)
    apart = {pair for pair in combinations(members, 2) if scene.presence.conflict(*pair) is not None}

    def most(rest: Sequence[str]) -> int:
        if not rest:
            return 0
        first, *others = rest
        return max(1 + most([n for n in others if (first, n) not in apart]), most(others) if apart else 0)

    return most(members)


def _check_references(scene: SceneWords, name: str, part: ObjectConfig, where: str) -> None:
    """Check that an object refers to objects that are present whenever it is, or that its references may be dropped."""
    presence, absent = scene.presence, scene.absent
    if part.joined_to in scene.variants:
        raise SceneKeyError(
            f"{where}.relations: '{part.joined_to}' has variants with different sites. Join this "
            "object to an object without variants."
        )
    for path, other in part.references:
        if other in scene.owners:
            raise SceneKeyError(
                f"{where}.{path}: '{other}' is a single variant. Name its object '{scene.owners[other]}'."
            )
        if other in scene.all_robots or presence.implies(name, other):
            continue
        group = scene.groups.get(absent.get(other, "").removeprefix("groups."))
        if group is None or group.missing == "refuse":
            drop = "" if group is None else ", or write 'missing: drop' in its group to ignore it in worlds without it"
            raise SceneKeyError(
                f"{where}.{path}: '{other}' may be absent. Name another object, write 'if: {other}' to place '{name}' "
                f"only together with '{other}'{drop}."
            )
