"""The controls: what users do becomes a request, what the program shows does not."""

from __future__ import annotations

from typing import Any, cast

import pytest

from sceniris_gym.viewer.deck import Where
from sceniris_gym.viewer.layers import REACH
from sceniris_gym.viewer.panel import Panel
from sceniris_gym.viewer.server import Requests
from tests.viewer.pages import control, page, press, shown, text

pytest.importorskip("mjviser", reason="needs the extra 'viewer'")


class Recorder:
    """Stands in for a page, and keeps what it is asked for."""

    def __init__(self) -> None:
        self.asked: list[tuple] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *values: self.asked.append((name, *values))


def test_users_ask_and_the_program_does_not():
    """A dropdown, a checkbox and a slider of an actuator; values that the program sets ask for nothing."""
    recorder: Any = Recorder()
    requests = Requests()
    with page() as server:
        panel = Panel(server, requests, recorder, 5)
        assert control(server, "worlds").value == "5"
        panel.set_scene(["apple"], [("arm/joint1", -1.0, 1.0)], has_map=True)
        assert not control(server, REACH).disabled
        recorder.where = Where("eval", 2**60, 3)
        panel.set_where(recorder.where, "hash:eval:1:3", ["start", "grasp of apple"])
        panel.set_targets([0.25])
        assert requests.take(0.0) == []
        press(server, "split", "train")
        press(server, "layers of", "apple")
        press(server, "names", True)
        press(server, "joint1", 0.5)
        for action in requests.take(0.0):
            action()
        assert recorder.asked == [
            ("go", Where("train", 2**60, 0)),
            ("show",),
            ("set_target", 0, 0.5),
        ]
        assert (panel.only, panel.layers["names"].value) == ("apple", True)
        assert control(server, "seed").value == str(2**60)
        panel.set_scene(["pear"], [], has_map=False)
        assert panel.only is None
        assert "joint1" not in [getattr(handle, "label", "") for handle in shown(server)]
        assert "The scene has no actuators." in text(server)


def test_messages_are_text_and_not_markup():
    """Names of a scene file may have any characters."""
    with page() as server:
        panel = Panel(server, Requests(), cast(Any, Recorder()), 1)
        panel.say("a <b> & c", bad=True, notices=["<i>"])
        assert "a &lt;b&gt; &amp; c" in text(server)
        assert "&lt;i&gt;" in text(server)
        panel.set_candidates(3, 1, "<why>")
        candidate = control(server, "candidate")
        assert (candidate.max, candidate.value) == (3, 2)
        assert "&lt;why&gt;" in text(server)
