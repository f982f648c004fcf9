"""Errors about an imported scene, reworded to name the keys of the original configuration."""

from __future__ import annotations

import re
from collections.abc import Mapping

from sceniris_gym.errors import CycleError, ScenirisError, UnknownNameError
from sceniris_gym.importers.sceniris.keys import CONFIGURATION

_PLACE = re.compile(r"^scene: (?P<path>[^:\s]+)", re.MULTILINE)


def in_its_keys(error: ScenirisError, origins: Mapping[str, str]) -> ScenirisError:
    """Return an error about a scene as one that names the keys that its parts were made from.

    Args:
        error: The error raised while reading the scene.
        origins: Dotted path of a part of the scene -> that of its key in the configuration.
    """
    if isinstance(error, CycleError):
        return CycleError(CONFIGURATION, error.names, error.what)
    if isinstance(error, UnknownNameError):
        return UnknownNameError(error.kind, error.name, _with_keys(error.where, origins), error.valid)
    return type(error)(_with_keys(str(error), origins))


def origin(path: str, origins: Mapping[str, str]) -> str:
    """Return the key that the part of the scene at a dotted path was made from, or the path itself."""
    parts = path.split(".")
    heads = (".".join(parts[:n]) for n in range(len(parts), 0, -1))
    return next((origins[head] for head in heads if head in origins), path)


def _with_keys(text: str, origins: Mapping[str, str]) -> str:
    return _PLACE.sub(lambda found: f"{CONFIGURATION}: {origin(found['path'], origins)}", text)
