"""`Section`, the base class of all parts of a scene: frozen, with errors that name the keys of the scene file."""

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from typing import Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, GetCoreSchemaHandler, ValidationError, model_validator
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError
from pydantic_core.core_schema import no_info_wrap_validator_function

from sceniris_gym.config.fields import UNKNOWN_KEY, reading, where_now, wrong


class Section(BaseModel):
    """A mapping of the scene file. It is frozen, and raises a ScenirisError for every wrong key or value.

    Attributes:
        one_of: Keys that exclude each other. Exactly one has to be given, unless the tuple is empty.
        misplaced: Keys that belong elsewhere, with advice that begins with "should".
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    one_of: ClassVar[tuple[str, ...]] = ()
    misplaced: ClassVar[Mapping[str, str]] = {}

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        # Wrap all validators of the part, including validators that run after its fields.
        return no_info_wrap_validator_function(cls._in_words, handler(source))

    @classmethod
    def _in_words(cls, data: Any, handler: Callable[[Any], Any]) -> Any:
        # Errors name the scene file, or the class if only this part is made in Python.
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

    def given(self, keys: tuple[str, ...]) -> list[str]:
        """Return the keys whose fields have a value other than None, in the order of `keys`."""
        return [key for key in keys if getattr(self, key) is not None]

    @model_validator(mode="after")
    def _has_one_of(self) -> Self:
        if self.one_of:
            check_one_of(self.given(self.one_of), self.one_of)
        return self


def check_one_of(given: list[str], keys: tuple[str, ...]) -> None:
    """Raise an error unless exactly one of `keys` is given."""
    if len(given) != 1:
        raise wrong(f"should have exactly one of {', '.join(keys)}, but has {' and '.join(given) or 'none'}")
