"""The command that judges presence in many layouts."""

from __future__ import annotations

import json

import pytest

from tests.stress import presence


def test_a_line_for_each_form(capsys: pytest.CaptureFixture[str]):
    """Two forms, without a fault."""
    assert presence.main(["--layouts", "300", "--forms", "conditions", "towers"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines() if line.startswith("{")]
    assert [line["form"] for line in lines] == ["conditions", "towers"]
    assert all(line["layouts"] == 300 and line["faults"] == 0 and line["p"] > 0.001 for line in lines)
