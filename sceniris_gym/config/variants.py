"""Objects with `variants`, of which every layout draws one: their words, written out as members of a group.

`target: {variants: {can: {...}, mug: {...}}, on: table}` means the objects `target/can` and `target/mug`, with the
words of both levels, and a group `target` of which one member is present. All else sees objects and groups.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection, Iterable, Mapping
from typing import Any, NoReturn

from pydantic import ValidationError
from pydantic_core import InitErrorDetails, PydanticCustomError

from sceniris_gym.config.fields import MemberName, listed, object_name, wrong
from sceniris_gym.config.folders import files_of, is_pattern, with_tags
from sceniris_gym.config.groups import SPLITS, GroupConfig
from sceniris_gym.config.loader import HOLDOUT, TAGS, VARIANTS, merge
from sceniris_gym.config.objects import ObjectConfig

DRAWN = ("weight", "split")
"""Words of a variant about how it is drawn."""
# The words of which a list means variants.
_LISTS = ("asset", "scale")


def variants_of(groups: Mapping[str, GroupConfig]) -> dict[str, tuple[str, ...]]:
    """Return the names of the members of each object with variants, by its name."""
    return {name: group.of for name, group in groups.items() if all(m.startswith(f"{name}/") for m in group.of)}


def owners_of(variants: Mapping[str, tuple[str, ...]]) -> dict[str, str]:
    """Return the object that each member of an object with variants is a variant of."""
    return {member: name for name, members in variants.items() for member in members}


def with_variants(names: Iterable[str], variants: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Return names in their order, with all members in the place of each object with variants."""
    return tuple(dict.fromkeys(member for name in names for member in variants.get(name, (name,))))


def with_members(scene: Any) -> Any:
    """Return the words of a scene with the variants of its objects written out; the scene itself if it has none.

    Raises:
        ValidationError: A variant, or what is said about all of them, is wrong.
    """
    objects = scene.get("objects") if isinstance(scene, Mapping) else None
    if not isinstance(objects, Mapping) or not any(has_variants(part) for part in objects.values()):
        return scene
    groups, written = dict(scene.get("groups") or {}), {}
    for name, part in objects.items():
        if not has_variants(part):
            if name in written:
                _refuse(("objects", name), "should have another name: a variant has this one", part)
            written[name] = part
            continue
        if name in groups:
            _refuse(("groups", name), "should have another name: an object with variants has this one", groups[name])
        members, groups[name] = _members(str(name), part)
        written |= members
    return {**scene, "objects": written, "groups": groups}


def check_shared(variants: Mapping[str, tuple[str, ...]], objects: Mapping[str, ObjectConfig]) -> None:
    """Check that variants agree on their kind and their draws, as one body is all of them in the simulation.

    Raises:
        ValidationError: They do not.
    """
    for name, members in variants.items():
        for word, what in (("kind", "kind"), ("randomize", "draws")):
            first, *others = (objects[member] for member in members)
            for member, part in zip(members[1:], others, strict=True):
                if getattr(part, word) != getattr(first, word):
                    value = part.model_dump(include={word}, exclude_none=True)[word]
                    place = ("objects", name, VARIANTS, member.partition("/")[2], word)
                    _refuse(place, f"should be the {what} of the other variants: one body is all of them", value)


def has_variants(part: Any) -> bool:
    """Return whether the words of an object name variants, at length or by a list."""
    return isinstance(part, Mapping) and (
        VARIANTS in part
        or HOLDOUT in part
        or TAGS in part
        or is_pattern(part.get("asset"))
        or any(isinstance(listed(part.get(word)), list | tuple) for word in _LISTS)
    )


def _members(name: str, part: Mapping) -> tuple[dict[str, dict], dict[str, Any]]:
    """Return the words of each member of an object with variants, and those of their group."""
    at = ("objects", name)
    shared = {word: value for word, value in part.items() if word not in (VARIANTS, HOLDOUT, TAGS)}
    variants = _scaled(at, _listed(at, part, shared), shared)
    members: dict[str, dict] = {}
    drawn: dict[str, dict[str, Any]] = {word: {} for word in DRAWN}
    for variant, words in variants.items():
        place = (*at, VARIANTS, str(variant))
        if not isinstance(words, Mapping):
            _refuse(place, "should be a mapping of keys to values", words)
        try:
            member = MemberName(f"{name}/{object_name(str(variant))}")
        except PydanticCustomError as error:
            _refuse_as(place, error, variant)
        for word in DRAWN:
            if word in words:
                drawn[word][member] = words[word]
        own = {word: value for word, value in words.items() if word not in DRAWN}
        members[member] = merge({"objects": {name: shared}}, {"objects": {name: own}})["objects"][name]
    splits = held_out(name, part[HOLDOUT], list(members)) if HOLDOUT in part else {}
    group = {"of": tuple(members), "count": 1, "weights": drawn["weight"], "splits": splits | drawn["split"]}
    for split in SPLITS:
        drawable = [name for name in members if group["splits"].get(name, split) == split]
        if all(drawn["weight"].get(name) == 0 for name in drawable):
            _refuse((*at, VARIANTS), f"should have one of a 'weight' above 0 in the split '{split}'", list(variants))
    return members, {word: value for word, value in group.items() if value}


