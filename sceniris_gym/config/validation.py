"""Checks of names in a scene: each reference exists, is suitable, and can be placed before the object that names it."""

from typing import Any

from sceniris_gym.config.absence import check_presence
from sceniris_gym.config.fields import FLOOR, in_memory
from sceniris_gym.config.groups import PLACING, HeapConfig
from sceniris_gym.config.member_names import SUPPORT, object_of, split_support, variant_of
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.relations import FRAMES
from sceniris_gym.config.scene_words import SceneWords
from sceniris_gym.config.several_supports import supports_in
from sceniris_gym.config.starts import check_starts
from sceniris_gym.errors import SceneKeyError, UnknownNameError, check_order


def check_names(scene: SceneWords, where: str) -> None:
    """Check all names of objects in a scene. Errors begin with `where`.

    Raises:
        SceneKeyError: An object has no asset or is placed on a marker, a reference is invalid in some worlds, a start
            needs something that its objects do not allow, or objects are placed relative to each other in a cycle.
        UnknownNameError: A name is not in the scene.
    """
    _check_members(scene, where)
    _check_splits(scene, where)
    _check_bodies(scene, where)
    for name, part in scene.objects.items():
        _check_body(scene, name, part, where)
        if part.reachable:
            _check_robot(scene, name, part, where)
    for name, part in scene.parts.items():
        key = scene.key(name)
        if part.support is not None:
            _check_parent(scene, f"{where}: {key}.{part.support.word}", name, part.support.parent)
        for path, other in part.references:
            _check_reference(scene, f"{where}: {key}.{path}", name, other)
    check_presence(scene, where)
    _check_heaps(scene, where)
    _check_stacks(scene, where)
    check_starts(scene, where)
    needs = {name: scene.needs(name) for name in scene.parts}
    check_order(needs, where, "objects are placed relative to each other")


def _check_robot(scene: SceneWords, name: str, part: ObjectConfig, where: str) -> None:
    """Check that the scene determines which robot has to reach an object."""
    if not scene.all_robots:
        raise SceneKeyError(
            f"{where}: objects.{name}.reachable: the scene has no robot to reach it. Add a robot, as "
            "in 'robot: {asset: panda}', or leave 'reachable' out."
        )
    if part.by not in scene.all_robots and "by" in part.model_fields_set:
        raise UnknownNameError("robot", part.by, f"{where}: objects.{name}.by", scene.all_robots)
    if part.by not in scene.all_robots and len(scene.all_robots) > 1:
        raise SceneKeyError(
            f"{where}: objects.{name}.reachable: should name the robot that has to reach it, as in 'reachable: {{by: "
            f"{next(iter(scene.all_robots))}}}'. Robots: {', '.join(scene.all_robots)}."
        )


def _check_bodies(scene: SceneWords, where: str) -> None:
    """Check that all objects have different bodies."""
    owners: dict[str, str] = {}
    for name, part in scene.objects.items():
        body = part.body or name
        if part.asset is None and (owner := owners.setdefault(body, name)) != name:
            raise SceneKeyError(
                f"{where}: objects.{name}: body '{body}' is already used by object '{owner}'. Each object should have "
                "a different body."
            )


def _check_body(scene: SceneWords, name: str, part: ObjectConfig, where: str) -> None:
    """Check that an object has an asset, is a body of the scene's model, or is a marker without a body."""
    if not in_memory(scene.model):  # mjlab's model has a body for each variant
        check_variant_has_asset(scene, name, where)
    if part.asset is not None or scene.model is not None:
        return
    if part.kind != "marker" or part.body is not None:
        raise SceneKeyError(
            f"{where}: objects.{name}.asset: is missing. Name an asset, or give the scene a 'model' with a "
            f"body '{part.body or name}'. Only a marker without a 'body' needs no asset."
        )


