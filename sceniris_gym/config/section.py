"""`Section`, the base class of all parts of a scene: frozen, with errors in the terms of the scene file."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from typing import Any, ClassVar, TypeVar

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, ValidationError, ValidatorFunctionWrapHandler
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError
from pydantic_core.core_schema import no_info_wrap_validator_function

from sceniris_gym.config.fields import wrong
from sceniris_gym.config.messages import UNKNOWN_KEY, reading, where_now


class Section(BaseModel):
    """A mapping of the scene file: frozen, and every wrong key or value is a ScenirisError."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    misplaced: ClassVar[Mapping[str, str]] = {}
    """Words that belong somewhere else, with advice on where; the advice begins with "should"."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        # Wraps all validators of the part, including those that run after its fields.
        return no_info_wrap_validator_function(cls._in_words, handler(source))

    @classmethod
    def _in_words(cls, data: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        # A part made on its own in Python is named by its class in errors; inside a scene, the scene file is named.
        with reading(cls.__name__) if where_now.get() is None else nullcontext():
            if isinstance(data, Mapping):
                cls._check_keys(data)
            return handler(data)

    @classmethod
    def _check_keys(cls, data: Mapping) -> None:
        valid = [field.alias or name for name, field in cls.model_fields.items()]
        problems = [
            InitErrorDetails(type=cls._problem(key, valid), loc=(str(key),), input=value)
            for key, value in data.items()
            if key not in valid and key not in cls.model_fields
        ]
        if problems:
            raise ValidationError.from_exception_data(cls.__name__, problems)

    @classmethod
    def _problem(cls, key: Any, valid: list[str]) -> PydanticCustomError:
        if key in cls.misplaced:
            return wrong(cls.misplaced[key])
        return PydanticCustomError(UNKNOWN_KEY, "unknown key", {"key": key, "valid": valid})

    def given(self, words: tuple[str, ...]) -> list[str]:
        """Return those of the fields `words` that have a value other than None, in their order."""
        return [word for word in words if getattr(self, word) is not None]


_PartT = TypeVar("_PartT", bound=Section | Mapping)


def check_one_of(part: _PartT, words: tuple[str, ...]) -> _PartT:
    """Return a section, or its keys, if exactly one of `words` is given; otherwise raise an error."""
    given = part.given(words) if isinstance(part, Section) else [word for word in words if part.get(word) is not None]
    if len(given) != 1:
        has = " and ".join(given) if given else "none"
        raise wrong(f"should have exactly one of {', '.join(words)}, but has {has}")
    return part
