"""Progress of long work: listeners hear it, each their own; terminals get bars."""

from __future__ import annotations

import sys
import time
from functools import partial

import pytest
from tqdm import tqdm

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.progress import listening, shown, tell


def test_only_who_listens_hears():
    """Within the block, the innermost listener; afterwards nobody."""
    heard: list[tuple] = []
    inner: list[tuple] = []
    tell("nobody", 1, 2)
    with listening(lambda *words: heard.append(words)):
        tell("a", 1, 2)
        with listening(lambda *words: inner.append(words)):
            tell("b", 1, 1)
        tell("a", 2, 2)
    tell("nobody", 2, 2)
    assert (heard, inner) == ([("a", 1, 2), ("a", 2, 2)], [("b", 1, 1)])


def test_compiling_a_scene_tells_how_far_it_is():
    """Every kind of work to its end, in the order of the work."""
    heard: list[tuple] = []
    with listening(lambda *words: heard.append(words)):
        compile_scene("mid", "cpu", cache=False)
    works = ["objects", "placed objects", "pairs", "train bank", "eval bank"]
    assert list(dict.fromkeys(what for what, _, _ in heard)) == works
    for what, done, total in heard:
        assert 0 < done <= total
        assert (what, total, total) in heard


def test_a_bar_goes_as_far_as_it_is_told(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch):
    """One for each kind of work."""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("sceniris_gym.progress._SOON", 0.0)
    monkeypatch.setattr("tqdm.tqdm", partial(tqdm, mininterval=0.0))
    with shown():
        for done in (1, 2):
            tell("first", done, 2)
        tell("second", 1, 5)
    said = capsys.readouterr().err
    assert "first: 100%" in said
    assert "| 1/2 [" in said  # whole parts
    assert "second:  20%" in said


def test_bars_are_for_terminals(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch):
    """Neither in a log nor where nobody wants them, nor for work of a moment."""
    with shown():
        tell("work", 1, 2)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with shown(quiet=True), shown():  # as for kernels, which a command with --json compiles
        tell("work", 0, 2)
    with shown():
        tell("work", 1, 2)
    assert "work" not in capsys.readouterr().err
    with shown():
        tell("work", 0, 2)  # may be long
    assert "work" in capsys.readouterr().err
    monkeypatch.setattr("sceniris_gym.progress._SOON", 0.0)
    with shown():
        tell("work", 1, 2)
    assert "work" in capsys.readouterr().err


def test_a_log_gets_a_line_after_some_seconds(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch):
    """A line every few seconds, and rarer the longer the same work takes."""
    now = 0.0
    monkeypatch.setattr(time, "monotonic", lambda: now)
    times = {"first": [], "second": []}
    with shown():
        for what, seconds in (("first", 600), ("second", 10)):
            for done in range(seconds):
                now += 1.0
                tell(what, done, seconds)
                times[what] += [now] * len(lines := capsys.readouterr().err.splitlines())
                assert lines in ([], [f"sceniris_gym: {what}: {done} of {seconds}"])
    assert times["first"][:4] == [4.0, 8.0, 12.0, 16.0]
    assert times["first"][-1] - times["first"][-2] > 50.0
    assert len(times["first"]) < 40
    assert times["second"] == [603.0, 607.0]
