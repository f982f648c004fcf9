"""Bars on stderr: one after another, for terminals, and not for what is over at once."""

from __future__ import annotations

import sys
from functools import partial

import pytest
from tqdm import tqdm

from sceniris_gym.commands.bars import shown
from sceniris_gym.progress import tell


def test_a_bar_goes_as_far_as_it_is_told(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch):
    """One for each kind of work."""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("sceniris_gym.commands.bars._SOON", 0.0)
    monkeypatch.setattr("tqdm.tqdm", partial(tqdm, mininterval=0.0))
    with shown():
        for done in (1, 2):
            tell("first", done, 2)
        tell("second", 1, 5)
    said = capsys.readouterr().err
    assert "first: 100%" in said
    assert "second:  20%" in said


def test_bars_are_for_terminals(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch):
    """Neither in a log nor where nobody wants them, nor for work of a moment."""
    with shown():
        tell("work", 1, 2)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with shown(quiet=True):
        tell("work", 1, 2)
    with shown():
        tell("work", 1, 2)
    assert "work" not in capsys.readouterr().err
    monkeypatch.setattr("sceniris_gym.commands.bars._SOON", 0.0)
    with shown():
        tell("work", 1, 2)
    assert "work" in capsys.readouterr().err
