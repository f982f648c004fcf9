"""Objects with `variants`: each layout draws a variant. Each variant is expanded to an object, a member of a group.

`target: {variants: {can: {...}, mug: {...}}, on: table}` becomes the objects `target/can` and `target/mug`, with the
keys of the variant and of `target`, and a group `target` with one member present. All other modules only see objects
and groups.
"""

import hashlib
from collections.abc import Collection, Iterable, Mapping
from fnmatch import filter as matching
from pathlib import Path
from typing import Any

from sceniris_gym.config.bounds import BOUNDS
from sceniris_gym.config.fields import DEFAULT, DRAWN, listed, locating, object_name, refuse, where_now, wrong
from sceniris_gym.config.folders import files_of, is_pattern, with_tags
from sceniris_gym.config.groups import SPLITS
from sceniris_gym.config.loader import HOLDOUT, OF_VARIANTS, TAGS, VARIANTS, merge
from sceniris_gym.config.member_names import MemberName, object_of, variant_of
from sceniris_gym.config.objects import ObjectConfig
from sceniris_gym.errors import check_names

# Words that make variants if their value is a list.
_LISTS = ("asset", "scale")
# Words of the object that are conditions of the group of its variants.
_CONDITIONS = ("if", "unless")
# Words that all variants have to share, and the advice for errors.
_SHARED = {
    "kind": "should be the same for all variants, because they share one body",
    "randomize": "should be the same for all variants, which share one body: write it next to 'variants'. For a single "
    "variant, a task can call State.scale_field, or write to State.model_field, in on_reset",
}


def owners_of(variants: Mapping[str, tuple[str, ...]]) -> dict[str, str]:
    """Return the owner of each variant: name of a variant -> the object with this variant."""
    return {member: name for name, members in variants.items() for member in members}


