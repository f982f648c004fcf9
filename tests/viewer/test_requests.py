"""Requests: the latest about each thing, in order."""

from __future__ import annotations

import threading
import time

from sceniris_gym.viewer.requests import Requests


def test_of_one_thing_the_latest_is_done_and_clicks_are_all_done():
    """A slider that is dragged leaves one request; what is about nothing is kept as often as it was asked for."""
    done: list[str] = []
    requests = Requests()
    for i in range(3):
        requests.put("slider", lambda i=i: done.append(f"slider {i}"))
        requests.put(None, lambda i=i: done.append(f"click {i}"))
    for action in requests.take(0.0):
        action()
    assert done == ["click 0", "click 1", "slider 2", "click 2"]
    assert requests.take(0.0) == []


def test_waiting_ends_with_the_first_request():
    """Long before the time that one is willing to wait."""
    requests = Requests()
    threading.Timer(0.05, lambda: requests.put("a", lambda: None)).start()
    began = time.monotonic()
    assert len(requests.take(30.0)) == 1
    assert time.monotonic() - began < 20.0
