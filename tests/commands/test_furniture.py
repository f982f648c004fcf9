"""The `furniture` command: a folder of units, and numbers that are refused before anything is written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import sceniris_gym
from sceniris_gym import cli


def test_the_command_writes_what_the_function_writes(tmp_path: Path, capsys: pytest.CaptureFixture):
    """And prints the manifest's path and the number of units of each kind."""
    out = str(tmp_path / "units")
    cli.main(["furniture", "--num", "7", "--seed", "3", "--height", "0.85", "--turning", "-o", out, "--json"])
    told = json.loads(capsys.readouterr().out)
    assert told["manifest"] == str(tmp_path / "units" / "manifest.json")
    assert told["units"]["base_drawers"] == 2
    assert sum(told["units"].values()) == 7
    manifest = sceniris_gym.furniture(tmp_path / "same", n=7, seed=3, height=0.85, turning=True)
    assert json.loads((tmp_path / "units" / "manifest.json").read_text()) == json.loads(json.dumps(manifest))
    for path in (tmp_path / "same").glob("*.xml"):
        assert (tmp_path / "units" / path.name).read_bytes() == path.read_bytes()


@pytest.mark.parametrize(("words", "told"), [(["--num", "0"], "--num 0"), (["--height", "2"], "got 2.0")])
def test_numbers_out_of_range_are_refused(words: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture):
    """With the option and its range."""
    with pytest.raises(SystemExit):
        cli.main(["furniture", "-o", str(tmp_path / "units"), *words])
    assert told in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