def with_variants(names: Iterable[str], variants: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Return names in their order. If an object has variants, the names of its variants replace its name."""
    return tuple(dict.fromkeys(member for name in names for member in variants.get(name, (name,))))


def with_members(scene: Any, left_out: Collection[str] = ()) -> Any:
    """Expand the variants in a scene mapping to objects and groups. Without variants, return the same mapping.

    Args:
        scene: The mapping. The keys of an object `target/can` only apply to this variant of `target`.
        left_out: Full names of variants to leave out.

    Raises:
        ValidationError: A key or a value for one variant, or for all variants, is wrong.
        UnknownNameError: An object has no such variant.
    """
    objects = scene.get("objects")
    slots = [name for name, part in objects.items() if has_variants(part)] if isinstance(objects, Mapping) else []
    if not slots:
        return scene
    owners = {name: owner for name in objects if (owner := object_of(str(name))) != name}
    single = {name: objects[name] for name, owner in owners.items() if owner in slots}
    groups, written = dict(scene.get("groups") or {}), {}
    for name, part in objects.items():
        if name in slots and name not in single:
            if name in groups:
                advice = "should have another name: an object with variants already has this name"
                refuse(("groups", name), advice, groups[name])
            members, groups[name] = _members(str(name), part, single, left_out)
            written |= members
        elif name not in single:
            written[name] = part
    for name in single:
        of = groups[owners[name]]["of"]
        if name not in left_out:
            check_names("variant", [name], f"{where_now.get()}: objects", of)
    return {**scene, "objects": written, "groups": groups}


def check_shared(variants: Mapping[str, tuple[str, ...]], objects: Mapping[str, ObjectConfig]) -> None:
    """Check that variants agree on their kind and their draws, because they share one body in the simulation.

    Raises:
        ValidationError: Variants differ in their kind or their draws.
    """
    for name, (first, *others) in variants.items():
        for member in others:
            for word, advice in _SHARED.items():
                if getattr(objects[member], word) != getattr(objects[first], word):
                    value = objects[member].model_dump(include={word}, exclude_none=True)[word]
                    refuse(("objects", name, VARIANTS, variant_of(member), word), advice, value)


def check_parts(
    variants: Mapping[str, tuple[str, ...]], objects: Mapping[str, ObjectConfig], left_out: Collection[str]
) -> None:
    """Check that each part has a key for each variant, and that its other keys name variants.

    Args:
        variants: Object -> names of its variants.
        objects: All objects, with a variant as an object.
        left_out: Full names of variants that were left out.

    Raises:
        ValidationError: A variant has no key in a part, or a key names no variant.
    """
    owners = owners_of(variants)
    for name, config in objects.items():
        owner = owners.get(name, name)
        known = [variant_of(member) for member in (*variants.get(owner, ()), *left_out)] if config.parts else []
        for part, joints in config.parts.items():
            at, variant = ("objects", owner, "parts", part), variant_of(name)
            for key in (key for key in joints if key != DEFAULT and not matching(known, key)):
                with locating((*at, key), joints[key]):
                    raise wrong("should be the joint of a variant: its key names no variant", key, [*known, DEFAULT])
            if DEFAULT not in joints and not any(matching([variant], key) for key in joints):
                advice = f"should have a joint for '{variant}', null if it has none, or one for all others: '{DEFAULT}'"
                refuse(at, advice, joints)


def has_variants(part: Any) -> bool:
    """Return whether an object's mapping declares variants: by a key for variants, a list, or a file pattern."""
    return isinstance(part, Mapping) and (
        any(word in part for word in OF_VARIANTS)
        or is_pattern(part.get("asset"))
        or any(isinstance(listed(part.get(word)), list | tuple) for word in _LISTS)
    )


def _members(
    name: str, part: Mapping, single: Mapping[Any, Any], left_out: Collection[str]
) -> tuple[dict[str, dict], dict[str, Any]]:
    """Return the mapping of each variant of an object, by its full name, and the mapping of their group.

    Args:
        name: The object.
        part: The object's mapping in the scene file.
        single: Mappings that only apply to one variant, by its full name, such as 'target/can'.
        left_out: Full names of variants to leave out.
    """
    at = ("objects", name)
    shared = {word: value for word, value in part.items() if word not in (*OF_VARIANTS, *_CONDITIONS)}
    variants = _scaled(at, _listed(at, part, shared), shared)
    if not variants:
        word = VARIANTS if VARIANTS in part else "asset"
        refuse((*at, word), "should have at least one variant", part[word])
    members: dict[str, dict] = {}
    drawn: dict[str, dict[str, Any]] = {word: {} for word in DRAWN}
    for variant, words in variants.items():
        member = MemberName(f"{name}/{variant}")
        if member in left_out:
            continue
        if not isinstance(single.get(member, {}), Mapping):
            refuse(("objects", member), "should be a mapping of keys to values", single[member])
        own = merge(words, single.get(member, {}), at)
        for word in (word for word in OF_VARIANTS if word in own):
            refuse((*at, VARIANTS, variant, word), f"should be given for the object '{name}'", own[word])
        for word in own.keys() & drawn.keys():
            drawn[word][member] = own.pop(word)
        members[member] = merge(shared, own, at)
    splits = _held_out(at, part[HOLDOUT], members) if HOLDOUT in part else {}
    splits |= drawn["split"]
    group: dict[str, Any] = {"of": tuple(members), "count": 1, "weights": drawn["weight"], "splits": splits}
    group |= {word: part[word] for word in _CONDITIONS if word in part}
    for split in SPLITS:
        drawable = [name for name in members if group["splits"].get(name, split) == split]
        if not drawable:
            refuse((*at, VARIANTS), f"should include a variant that the split '{split}' may draw", list(variants))
        if all(drawn["weight"].get(name) == 0 for name in drawable):
            refuse((*at, VARIANTS), f"should have one with a 'weight' above 0 in the split '{split}'", list(variants))
    return members, {word: value for word, value in group.items() if value}


def _listed(at: tuple[str, ...], part: Mapping, shared: dict) -> Mapping[str, Mapping]:
    """Return the variants of an object, by name. Each asset of a list, or file of a pattern, becomes a variant.

    The `asset` is then removed from `shared`, the mapping that all variants share.
    """
    assets = listed(part.get("asset"))
    if TAGS in part and not is_pattern(assets):
        refuse((*at, TAGS), "should be given only with an 'asset' of several files, written with a '*'", part[TAGS])
    if not is_pattern(assets) and not isinstance(assets, list | tuple):
        if VARIANTS not in part and not isinstance(assets, str):
            word = next(word for word in ("asset", "scale", HOLDOUT) if word in part)
            advice = "should be an asset, a list of assets, or a pattern of files"
            refuse((*at, word), advice if word == "asset" else "should be given only with an 'asset'", part[word])
        return _named(at, part[VARIANTS]) if VARIANTS in part else {_stem(assets): {}}
    if VARIANTS in part:
        advice = (
            f"should be given without 'variants'. Write keys of a single variant under an object '{at[1]}/<variant>'"
        )
        refuse((*at, "asset"), advice, assets)
    del shared["asset"]
    is_folder = is_pattern(assets)
    if is_folder:
        with locating((*at, "asset"), assets):
            files = files_of(assets)
        with locating((*at, TAGS), part.get(TAGS)):
            assets = [str(path) for path in (with_tags(files, part[TAGS]) if TAGS in part else files)]
    names = [_stem(asset) for asset in assets]
    if is_folder:  # files of the same name have the names of their folders, before their own if there are several
        folders = [_stem(Path(asset).parent) for asset in assets]
        others = [f if folders.count(f) == 1 else f"{f}_{n}" for f, n in zip(folders, names, strict=True)]
        names = [n if names.count(n) == 1 else other for n, other in zip(names, others, strict=True)]
    variants: dict[str, Mapping] = {}
    for stem, asset in zip(names, assets, strict=True):
        if stem in variants:
            refuse((*at, "asset"), f"should name each asset once, but has two of the name '{stem}'", assets)
        variants[stem] = {"asset": asset}
    return variants


def _named(at: tuple[str, ...], variants: Any) -> Mapping[str, Mapping]:
    """Return the value of the key `variants`, after a check of its names and values."""
    if not isinstance(variants, Mapping):
        refuse((*at, VARIANTS), "should be a mapping of names to settings", variants)
    for name, words in variants.items():
        loc = (*at, VARIANTS, str(name))
        if not isinstance(words, Mapping):
            refuse(loc, "should be a mapping of keys to values", words)
        with locating(loc, name):
            object_name(str(name))
    return variants


def _stem(asset: Any) -> str:
    """Return a variant's name from its asset: the asset's name, or its file's name without the suffix."""
    stem = Path(str(asset)).stem.replace(".", "_")  # a dot would separate keys of overrides
    return "world_" if stem == "world" else stem  # each model has a body 'world'


def _scaled(at: tuple[str, ...], variants: Mapping[str, Mapping], shared: dict) -> dict[str, Mapping]:
    """Expand lists in `scale` to one variant for each scale, and return all variants.

    The list may be a value of the object or of a single variant.
    """
    common = listed(shared.get("scale"))
    if isinstance(common, list | tuple):
        del shared["scale"]
    found: dict[str, Mapping] = {}
    for name, words in variants.items():
        loc = (*at, VARIANTS, name, "scale") if "scale" in words else (*at, "scale")
        named, scales = {name: words}, listed(words.get("scale", common))
        if isinstance(scales, list | tuple):
            if not scales or any(isinstance(scale, bool) or not isinstance(scale, int | float) for scale in scales):
                refuse(loc, "should be a number or a list of numbers", scales)
            if not all(BOUNDS["scale"].holds(scale) for scale in scales):
                refuse(loc, BOUNDS["scale"].advice, scales)
            named = {f"{name}-{100 * scale:g}".replace(".", "_"): {**words, "scale": scale} for scale in scales}
            if len(named) < len(scales):
                refuse(loc, "should have each scale once: it is a list of variants, not of axes", scales)
        if twice := [new for new in named if new in found]:
            refuse((*at, VARIANTS), "should be the name of one variant only. Rename the others", twice[0])
        found |= named
    return found


def _held_out(at: tuple[str, ...], share: Any, members: Collection[str]) -> dict[str, str]:
    """Return the split of each variant. The fraction `share` is for `eval`, chosen by a hash of the names."""
    if isinstance(share, bool) or not isinstance(share, int | float) or not 0.0 < share < 1.0:
        refuse((*at, HOLDOUT), "should be above 0 and below 1", share)
    if len(members) < 2:
        refuse((*at, HOLDOUT), "should be left out, because it needs at least two variants", share)
    ranked = sorted(members, key=lambda name: hashlib.sha256(variant_of(name).encode()).digest())
    count = min(max(round(share * len(members)), 1), len(members) - 1)
    return {name: "eval" if name in ranked[:count] else "train" for name in members}
