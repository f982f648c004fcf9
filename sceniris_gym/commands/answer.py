"""Results of commands: text for stdout, and a verdict."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from sceniris_gym.files import as_json

OK = "ok"
"""Key of the verdict in findings."""


@dataclass(frozen=True)
class Answer:
    """Text for stdout, and the verdict that decides the exit status."""

    text: str
    ok: bool = True


def listing(found: Mapping[str, Any]) -> str:
    """Return findings as text, one per line."""
    return "\n".join(f"{name:<24}{value}" for name, value in found.items())


def answer(found: Mapping[str, Any], json: bool, report: Callable[[Any], str] = listing) -> Answer:
    """Return findings as one line of JSON, or as text from `report`."""
    return Answer(as_json(found) if json else report(found), found.get(OK, True))


def verdict(found: Mapping[str, Any], text: str) -> str:
    """Return the first line of a report: the verdict, then `text`."""
    return f"{'ok' if found[OK] else 'FAIL'}: {text}"