def check_variant_has_asset(scene: SceneWords, name: str, where: str) -> None:
    """Check that an object has an asset if it is a variant of another object.

    Raises:
        SceneKeyError: The variant has no asset.
    """
    if scene.objects[name].asset is None and (owner := scene.owners.get(name)) is not None:
        if not variant_of(name):
            raise SceneKeyError(
                f"{where}: objects.{owner}: has several supports but has no asset. Give it an 'asset', since each "
                "support needs a separate body, or name one support."
            )
        raise SceneKeyError(
            f"{where}: objects.{owner}.variants: '{variant_of(name)}' has no asset. Give this variant "
            f"an 'asset', or give 'objects.{owner}' an 'asset' for all variants."
        )


def _check_parent(scene: SceneWords, where: str, name: str, parent: str) -> None:
    owner = split_support(parent, scene.objects)[0]
    if owner in scene.variants:
        raise SceneKeyError(
            f"{where}: '{parent}' is not a member of '{owner}'. Name '{owner}', or one of its variants."
        )
    floor = [] if scene.floor is None else [FLOOR]
    if owner in scene.objects and scene.objects[owner].kind == "marker":
        raise SceneKeyError(f"{where}: '{parent}' is a marker and has no surface. Name a support of another kind.")
    lies = owner in scene.objects and scene.objects[owner].drawn_orientation.kind in ("any", "stable")
    if lies and SUPPORT in name and _number_of_supports(scene, name) > 1:
        raise SceneKeyError(
            f"{where}: '{owner}' may lie on its side, so it cannot be one of several supports. Write 'fixed' or a yaw "
            "as its orientation, or name another support."
        )
    # Another name may be a geom or a body of the model, which is not loaded yet.
    if owner not in scene.objects and parent not in floor and scene.model is None:
        if parent == FLOOR:
            where += ": the scene has no floor (add 'floor: {size: [x, y]}')"
        markers = {scene.owners.get(n, n) for n, part in scene.objects.items() if part.kind == "marker"}
        others = [n for n in scene.named_objects if n != object_of(name) and n not in markers]
        raise UnknownNameError("support", parent, where, [*floor, *others])


def _number_of_supports(scene: SceneWords, member: str) -> int:
    """Return the number of different objects that support the members of an object."""
    supports = [scene.objects[other].support for other in scene.variants[scene.owners[member]]]
    return len({object_of(support.parent) for support in supports if support is not None})


def _check_reference(scene: SceneWords, where: str, name: str, other: str) -> None:
    known = [*scene.objects, *scene.all_robots, *scene.variants]
    if other not in known:
        is_frame = where.endswith(".frame")
        valid = (*scene.named_objects, *scene.all_robots, *(FRAMES if is_frame else ()))
        raise UnknownNameError("frame" if is_frame else "object", other, where, [n for n in valid if n != name])
    if other in (name, object_of(name)):
        raise SceneKeyError(f"{where}: '{other}' should be a different object, not the placed object itself.")
    parts = [scene.objects[one] for one in scene.variants.get(other, (other,)) if one in scene.objects]
    if where.endswith(".with") and any(part.drawn_orientation.kind in ("any", "stable") for part in parts):
        raise SceneKeyError(
            f"{where}: '{other}' may lie on its side, where its heading has no meaning. Write 'fixed' or a yaw as its "
            "orientation, or name another object."
        )


def _check_members(scene: SceneWords, where: str) -> None:
    """Check the members of groups, heaps and stacks: they exist, and each is in one of these, not in itself."""
    inside = {label: [name for name in part.of if name not in scene.objects] for label, part in scene.groups.items()}
    check_order(inside, where, "groups contain each other")
    owners: dict[str, str] = {}
    for kind, parts in (("group", scene.groups), ("heap", scene.heaps), ("stack", scene.stacks)):
        for label, part in parts.items():
            path = f"{where}: {kind}s.{label}.of"
            if isinstance(part, HeapConfig):
                _check_container(scene, part, f"{where}: {kind}s.{label}.fill")
            for name in part.of:
                if name in scene.variants and kind == "heap":
                    raise SceneKeyError(f"{path}: '{name}' has variants, so it cannot be in a heap. Leave it out.")
                owner = scene.owners.get(name, name)
                if owner != name and owner != label:
                    raise SceneKeyError(f"{path}: '{name}' is a single variant. Name its object '{owner}'.")
                known = [*scene.named_objects, *(scene.groups if kind == "group" else ())]
                if name not in known and name not in scene.objects:
                    raise UnknownNameError("object", name, path, [n for n in known if n != label])
                is_lowest = kind == "stack" and name == part.of[0] and owners.get(name, "").startswith("group")
                if name in owners and not is_lowest:
                    raise SceneKeyError(
                        f"{path}: '{name}' is also in the {owners[name]}. Leave it out in one of the two places."
                    )
                owners[name] = f"{kind} '{label}'"


