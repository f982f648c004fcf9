"""Answers of commands: text or JSON, with a verdict."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from sceniris_gym.commands.answer import OK, Answer, answer, listing, verdict


def test_an_answer_has_the_verdict_of_its_findings():
    """As text or as JSON; findings without a verdict are good."""
    assert answer({"a": 1}, json=False) == Answer(f"{'a':<24}1")
    assert answer({OK: False, "a": float("nan")}, json=True) == Answer('{"ok": false, "a": null}', ok=False)
    assert answer({OK: False}, False, lambda found: verdict(found, "no room")) == Answer("FAIL: no room", ok=False)
    assert verdict({OK: True}, "room") == "ok: room"
    assert listing({"a": 1, "b": 2}).count("\n") == 1


def test_lists_and_mappings_are_listed_in_words():
    """Without the brackets and quotes of Python."""
    assert listing({"placed": ["can", "mug"], "faces": {"can": 3}}) == f"{'placed':<24}can, mug\n{'faces':<24}can 3"


@pytest.mark.parametrize("buffered", [True, False])
def test_a_closed_reader_ends_the_program_silently(buffered: bool, tmp_path: Path):
    """As `head` does, which reads a few lines: no traceback, and the status of the verdict."""
    reader, writer = os.pipe()
    os.close(reader)
    words = [sys.executable, "-m", "sceniris_gym", "new-task", "pick_can", "-o", str(tmp_path)]
    environment = {**os.environ, "PYTHONUNBUFFERED": "" if buffered else "1"}
    with os.fdopen(writer) as out:
        done = subprocess.run(words, stdout=out, stderr=subprocess.PIPE, env=environment, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
