"""Files of a folder, of which each is a variant of an object; tags in their manifests choose among them."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeGuard

from sceniris_gym.config.fields import listed, wrong
from sceniris_gym.errors import ModelWarning
from sceniris_gym.files import read_bytes

MANIFEST = "manifest.json"
"""The file that `sceniris-gym import` writes into the folder of an asset's meshes."""


def is_pattern(asset: Any) -> TypeGuard[str]:
    """Return whether an asset is a pattern of file names."""
    return isinstance(asset, str) and "*" in asset


def files_of(pattern: str) -> list[Path]:
    """Return the MJCF files that a pattern matches, in the order of their names.

    Warns of files whose names are no text, which are left out.

    Raises:
        PydanticCustomError: There is none, or the pattern is one of folders.
    """
    if is_pattern(str(Path(pattern).parent)):
        raise wrong("should have its '*' in the name of the file and in no folder's")
    found = sorted(path for path in Path(pattern).parent.glob(Path(pattern).name) if path.suffix == ".xml")
    named = [path for path in found if path.name.isprintable()]
    if not named:
        raise wrong("should match MJCF files, as `sceniris-gym import` writes them")
    if len(named) < len(found):
        odd = ascii(next(path.name for path in found if path not in named))
        warnings.warn(ModelWarning(f"{pattern}: files whose names are no text are left out: {odd}"), stacklevel=2)
    return named


def with_tags(files: Iterable[Path], tags: Any) -> list[Path]:
    """Return the files whose manifests have all of some tags.

    Raises:
        PydanticCustomError: The tags are not names, no manifest has one of them, or none has all of them.
    """
    tags = [tags] if isinstance(tags, str) else listed(tags)
    if not isinstance(tags, list | tuple) or not tags or not all(isinstance(tag, str) for tag in tags):
        raise wrong("should be a list of tags, as in [graspable]")
    tags_of = {path: _tags(path) for path in files}
    known = sorted(set().union(*tags_of.values()))
    for tag in tags:
        if tag not in known:
            has = f"have {', '.join(known)}" if known else f"name no 'tags': their {MANIFEST} should"
            raise wrong(f"should be tags of the folder's things, which {has}", tag, known)
    found = [path for path, own in tags_of.items() if own.issuperset(tags)]
    if not found:
        raise wrong("should be tags that one of the folder's things has all of")
    return found


def _tags(asset: Path) -> set[str]:
    """Return the tags in the manifest of an asset; none if it has no manifest."""
    path = asset.with_suffix("") / MANIFEST
    try:
        told = json.loads(read_bytes(path)).get("tags", ())
        if isinstance(told, str):
            raise TypeError("'tags' should be a list")
        return {str(tag) for tag in told}
    except FileNotFoundError:
        return set()
    except (OSError, ValueError, AttributeError, TypeError, RecursionError) as error:
        reason = str(error).splitlines()[0]
        raise wrong(
            f"should have manifests as `sceniris-gym import` writes them, but {path} is none: {reason}"
        ) from None