def _listed(at: tuple[str, ...], part: Mapping, shared: dict) -> Mapping:
    """Return the variants of an object by name, those of a list of assets too, which is taken out of `shared`."""
    assets, variants = listed(part.get("asset")), part.get(VARIANTS)
    if is_pattern(assets):
        assets = _found(at, assets, part)
    elif TAGS in part:
        _refuse((*at, TAGS), "should be beside an 'asset' with a '*', of whose files they choose some", part[TAGS])
    if isinstance(assets, list | tuple):
        if VARIANTS in part:
            _refuse((*at, "asset"), "should be a list, or there should be 'variants', not both", assets)
        variants = {}
        for asset in assets:
            stem = _stem(asset)
            if stem in variants:
                _refuse((*at, "asset"), f"should name each thing once, but has two of the name '{stem}'", assets)
            variants[stem] = {"asset": asset}
        del shared["asset"]
    elif VARIANTS not in part:
        variants = {_stem(assets): {}}
    if not isinstance(variants, Mapping):
        _refuse((*at, VARIANTS), "should be a mapping of names to settings", variants)
    if not variants:
        _refuse((*at, VARIANTS), "should have at least one variant", variants)
    return variants


def _found(at: tuple[str, ...], pattern: str, part: Mapping) -> list[str]:
    """Return the files that a pattern matches, those with the object's `tags` if it has some."""
    word = "asset"
    try:
        files = files_of(pattern)
        if TAGS in part:
            word = TAGS
            files = with_tags(files, part[TAGS])
    except PydanticCustomError as error:
        _refuse_as((*at, word), error, part[word])
    return [str(path) for path in files]


def _stem(asset: Any) -> str:
    """Return the name that an asset gives to a variant: its own, or that of its file without the ending."""
    return re.sub(r"\.[^.]*$", "", str(asset).rpartition("/")[2])


def _scaled(at: tuple[str, ...], variants: Mapping, shared: dict) -> dict[str, Any]:
    """Return the variants with a list of scales, of the object or of a variant, written out."""
    common = listed(shared.get("scale"))
    if isinstance(common, list | tuple):
        del shared["scale"]
    found: dict[str, Any] = {}
    for name, words in variants.items():
        scales = listed(words.get("scale", common)) if isinstance(words, Mapping) else None
        if not isinstance(scales, list | tuple):
            found[name] = words
            continue
        if not scales:
            _refuse((*at, "scale"), "should be a number or a list of numbers", scales)
        for scale in scales:
            if isinstance(scale, bool) or not isinstance(scale, int | float):
                _refuse((*at, "scale"), "should be a number or a list of numbers", scales)
            scaled = f"{name}-{100 * scale:g}".replace(".", "_")
            if scaled in found:
                _refuse((*at, "scale"), "should have each scale once", scales)
            found[scaled] = {**words, "scale": scale}
    return found


def held_out(name: str, share: Any, members: Collection[str]) -> dict[str, str]:
    """Return the split of each member of an object: a share of them, by the hashes of their names, is for `eval`.

    Raises:
        ValidationError: The share is none, or there is one member only.
    """
    at = ("objects", name)
    if isinstance(share, bool) or not isinstance(share, int | float) or not 0.0 < share < 1.0:
        _refuse((*at, HOLDOUT), "should be above 0 and below 1", share)
    if len(members) < 2:
        _refuse((*at, HOLDOUT), "should be left out, as there are not two variants", share)
    ranked = sorted(members, key=lambda name: hashlib.sha256(name.partition("/")[2].encode()).digest())
    count = min(max(round(share * len(members)), 1), len(members) - 1)
    return {name: "eval" if name in ranked[:count] else "train" for name in members}


def _refuse(place: tuple[str, ...], advice: str, value: Any) -> NoReturn:
    _refuse_as(place, wrong(advice), value)


def _refuse_as(place: tuple[str, ...], error: PydanticCustomError, value: Any) -> NoReturn:
    raise ValidationError.from_exception_data("SceneConfig", [InitErrorDetails(type=error, loc=place, input=value)])