def _check_splits(scene: SceneWords, where: str) -> None:
    """Check that no asset is held out from the variants of one object, and in training a variant of another object."""
    owners: dict[tuple[str, Any, str], str] = {}
    for owner in scene.variants:
        for member, split in scene.groups[owner].splits.items():
            part = scene.objects[member]
            owners.setdefault((str(part.asset), part.scale, split), owner)
    for (asset, scale, split), owner in owners.items():
        if split == "eval" and (other := owners.get((asset, scale, "train"))) is not None:
            raise SceneKeyError(
                f"{where}: objects.{owner}: '{asset}' is held out here, and a variant of '{other}' in training. Give "
                "both objects the same variants and 'holdout', or each variant of both its 'split'."
            )


def _check_heaps(scene: SceneWords, where: str) -> None:
    """Check that objects of heaps are not placed elsewhere, and that containers stand upright."""
    things = {name for part in scene.heaps.values() for name in part.of}
    for heap, part in scene.heaps.items():
        for name in part.of:
            thing = scene.objects[name]
            given = thing.model_fields_set.intersection((*PLACING, "if_", "unless"))
            if thing.in_ != part.fill or thing.drawn_orientation.kind != "any" or given:
                raise SceneKeyError(
                    f"{where}: objects.{name}: the heap '{heap}' puts this object into '{part.fill}'. Leave out on, "
                    "inside, in, region, relations, ratio_on_support, orientation, joints, gap, if and unless."
                )
        owner = split_support(part.fill, scene.objects)[0]
        if owner in things:
            raise SceneKeyError(
                f"{where}: heaps.{heap}.fill: '{owner}' is itself an object of a heap. Name another container."
            )
        if owner in scene.objects and scene.objects[owner].drawn_orientation.kind in ("any", "stable"):
            raise SceneKeyError(
                f"{where}: objects.{owner}.orientation: should keep this object upright, because the heap '{heap}' "
                "fills it. Write 'fixed', or a yaw."
            )


def _check_container(scene: SceneWords, heap: HeapConfig, where: str) -> None:
    """Check that the container of a heap is in every layout."""
    owner = split_support(heap.fill, scene.objects)[0]
    if owner in scene.absent or owner in scene.variants:
        raise SceneKeyError(
            f"{where}: '{owner}' has variants or may be absent, but a heap needs its container in every layout. Name "
            "another container, or leave out the container's variants, conditions and groups."
        )


def _check_stacks(scene: SceneWords, where: str) -> None:
    """Check that the objects of stacks have no other support, and that only the lowest and the highest are optional."""
    presence = scene.presence
    for stack, part in scene.stacks.items():
        for name, below in zip(part.of, (part.on, *part.of), strict=False):
            names, members = supports_in(below), scene.variants.get(name, (name,))
            found = {scene.objects[member].on or "" for member in members}
            if {on if on in names else object_of(on) for on in found} != {*names}:
                raise SceneKeyError(
                    f"{where}: objects.{name}: should not name a support (on, inside, in), because the stack "
                    f"'{stack}' puts it on {' or '.join(map(repr, names))}."
                )
        for name in part.of[1:-1]:
            if presence.key(name) in presence.outer or presence.has_words(presence.key(name)):
                raise SceneKeyError(
                    f"{where}: stacks.{stack}.of: '{name}' may be absent, but the objects on it may not. Leave out its "
                    "'if' and 'unless', take it out of its group, or write 'on' for each object instead of a stack."
                )
