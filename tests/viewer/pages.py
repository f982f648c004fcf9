"""Pages for the tests of the viewer, on ports that nobody uses."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from sceniris_gym.viewer.server import close_server, open_server

if TYPE_CHECKING:
    import viser


def free_port() -> int:
    """Return a port that nobody listens on."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


@contextmanager
def page() -> Iterator[viser.ViserServer]:
    """Open a page for a while."""
    server = open_server(port=free_port())
    try:
        yield server
    finally:
        close_server(server)


class FakeEvent:
    """An event of a control that a user, not the program, has changed."""

    client = object()

    def __init__(self, target: object) -> None:
        self.target = target


def press(handle: object, value: object) -> None:
    """Change a control as a user does."""
    impl = handle._impl  # type: ignore[attr-defined]
    impl.value = value
    for call in list(impl.update_cb):
        call(FakeEvent(handle))
