"""Settings as dataclasses or as mappings of their fields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import pytest

from sceniris_gym.config.settings import as_config
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, UnknownNameError


@dataclass(frozen=True)
class Light:
    """Settings for these tests."""

    color: Mapping[str, float]
    size: tuple[int, int] = (1, 2)
    names: list[str] = field(default_factory=list)


def test_a_dataclass_is_returned_as_it_is_and_a_mapping_becomes_one():
    """A mapping sets its fields, and a list becomes a tuple, as JSON has no tuples."""
    light = Light({"red": 1.0})
    assert as_config(Light, light, "light") is light
    assert as_config(Light, {"color": {"red": 1.0}, "size": [3, 4]}, "light") == Light({"red": 1.0}, (3, 4))


@pytest.mark.parametrize(
    ("value", "error", "message"),
    [
        (3, ArgumentTypeError, "^light should be a Light, a mapping of its fields, or None, got 3"),
        ([("size", (1, 2))], ArgumentTypeError, "^light should be a Light"),
        ({"colour": {}}, UnknownNameError, "^light: unknown field 'colour'. Did you mean 'color'?"),
        ({"color": {}, 3: 4}, UnknownNameError, "^light: unknown field '3'"),
        ({"size": (1, 2)}, ArgumentError, r"^light should have the field 'color', got \['size'\]"),
    ],
)
def test_settings_that_are_wrong_are_refused_by_name(value: Any, error: type[Exception], message: str):
    """Another type, an unknown field, and a missing one."""
    with pytest.raises(error, match=message.replace("?", r"\?")):
        as_config(Light, value, "light")
