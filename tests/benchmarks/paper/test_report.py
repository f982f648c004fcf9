"""Files of the suite."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.paper import report
from sceniris_gym.errors import OutputError
from tests.benchmarks.paper.results import FOUND


def test_json_and_picture_are_written(tmp_path: Path):
    """Into a folder that need not be there; the JSON is what `--json` prints."""
    folder = tmp_path / "results"
    report.check(folder)
    report.write(FOUND, folder)
    assert {path.name for path in folder.iterdir()} == {"paper.json", "paper.png"}
    assert json.loads((folder / "paper.json").read_text()) == json.loads(report.as_json(FOUND))


def test_the_text_says_on_what():
    """Device, versions and meshes first, the comparison last."""
    lines = report.as_text(FOUND).splitlines()
    assert lines[0].startswith("2026-11-22, cpu, 2 cores, Python 3.11, warp-lang 1.19.0.")
    assert "apple 17,856" in lines[0]
    assert "Isaac Lab Arena" in lines[-1]


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path):
    """Before anything is measured."""
    (tmp_path / "taken").write_text("")
    with pytest.raises(OutputError):
        report.check(tmp_path / "taken")
