"""Checks of groups and conditions, and of references to objects that may be absent."""

from collections.abc import Sequence
from itertools import combinations

from sceniris_gym.config.groups import GroupConfig
from sceniris_gym.config.member_names import object_of
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.scene_words import SceneWords
from sceniris_gym.errors import SceneKeyError, UnknownNameError, check_order

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
    needs, what = scene.presence.dependence(), "objects are present depending on each other"
    check_order(needs, where, what, lambda key: key.removeprefix("if ").removeprefix("groups."))
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
            f"{where}: its conditions exclude each other: '{never.removeprefix('groups.')}' would be both present and "
            "absent in each layout with it. Change its 'if', its 'unless', or its groups."
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
    for path, other in part.references:
        if other in scene.owners:
            raise SceneKeyError(
                f"{where}.{path}: '{other}' is a single variant. Name its object '{scene.owners[other]}'."
            )
        check_present(scene, other, f"{where}.{path}", by=name)


def check_present(scene: SceneWords, name: str, where: str, by: str = "") -> None:
    """Check that an object or a robot is in every layout, or at least in every layout with the object `by`.

    An object whose group has `missing: drop` may be absent, unless it has variants and `by` refers to it.

    Raises:
        SceneKeyError: The object may be absent. The error begins with `where`.
    """
    presence = scene.presence
    group = scene.groups.get(presence.outer.get(presence.key(name), "").removeprefix("groups."))
    is_kept = by != "" and name in scene.variants  # a relation to such an object applies in all layouts
    if name in scene.all_robots or (group is not None and group.missing == "drop" and not is_kept):
        return
    if not all(presence.implies(member, name) for member in scene.variants.get(by, (by,))):
        cures = ["Name another object"]
        if by:
            cures.append(f"write 'if: {name}' to place '{object_of(by)}' only together with '{name}'")
        if group is not None and not is_kept:
            cures.append("write 'missing: drop' in its group to ignore it in layouts without it")
        why = "; with variants or several supports, 'missing: drop' has no effect here" if group and is_kept else ""
        raise SceneKeyError(f"{where}: '{name}' may be absent{why}. {', or '.join(cures)}.")
