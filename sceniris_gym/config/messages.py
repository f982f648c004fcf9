"""Pydantic's validation errors, reworded in the terms of the scene file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from sceniris_gym.errors import SceneKeyError, did_you_mean

# Of the thread: pydantic hands its validators no argument of ours.
where_now: ContextVar[str | None] = ContextVar("where_now", default=None)
"""The file or the class that is being read, or None while nothing is."""

# Our own types of error. Context of the first: key, valid; of the second: advice (a phrase that begins with "should"),
# hint (a guess at what was meant).
UNKNOWN_KEY, ADVICE = "unknown_key", "advice"
DRAWN = ("weight", "split")
"""Words of a variant about how it is drawn."""

_SHOULD = {
    "float_type": "should be a number",
    "float_parsing": "should be a number",
    "finite_number": "should be a finite number",
    "int_type": "should be a whole number",
    "string_type": "should be a name",
    "path_type": "should be the path of a file",
    "tuple_type": "should be a list",
    "dict_type": "should be a mapping of names to settings",
    "model_type": "should be a mapping of keys to values",
    "model_attributes_type": "should be a mapping of keys to values",
    "too_long": "should have {max_length} values at most",
    "too_short": "should have at least {min_length} values",
    "greater_than": "should be above {gt}",
    "greater_than_equal": "should be at least {ge}",
    "less_than_equal": "should be at most {le}",
    "literal_error": "should be {expected}",
    ADVICE: "{advice}",
}
"""Advice by the type of pydantic's error, with the keys of its context."""
_VARIANT = re.compile(r"^(objects\.[^./]*)/[^.]*")


@contextmanager
def reading(where: str) -> Iterator[None]:
    """Translate ValidationErrors into ScenirisErrors that name `where`."""
    token = where_now.set(where)
    try:
        yield
    except (ValidationError, UnicodeError) as error:
        raise SceneKeyError(_told(error, where)) from None
    finally:
        where_now.reset(token)


def _told(error: ValidationError | UnicodeError, where: str) -> str:
    with suppress(UnicodeError):  # half of a surrogate pair, which pydantic cannot put into an error
        if isinstance(error, ValidationError):
            found: dict[tuple[str, str], list[str]] = {}
            for each in error.errors(include_url=False):
                path = _path(each)
                found.setdefault((_VARIANT.sub(r"\1", path), _sentence(each)), []).append(path)
            # what all variants of an object have alike is told once
            told = (f"{path if len(own) > 1 else own[0]}: {sentence}" for (path, sentence), own in found.items())
            return "\n".join(f"{where}: {line}" for line in told)
    return f"{where}: a name or a value has a character that is not text."


def _path(error: ErrorDetails) -> str:
    match error["loc"]:
        case ("groups", group, "weights" | "splits" as word, member) if str(member).startswith(f"{group}/"):
            return f"objects.{member}.{word.removesuffix('s')}"  # where the weight of a variant is written
    return ".".join(str(key) for key in error["loc"] if not str(key).startswith("[")) or "scene"


def _sentence(error: ErrorDetails) -> str:
    context, kind = error.get("ctx", {}), error["type"]
    if kind == UNKNOWN_KEY:
        key, valid = str(context["key"]), [*context["valid"], *(DRAWN if _VARIANT.match(_path(error)) else ())]
        if key.lower() == "true" and "on" in valid:
            return (
                "this key is the word 'on', which a YAML 1.1 loader reads as true. "
                "Quote it ('on': floor), or let SceneConfig.load read the file."
            )
        return f"unknown key.{did_you_mean(key, valid)} Valid: {', '.join(valid)}."
    if kind == "missing":
        return "is missing."
    advice = _SHOULD[kind].format_map(context) if kind in _SHOULD else f"is wrong: {error['msg']}"
    hint = context.get("hint", "")
    if kind == "literal_error" and isinstance(error["input"], str):
        hint = did_you_mean(error["input"], re.findall(r"'([^']*)'", str(context["expected"])))
    # The first few words of a whole scene help nobody.
    subject = "it" if not error["loc"] and isinstance(error["input"], dict) else short(error["input"])
    return f"{subject} {advice}.{hint}"


def short(value: Any) -> str:
    """Return a value for a message: on one line, cut off after 80 characters."""
    try:
        text = " ".join(repr(value).split())
    except (ValueError, RecursionError):  # an integer of more digits than Python writes, or lists nested too deeply
        text = f"a {type(value).__name__}"
    return text if len(text) <= 80 else text[:77] + "..."
