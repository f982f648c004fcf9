"""Folders whose files are the variants of an object, and the tags in their manifests that select files."""

import json
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeGuard

from sceniris_gym.config.fields import check_words, listed, wrong
from sceniris_gym.errors import ModelWarning
from sceniris_gym.files import read_bytes

MANIFEST = "manifest.json"
"""The file that `sceniris-gym import` writes into the folder of an asset's meshes."""


def is_pattern(asset: Any) -> TypeGuard[str]:
    """Return whether an asset is a pattern of file names."""
    return isinstance(asset, str) and "*" in asset


def files_of(pattern: str) -> list[Path]:
    """Return the MJCF files that a pattern matches, in the order of their paths. Names of folders may have '*', too.

    Files with unprintable names are left out, with a warning.

    Raises:
        PydanticCustomError: The pattern matches no file.
    """
    parts = Path(pattern).parts
    first = next(i for i, part in enumerate(parts) if is_pattern(part))
    found = sorted(path for path in Path(*parts[:first]).glob("/".join(parts[first:])) if path.suffix == ".xml")
    named = [path for path in found if path.name.isprintable()]
    if not named:
        raise wrong("should match at least one MJCF file (.xml), such as the files that `sceniris-gym import` writes")
    if len(named) < len(found):
        odd = ascii(next(path.name for path in found if path not in named))
        warnings.warn(ModelWarning(f"{pattern}: files with unprintable names are left out: {odd}"), stacklevel=2)
    return named


def with_tags(files: Iterable[Path], tags: Any) -> list[Path]:
    """Return the files whose manifests have all given tags.

    Raises:
        PydanticCustomError: The tags are not names, a tag is in no manifest, or no manifest has all given tags.
    """
    tags = [tags] if isinstance(tags, str) else listed(tags)
    if not isinstance(tags, list | tuple) or not tags or not all(isinstance(tag, str) for tag in tags):
        raise wrong("should be a list of tags, as in [graspable]")
    tags_of = {path: _tags(path) for path in files}
    known = sorted(set().union(*tags_of.values()))
    has = ", ".join(known) or f"none. Add 'tags' to a {MANIFEST} in the folder, or leave them out here"
    check_words(tags, known, f"should be among the tags of the folder's assets: {has}")
    found = [path for path, own in tags_of.items() if own.issuperset(tags)]
    if not found:
        raise wrong("should be tags that occur together in at least one of the folder's assets")
    return found


def _tags(asset: Path) -> set[str]:
    """Return the tags in the manifest of an asset, or an empty set if it has no manifest."""
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
            f"should select assets by their manifests, but {path} cannot be read: {reason}. Import this asset again"
        ) from None
