"""Settings that a user passes as a dataclass, as a mapping of its fields, or as KEY=VALUE on the command line."""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any, TypeVar

from sceniris_gym.config.fields import short
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneKeyError, check_names

_Config = TypeVar("_Config")


def as_config(cls: type[_Config], value: Any, where: str) -> _Config:
    """Return `value` as an instance of a dataclass. `value` is an instance already, or a mapping of the fields.

    Gymnasium's `EnvSpec.from_json` returns dataclasses as mappings, and tuples as lists. So a list in a field becomes a
    tuple.

    Args:
        cls: A dataclass, such as Sensing. Its `__post_init__` checks the values.
        value: The user's argument, not None.
        where: Name of the argument in error messages.

    Raises:
        ArgumentTypeError: The value has another type.
        UnknownNameError: A key is not a field. The message has the nearest valid name.
        ArgumentError: A field without a default is missing.
    """
    if isinstance(value, cls):
        return value
    if not isinstance(value, Mapping):
        name = f"{'an' if cls.__name__[0] in 'AEIOU' else 'a'} {cls.__name__}"
        raise ArgumentTypeError(f"{where} should be {name}, a mapping of its fields, or None, got {short(value)}.")
    known = {f.name: f for f in fields(cls)}  # pyrefly: ignore[bad-argument-type]
    check_names("field", value, where, known)
    for name, field in known.items():
        if field.default is MISSING and field.default_factory is MISSING and name not in value:
            raise ArgumentError(f"{where} should have the field '{name}', got {short(list(value))}.")
    return cls(**{name: tuple(given) if isinstance(given, list) else given for name, given in value.items()})


def read_changes(changes: Sequence[str]) -> dict[str, Any]:
    """Read the `KEY=VALUE` pairs of `--set`, with values in YAML as in a scene file.

    Raises:
        SceneKeyError: A pair has another form, or its value is not YAML.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    overrides = {}
    for change in changes:
        key, equals, value = change.partition("=")
        if not (key and equals):
            raise SceneKeyError(f"--set {change}: should be KEY=VALUE, as in objects.apple.clearance=0.01.")
        try:
            overrides[key] = YAML(typ="safe").load(value)
        except (YAMLError, ValueError, RecursionError) as error:
            why = "it is too deeply nested." if isinstance(error, RecursionError) else error
            raise SceneKeyError(f"--set {change:.80}: the value should be valid YAML: {why}") from None
    return overrides
