"""Pages for the tests of the viewer, on ports that nobody uses, and what they show."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

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


def shown(server: viser.ViserServer) -> list[Any]:
    """Return the texts, controls, charts and folders of a page, from top to bottom."""
    return list(_inside(server.gui._container_handle_from_uuid["root"]))


def text(server: viser.ViserServer) -> str:
    """Return all texts of a page, as markup."""
    return "\n".join(handle.content for handle in shown(server) if hasattr(handle, "content") and handle.visible)


def control(server: viser.ViserServer, label: str) -> Any:
    """Return the control or the folder with a label."""
    (found,) = (handle for handle in shown(server) if getattr(handle, "label", None) == label)
    return found


def chart(server: viser.ViserServer, title: str) -> Any:
    """Return the chart below a title, None as long as there is none."""
    return next((handle for handle in _inside(control(server, title)) if hasattr(handle, "series")), None)


def lines(server: viser.ViserServer, title: str) -> dict[str, np.ndarray]:
    """Return the lines of the chart below a title by their labels; `step` is what is below them."""
    drawn = chart(server, title)
    return {one["label"]: data for one, data in zip(drawn.series, drawn.data, strict=True)}


def drawn_body(server: viser.ViserServer, name: str) -> Any:
    """Return the first of the meshes that are drawn of a body, once for each world."""
    meshes = (server.scene.get_handle_by_name(f"/bodies/{name}/group{i}") for i in range(mujoco.mjNGROUP))
    return next(mesh for mesh in meshes if mesh is not None)


def press(server: viser.ViserServer, label: str, value: object) -> None:
    """Change a control as a user does."""
    _use(control(server, label), value)


def click(server: viser.ViserServer, name: str) -> None:
    """Click a button, or one of a group."""
    groups = (handle for handle in shown(server) if name in getattr(handle, "options", ()))
    _use(next(groups, None) or control(server, name), name)


def _inside(container: Any) -> Iterator[Any]:
    """Yield what viser keeps inside of a folder, a tab or a group of tabs, and inside of that."""
    for handle in [*getattr(container, "_children", {}).values(), *getattr(container, "_tab_handles", ())]:
        yield handle
        yield from _inside(handle)


def _use(handle: Any, value: object) -> None:
    """Do what viser does when a browser sends a value."""
    handle._impl.value = value
    for call in list(handle._impl.update_cb):
        call(FakeEvent(handle))
