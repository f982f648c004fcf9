"""The program of the suite: its options reach the suite, and its rows the files and stdout."""

from __future__ import annotations

import json
import runpy
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from PIL import Image

from benchmarks.paper import __main__ as module
from benchmarks.paper import suite
from benchmarks.paper.__main__ import main
from tests.benchmarks.paper.results import FOUND


def test_the_suite_writes_its_rows(capsys: pytest.CaptureFixture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """With its peers and files; rows are told on stderr, stdout is one line of JSON."""
    asked = []

    def run(device: str, quick: bool, peers: tuple[str, ...], tell: Callable) -> dict:
        asked.extend((device, quick, peers))
        tell(FOUND["rows"][0])
        return FOUND

    monkeypatch.setattr(suite, "run", run)
    main("cpu", True, ("uniform", "scene_synthesizer"), tmp_path, json=True)
    found = json.loads(capsys.readouterr().out)
    assert asked == ["cpu", True, ("uniform", "scene_synthesizer")]
    assert [row["worlds"] for row in found["rows"]] == [1024, 0]
    assert json.loads((tmp_path / "paper.json").read_text()) == found
    assert Image.open(tmp_path / "paper.png").size[0] > 1000


def test_an_error_ends_the_program_with_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A folder that cannot be made: its exit has the message, which Python writes to stderr with a status of 1."""
    (tmp_path / "file").touch()
    monkeypatch.setattr(sys, "argv", ["benchmarks.paper", "--quick", "-o", str(tmp_path / "file")])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(module.__file__), run_name="__main__")
    said = str(ended.value.code)
    assert said.startswith(f"benchmarks.paper: {tmp_path}/file/paper.json cannot be written: ")
    assert "\n" not in said
