"""Checks of names in a scene: each reference exists, is suitable, and can be placed before the object that names it."""

import graphlib
from collections.abc import Container, Iterable

from sceniris_gym.config.fields import FLOOR, in_memory
from sceniris_gym.config.groups import PLACING
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.config.relations import FRAMES
from sceniris_gym.config.robot import StartConfig
from sceniris_gym.config.scene_words import SceneWords
from sceniris_gym.config.variants import with_variants
from sceniris_gym.errors import SceneKeyError, UnknownNameError, in_a_cycle


def check_names(scene: SceneWords, where: str) -> None:
    """Check all names of objects in a scene. Errors begin with `where`.

    Raises:
        SceneKeyError: An object has no asset or is placed on a marker, a reference is invalid in some worlds, a start
            needs something that its objects do not allow, or objects are placed relative to each other in a cycle.
        UnknownNameError: A name is not in the scene.
    """
    _check_members(scene, where)
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
    _check_groups(scene, where)
    _check_heaps(scene, where)
    _check_stacks(scene, where)
    _check_cycles(scene, where)
    _check_starts(scene, where)


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
    """Check that the scene has a model if an object names a body, and that all objects have different bodies."""
    owners: dict[str, str] = {}
    for name, part in scene.objects.items():
        if part.body is not None and scene.model is None:
            raise SceneKeyError(
                f"{where}: objects.{name}.body: the scene has no model with a body '{part.body}'. Give the scene "
                "a 'model', or the object an 'asset'."
            )
        body = part.body or name
        if part.asset is None and (owner := owners.setdefault(body, name)) != name:
            raise SceneKeyError(
                f"{where}: objects.{name}: body '{body}' is already used by object '{owner}'. Each object should have "
                "a different body."
            )


def _check_body(scene: SceneWords, name: str, part: ObjectConfig, where: str) -> None:
    """Check that an object has an asset, is a body of the scene's model, or is a marker that needs no size."""
    if not in_memory(scene.model):  # mjlab's model has a body for each variant
        check_variant_has_asset(scene, name, where)
    if part.asset is not None or scene.model is not None:
        return
    if part.kind != "marker":
        raise SceneKeyError(
            f"{where}: objects.{name}.asset: is missing. Name an asset, or give the scene a 'model' with a "
            f"body '{name}'. Only a marker needs no asset."
        )
    if part.drawn_orientation.kind == "stable":
        raise SceneKeyError(
            f"{where}: objects.{name}.orientation: a marker without an asset is a point and has no stable pose. "
            "Give it an asset or another orientation."
        )
    for i, relation in enumerate(part.relations):
        if relation.has_own_width:
            raise SceneKeyError(
                f"{where}: objects.{name}.relations.{i}.width: is missing. Give a width in metres: the default is "
                "from the object's asset, and this marker has no asset."
            )


def check_variant_has_asset(scene: SceneWords, name: str, where: str) -> None:
    """Check that an object has an asset if it is a variant of another object.

    Raises:
        SceneKeyError: The variant has no asset.
    """
    if scene.objects[name].asset is None and (owner := scene.owners.get(name)) is not None:
        raise SceneKeyError(
            f"{where}: objects.{owner}.variants: '{name.partition('/')[2]}' has no asset. Give this variant "
            f"an 'asset', or give 'objects.{owner}' an 'asset' for all variants."
        )


def _check_parent(scene: SceneWords, where: str, name: str, parent: str) -> None:
    owner = parent.split("/")[0]
    if owner in scene.variants:
        raise SceneKeyError(f"{where}: '{owner}' has variants, so it cannot support objects. Name another support.")
    floor = [] if scene.floor is None else [FLOOR]
    if owner in scene.objects and scene.objects[owner].kind == "marker":
        raise SceneKeyError(f"{where}: '{parent}' is a marker and has no surface. Name a support of another kind.")
    # Another name may be a geom or a body of the model, which is not loaded yet.
    if owner not in scene.objects and parent not in floor and scene.model is None:
        if parent == FLOOR:
            where += ": the scene has no floor (add 'floor: {size: [x, y]}')"
        others = [n for n in _alone(scene) if n != name and scene.objects[n].kind != "marker"]
        raise UnknownNameError("support", parent, where, [*floor, *others])


