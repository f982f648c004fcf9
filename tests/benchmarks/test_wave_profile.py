"""Waves are counted while layouts are made."""

from __future__ import annotations

import json

import pytest

from benchmarks import wave_profile


def test_waves_and_rounds_are_counted(capsys: pytest.CaptureFixture[str]):
    """A CPU draws one candidate a row; every world takes three at least, and none is left in the end."""
    wave_profile.main(["mid:100", "--device", "cpu"])
    everything, few = (json.loads(line) for line in capsys.readouterr().out.splitlines()[-2:])
    assert everything["waves"][0] == [100, 100]
    assert few["waves"][0] == [2, 2]
    assert everything["rounds"][-1][1] == few["rounds"][-1][1] == 0
    assert sum(candidates for _, candidates in everything["waves"]) > 3 * 100
    with pytest.raises(SystemExit):
        wave_profile.main(["mid", "--device", "cpu"])
