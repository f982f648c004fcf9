"""Answers of commands: text or JSON, with a verdict."""

from __future__ import annotations

from sceniris_gym.commands.answer import OK, Answer, answer, listing, verdict


def test_an_answer_has_the_verdict_of_its_findings():
    """As text or as JSON; findings without a verdict are good."""
    assert answer({"a": 1}, json=False) == Answer(f"{'a':<24}1")
    assert answer({OK: False, "a": float("nan")}, json=True) == Answer('{"ok": false, "a": null}', ok=False)
    assert answer({OK: False}, False, lambda found: verdict(found, "no room")) == Answer("FAIL: no room", ok=False)
    assert verdict({OK: True}, "room") == "ok: room"
    assert listing({"a": 1, "b": 2}).count("\n") == 1