def _alone(scene: SceneWords) -> list[str]:
    """Return the objects that are not variants of others."""
    return [name for name in scene.objects if name not in scene.owners]


def _check_reference(scene: SceneWords, where: str, name: str, other: str) -> None:
    known = [*scene.objects, *scene.all_robots, *scene.variants]
    if other not in known:
        is_frame = where.endswith(".frame")
        valid = (*_alone(scene), *scene.all_robots, *scene.variants, *(FRAMES if is_frame else ()))
        raise UnknownNameError("frame" if is_frame else "object", other, where, [n for n in valid if n != name])
    if other in (name, name.partition("/")[0]):
        raise SceneKeyError(f"{where}: '{other}' should be a different object, not the placed object itself.")


def _check_members(scene: SceneWords, where: str) -> None:
    """Check that the members of groups, heaps and stacks are objects, and that no object is in two of them."""
    owners: dict[str, str] = {}
    for kind, parts in (("group", scene.groups), ("heap", scene.heaps), ("stack", scene.stacks)):
        for label, part in parts.items():
            path = f"{where}: {kind}s.{label}.of"
            for name in part.of:
                owner = scene.owners.get(name, name)
                if owner in scene.variants and label != owner:
                    raise SceneKeyError(f"{path}: '{owner}' has variants, so it cannot be in a {kind}. Leave it out.")
                if name not in scene.objects:
                    raise UnknownNameError("object", name, path, _alone(scene))
                if name in owners:
                    raise SceneKeyError(
                        f"{path}: '{name}' is also in the {owners[name]}. Leave it out in one of the two places."
                    )
                owners[name] = f"{kind} '{label}'"


def _check_groups(scene: SceneWords, where: str) -> None:
    """Check that members can be absent, and that the other objects can be placed without them."""
    group_of = {name: group for group, part in scene.groups.items() for name in part.of}
    for name, group in group_of.items():
        if not scene.objects[name].is_placed:
            path, cure = f"groups.{group}.of", "Give it a support or a 3D region, or remove it from the group."
            if group in scene.variants:
                path, cure = f"objects.{group}", "Give all variants a support or a 3D region."
            raise SceneKeyError(f"{where}: {path}: '{name}' keeps its pose from the model and cannot be absent. {cure}")
    for name, part in scene.parts.items():
        _check_absent(scene, scene.key(name), part, where)


def _check_absent(scene: SceneWords, key: str, part: ObjectConfig, where: str) -> None:
    """Check that an object can be placed in worlds without some members of groups."""
    support, absent = part.support, scene.absent
    owner = support.parent.split("/")[0] if support is not None else FLOOR
    if support is not None and owner in absent:
        raise SceneKeyError(
            f"{where}: {key}.{support.word}: '{owner}' may be absent, because it is in the group "
            f"'{absent[owner]}'. An object that may be absent cannot support others. Name another support."
        )
    if part.joined_to in scene.variants:
        raise SceneKeyError(
            f"{where}: {key}.relations: '{part.joined_to}' has variants with different sites. Join this "
            "object to an object without variants."
        )
    for path, other in part.references:
        if other in absent and absent[other] in scene.variants:
            raise SceneKeyError(
                f"{where}: {key}.{path}: '{other}' is a single variant. Name its object '{absent[other]}'."
            )
        if other in absent and scene.groups[absent[other]].missing == "refuse":
            raise SceneKeyError(
                f"{where}: {key}.{path}: '{other}' may be absent, because it is in the group '{absent[other]}'. "
                "Name another object, or write 'missing: drop' in the group to leave the reference out in worlds "
                "without the object."
            )


def _check_heaps(scene: SceneWords, where: str) -> None:
    """Check that objects of heaps are not placed elsewhere, and that containers stand upright."""
    things = {name for part in scene.heaps.values() for name in part.of}
    for heap, part in scene.heaps.items():
        for name in part.of:
            thing = scene.objects[name]
            given = thing.model_fields_set.intersection(PLACING)
            if thing.in_ != part.fill or thing.drawn_orientation.kind != "any" or given:
                raise SceneKeyError(
                    f"{where}: objects.{name}: the heap '{heap}' puts this object into '{part.fill}'. Leave out on, "
                    "inside, in, region, relations, ratio_on_support, orientation, joints and gap."
                )
        owner = part.fill.split("/")[0]
        if owner in things:
            raise SceneKeyError(
                f"{where}: heaps.{heap}.fill: '{owner}' is itself an object of a heap. Name another container."
            )
        if owner in scene.objects and scene.objects[owner].drawn_orientation.kind in ("any", "stable"):
            raise SceneKeyError(
                f"{where}: objects.{owner}.orientation: should keep this object upright, because the heap '{heap}' "
                "fills it. Write 'fixed', or a yaw."
            )


