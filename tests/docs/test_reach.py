"""The page on reachability."""

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "reach.md"


def test_the_program_on_the_page_runs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture):
    """From the root of the checkout, where its assets are."""
    monkeypatch.chdir(PAGE.parents[1])
    programs = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert len(programs) == 1
    exec(compile(programs[0], str(PAGE), "exec"), {})
    assert re.search(r"^\[[23]\] (True|False)$", capsys.readouterr().out, re.MULTILINE)
