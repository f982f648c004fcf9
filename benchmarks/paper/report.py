"""Report of the suite's results, as text, as JSON and as files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.paper import plot
from benchmarks.paper.comparison import comparison
from benchmarks.paper.rows import as_markdown
from sceniris_gym.files import check_writable, replacing

_JSON, _PNG = "paper.json", "paper.png"


def check(folder: Path) -> None:
    """Make sure that the files can be written, before anything is measured.

    Raises:
        OutputError: They cannot.
        MissingExtraError: The library that draws is not installed.
    """
    plot.check_installed()
    for name in (_JSON, _PNG):
        check_writable(folder / name)


def write(found: Mapping[str, Any], folder: Path) -> None:
    """Write `paper.json` and `paper.png`."""
    with replacing(folder / _JSON) as temporary:
        temporary.write_text(json.dumps(_plain(found), indent=1) + "\n", encoding="utf-8")
    plot.draw(found["rows"], found["device"], folder / _PNG)


def as_json(found: Mapping[str, Any]) -> str:
    """Return all of it as one line."""
    return json.dumps(_plain(found))


def as_text(found: Mapping[str, Any]) -> str:
    """Return a Markdown table for each experiment, below a line about where they were measured, and one of systems."""
    versions = ", ".join(f"{name} {number}" for name, number in found["versions"].items())
    meshes = ", ".join(f"{name} {number:,}" for name, number in found["faces"].items())
    where = f"{found['date']}, {found['device']}, {found['cores']} cores, Python {found['python']}, {versions}."
    what = f"Mid is `mid_16k`, tested by the rendered meshes (faces: {meshes}); {found['seconds']:.0f} s in all."
    compared = comparison(found["rows"], found["device"])
    return f"{where} {what}\n\n{as_markdown(found['rows'])}\n\n**All systems**\n\n{compared}"


def _plain(found: Mapping[str, Any]) -> dict[str, Any]:
    return {**found, "rows": [row.as_json() for row in found["rows"]]}
