"""`KeyReader`: reads a configuration for the original package key by key, which errors about its scene then name."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sceniris_gym.config.fields import short
from sceniris_gym.errors import SceneKeyError, ScenirisError, ScenirisWarning, UnknownNameError

CONFIGURATION = "original configuration"
"""The name of the configuration as a whole in errors."""
_PLACE = re.compile(r"^scene: (?P<path>[^:\s]+)", re.MULTILINE)
_SHAPES: dict[tuple[int, ...], str] = {
    (): "a number",
    (2,): "[x, y]",
    (3,): "[x, y, z]",
    (2, 2): "[[min x, min y], [max x, max y]]",
}


class KeysLeftOutWarning(ScenirisWarning):
    """Some keys of an original configuration were left out, or have a different meaning here.

    Args:
        keys: Dotted paths of the keys that are left out.
        changed: The meaning here of keys that are carried over with a different meaning or value, by dotted path.
        advice: Sentences on how to carry over more.
    """

    def __init__(
        self, keys: Iterable[str], changed: Mapping[str, str] | None = None, advice: Iterable[str] = ()
    ) -> None:
        self.keys, self.changed, self.advice = tuple(keys), dict(changed or {}), tuple(advice)
        texts = [f"not carried over from the original configuration: {', '.join(self.keys)}."] if self.keys else []
        if self.changed:
            meanings = "; ".join(f"{key} ({meaning})" for key, meaning in self.changed.items())
            texts.append(f"carried over from the original configuration with a different meaning or value: {meanings}.")
        super().__init__(" ".join((*texts, *self.advice)))


@dataclass
class Notes:
    """Notes for the user about a configuration.

    Attributes:
        left_out: Dotted paths of keys that are not carried over.
        changed: The meanings of keys here and in the original where the two differ, by their dotted paths.
        origins: Dotted path of a part of the scene -> that of the key that it was made from.
        advice: Sentences on how to carry over more of it.
    """

    left_out: list[str] = field(default_factory=list)
    changed: dict[str, str] = field(default_factory=dict)
    origins: dict[str, str] = field(default_factory=dict)
    advice: list[str] = field(default_factory=list)

    def advise(self, sentence: str) -> None:
        """Add a piece of advice, unless it was given before."""
        if sentence not in self.advice:
            self.advice.append(sentence)


class KeyReader:
    """One mapping of the configuration. Keys that are not taken from it are left out; None counts as no key.

    Args:
        data: The mapping.
        path: Its dotted path in the configuration, empty for the whole.
        notes: Collects the keys that are left out or changed.
    """

    def __init__(self, data: Any, path: str, notes: Notes) -> None:
        self.path, self.notes = path, notes
        if not isinstance(data, Mapping):
            raise self.wrong("", f"{short(data)} should be a mapping of keys to values")
        self._rest = {str(key): value for key, value in data.items() if value is not None}

    def at(self, key: str) -> str:
        """Return the dotted path of a key."""
        return ".".join(filter(None, (self.path, key)))

    def wrong(self, key: str, advice: str) -> SceneKeyError:
        """Return the error about a key; `advice` says what was wrong and what would be right."""
        return SceneKeyError(f"{CONFIGURATION}: {self.at(key) or 'cfg'}: {advice}.")

    def known(self, key: str, kind: str, name: Any, valid: Iterable[str], own: str | None = None) -> str:
        """Return a name that was found at `key`; `own`, the object that the key belongs to, is never suggested.

        Raises:
            UnknownNameError: It is not one of the valid names.
        """
        valid = list(valid)
        if name not in valid:
            others = [other for other in valid if other != own]
            raise UnknownNameError(kind, str(name), f"{CONFIGURATION}: {self.at(key)}", others)
        return name

    def take(self, key: str, default: Any = None) -> Any:
        """Return the value of a key, whatever it is."""
        return self._rest.pop(key, default)

    def value(self, key: str) -> Any:
        """Return the value of a key, or None, without taking it."""
        return self._rest.get(key)

    def array(self, key: str, default: Any, shape: tuple[int, ...]) -> np.ndarray:
        """Return the value of a key as an array of floats.

        Raises:
            SceneKeyError: It is not an array of finite numbers of this shape.
        """
        return self.checked(key, self.take(key, default), shape)

    def number(self, key: str, default: float) -> float:
        """Return the value of a key as a number."""
        return float(self.array(key, default, ()))

    def checked(self, key: str, value: Any, shape: tuple[int, ...]) -> np.ndarray:
        """Return a value that was found at `key` as an array of floats, as `array` does."""
        array = numbers(value)
        if array.shape != shape:
            raise self.wrong(key, f"{short(value)} should be {_SHAPES[shape]}")
        return array

    def rotation(self, key: str, value: Any) -> np.ndarray:
        """Return the rotation, shape (3, 3), of a transform that was found at `key`.

        Raises:
            SceneKeyError: It is not a matrix of 4 x 4 or 3 x 3 numbers.
        """
        array = numbers(value)
        if array.shape not in ((4, 4), (3, 3)):
            raise self.wrong(key, f"{short(value)} should be a matrix of 4 x 4 or 3 x 3 numbers")
        return array[:3, :3]

    def values(self, key: str) -> list:
        """Return the value of a key as a list, empty if there is none."""
        value = self.take(key, ())
        if isinstance(value, str | bytes) or not isinstance(value, Sequence | np.ndarray):
            raise self.wrong(key, f"{short(value)} should be a list")
        return list(value)

    def section(self, key: str) -> KeyReader:
        """Return the mapping at a key, an empty one if there is none."""
        return KeyReader(self.take(key, {}), self.at(key), self.notes)

    def sections(self, key: str) -> list[KeyReader]:
        """Return the mappings in the list at a key."""
        return [KeyReader(data, self.at(f"{key}.{i}"), self.notes) for i, data in enumerate(self.values(key))]

    def everything(self) -> dict[str, Any]:
        """Take all keys that were not taken yet, and return them with their values."""
        rest, self._rest = self._rest, {}
        return rest

    def ignore(self, *keys: str) -> None:
        """Forget keys that have no effect in the original either."""
        for key in keys:
            self._rest.pop(key, None)

    def leave_out(self, key: str = "") -> None:
        """Note that a key, or the whole mapping, is left out."""
        self.notes.left_out.append(self.at(key))
        self._rest.pop(key, None)

    def change(self, key: str, meaning: str) -> None:
        """Note that a key is carried over with a different meaning or value; `meaning` says which."""
        self.notes.changed[self.at(key)] = meaning

    def made(self, part: str, key: str) -> None:
        """Remember that a part of the scene, by its dotted path, is made from a key, so that errors name the key."""
        self.notes.origins[part] = self.at(key)

    def finish(self) -> None:
        """Leave out all keys that were not taken."""
        for key in list(self._rest):
            self.leave_out(key)


def numbers(value: Any) -> np.ndarray:
    """Return a value as an array of floats; an empty one if it is anything but finite numbers."""
    try:
        array = np.asarray(value)
    except ValueError:  # lists of different lengths
        array = np.zeros(0)
    return array.astype(float) if array.dtype.kind in "iuf" and np.isfinite(array).all() else np.zeros(0)


def in_its_keys(error: ScenirisError, origins: Mapping[str, str]) -> ScenirisError:
    """Return an error about a scene as one that names the keys of the configuration.

    Args:
        error: The error raised while reading the scene.
        origins: Dotted path of a part of the scene -> that of its key in the configuration.
    """
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