def _check_stacks(scene: SceneWords, where: str) -> None:
    """Check that the objects of stacks have no other support."""
    for stack, part in scene.stacks.items():
        for name, below in zip(part.of, (part.on, *part.of), strict=False):
            if scene.objects[name].on != below:
                raise SceneKeyError(
                    f"{where}: objects.{name}: should not name a support (on, inside, in), because the stack "
                    f"'{stack}' puts it on '{below}'."
                )


def _check_cycles(scene: SceneWords, where: str) -> None:
    needs = {name: with_variants(part.needs, scene.variants) for name, part in scene.parts.items()}
    try:
        graphlib.TopologicalSorter(needs).prepare()
    except graphlib.CycleError as error:
        cycle = error.args[1][:0:-1]  # each name needs the next, without repeating the first
        start = cycle.index(next(name for name in needs if name in cycle))
        raise in_a_cycle(where, cycle[start:] + cycle[:start], "objects are placed relative to each other") from None


def _check_starts(scene: SceneWords, where: str) -> None:
    """Check the section `start`: its names exist, and its objects can be held or placed as the kind of start needs."""
    for i, start in enumerate(scene.start):
        at = f"{where}: start.{i}"
        if start.of is not None and start.of not in scene.variants:
            _check_present(scene, start.of, [*scene.objects, *scene.variants], scene.absent, f"{at}.of")
        for name in start.targets(scene.groups):
            _check_target(scene, start, name, at)
        for name, marker in start.place.items():
            _check_place(scene, name, marker, f"{at}.place")
        for key in start.joints:
            name, _, joint = key.rpartition("/")
            if not name or not joint:
                raise SceneKeyError(f"{at}.joints: '{key}' should be 'object/joint', as in 'cabinet/upper'.")
            _check_present(scene, name, scene.objects, scene.owners, f"{at}.joints")


def _check_present(scene: SceneWords, name: str, objects: Iterable[str], absent: Container[str], where: str) -> None:
    """Check that an object exists in all worlds, and has no variants."""
    if name in scene.variants:
        raise SceneKeyError(f"{where}: '{name}' has variants, so only 'of' may name it. Name another object.")
    if name not in objects:
        raise UnknownNameError("object", name, where, [other for other in objects if other not in absent])
    if name in absent:
        raise SceneKeyError(f"{where}: '{name}' is a variant or in a group and may be absent. Name another object.")


def _check_target(scene: SceneWords, start: StartConfig, name: str, where: str) -> None:
    """Check that an arm can start at the grasp or pre-grasp of an object."""
    if not scene.objects[name].reachable:
        raise SceneKeyError(f"{where}.of: object '{name}' needs the key 'reachable', because the arm starts at it.")
    if start.is_held and scene.objects[name].kind != "free":
        raise SceneKeyError(
            f"{where}: '{name}' is not a free object, so it cannot be held in the air. Make its kind 'free', or leave "
            "out 'lift' and 'robot_joints'."
        )
    for other, words in scene.objects.items():
        if start.is_held and words.support is not None and words.support.parent.split("/")[0] == name:
            raise SceneKeyError(
                f"{where}: '{other}' stands on '{name}', and a held object cannot support others. Put '{other}' on "
                "another support, or leave out 'lift' and 'robot_joints'."
            )


def _check_place(scene: SceneWords, name: str, marker: str, where: str) -> None:
    """Check that a start can place an object at a marker."""
    objects = scene.objects
    _check_present(scene, name, objects, scene.absent, where)
    markers = [other for other, part in objects.items() if part.kind == "marker"]
    if marker not in markers:
        raise UnknownNameError("marker", marker, where, markers)
    _check_present(scene, marker, objects, scene.absent, where)
    if not objects[name].is_placed or objects[name].support is None or objects[name].support != objects[marker].support:
        raise SceneKeyError(f"{where}: '{name}' and its marker '{marker}' should have the same support.")
