"""Starts the server of the viewer's page. It starts before slow imports, so that the page opens at once."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import socket
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NoReturn
from urllib.parse import urlsplit

import numpy as np

from sceniris_gym.collecting import uncollected
from sceniris_gym.errors import ArgumentError, MissingExtraError
from sceniris_gym.files import redirected

if TYPE_CHECKING:
    import viser


HOST = "127.0.0.1"
"""The default address, which only this machine can reach."""
PORT = 8080
"""The default port."""
MOST_SHOWN = 64
"""Greatest number of worlds side by side."""

_BACKGROUND = (238, 241, 245)
# One lamp for each side, and no environment map, which takes seconds without a GPU. Objects without a texture arrive at
# the page as metal, which only lamps light.
_LAMPS = (
    ("front", 2.4, (-1.0, -1.5, 3.0)),
    ("right", 1.6, (2.0, -0.6, 1.2)),
    ("back", 1.2, (-0.5, 2.0, 1.2)),
    ("below", 0.6, (0.2, -0.3, -1.0)),
)
_EVERYWHERE = ("0.0.0.0", "::")


def open_server(host: str = HOST, port: int = PORT, origins: Sequence[str] = ()) -> viser.ViserServer:
    """Start a server with an empty page. It only accepts requests to its addresses, and not from other web sites.

    Args:
        host: Address to listen on. With "0.0.0.0", all machines can reach the page.
        port: Port to listen on. If it is taken, the next free port is used.
        origins: Further addresses at which browsers may open the page, such as "https://hub.example.org".

    Raises:
        MissingExtraError: viser or mjviser is not installed.
        ArgumentError: `host` is not an address of this machine.
    """
    for package in ("viser", "mjviser"):
        if importlib.util.find_spec(package) is None:
            raise MissingExtraError(package, "viewer")
    _check_host(host)
    with uncollected():
        import viser
    with contextlib.redirect_stdout(io.StringIO()), _refusing(host, origins):  # viser prints banners
        server = viser.ViserServer(host=host, port=port, label="sceniris_gym", verbose=False)
    server.gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    light(server)  # before the page draws, so that it never shows the shadows of viser's default lights
    return server


def show_page(
    make: Callable[[viser.ViserServer], Any], name: str, host: str, port: int, origins: Sequence[str] = ()
) -> NoReturn:
    """Open a page, and show the view that `make` returns for it until Ctrl-C. Output of libraries goes to stderr.

    `name` is the name of the scene or task. The other arguments are as in `open_server`.
    """
    server = open_server(host, port, origins)
    try:
        print(address(server), flush=True)  # before any slow work
        if server.get_port() != port:
            print(f"Port {port} is in use, so the page is at port {server.get_port()}.", file=sys.stderr, flush=True)
        print(f"Open the page in a browser to see '{name}'. Ctrl-C closes the page.", file=sys.stderr, flush=True)
        with redirected(1, 2):
            view = make(server)
            while True:
                view.tick()
    finally:
        close_server(server)


def _check_host(host: str) -> None:
    """Reject a host that is not an address of this machine. With such a host, viser would never start."""
    try:
        family, kind, *_, at = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.bind(at)
    except OSError as error:
        raise ArgumentError(f"--host {host}: cannot listen there: {error}. Give an address of this machine.") from None


def refusal(headers: Mapping[str, str], host: str, origins: Sequence[str]) -> str | None:
    """Return why a request is rejected, or None if it is accepted.

    This protects users who visit a harmful web site. From the user's browser, such a site may send requests to this
    page, also under a domain name that resolves to this machine. The browser's headers show both: `Origin` is the
    site, and `Host` is the name in the request. If other machines can reach the page, numeric addresses of this
    machine are accepted too, because no site has such an address as its name.

    Args:
        headers: The headers of the request.
        host: The address of the listening socket.
        origins: Further addresses at which browsers may open the page.
    """
    try:
        asked = headers.get("Host", "").lower()
        urls = [f"http://{asked}", headers.get("Origin", f"http://{asked}").lower()]
        sites = [urlsplit(url) for url in urls]
    except (ValueError, LookupError) as error:  # a LookupError means several such headers
        return f"'Host' and 'Origin' should be one address each: {error}."
    named = {origin.lower().rpartition("//")[2].rstrip("/") for origin in origins} - {""}
    for url, site in zip(urls, sites, strict=True):
        name = site.hostname or ""
        own = name == host.lower() or (_is_numeric(name) and not _is_loopback(host))
        fits = _is_loopback(name) or site.netloc in named or (own and site.netloc == asked)
        if not fits or "@" in url or url != f"{site.scheme}://{site.netloc}":
            return f"'{url}' is not an address of this page. To allow it, start the page with --allow-origin {url}."
    return None


def _is_numeric(name: str) -> bool:
    return ":" in name or name.replace(".", "").isdecimal()


def _is_loopback(name: str) -> bool:
    return name == "::1" or (name.startswith("127.") and _is_numeric(name)) or f".{name}".endswith(".localhost")


@contextlib.contextmanager
def _refusing(host: str, origins: Sequence[str]) -> Iterator[None]:
    """Within this context, servers that viser starts answer 403 (forbidden) to the requests that `refusal` rejects."""
    from websockets.asyncio import server

    serve = server.serve

    def guarded(*args: Any, process_request: Callable[..., Any], **kwargs: Any) -> Any:
        def answer(connection: Any, request: Any) -> Any:
            why = refusal(request.headers, host, origins)
            return process_request(connection, request) if why is None else connection.respond(403, why)

        return serve(*args, process_request=answer, **kwargs)

    server.serve = guarded  # pyrefly: ignore[bad-assignment]
    try:
        yield
    finally:
        server.serve = serve


def light(server: viser.ViserServer) -> None:
    """Give the page a pale background and four lamps. The strongest lamp is at the front left."""
    scene = server.scene
    scene.configure_environment_map(None)
    scene.configure_default_lights(enabled=False)
    for name, intensity, position in _LAMPS:
        scene.add_light_directional(f"/{name}", intensity=intensity, position=position)
    scene.set_background_image(np.full((2, 2, 3), _BACKGROUND, np.uint8), format="png")


def close_server(server: viser.ViserServer) -> None:
    """Stop the server of a page."""
    with contextlib.redirect_stdout(io.StringIO()):  # viser prints banners
        server.stop()


def address(server: viser.ViserServer) -> str:
    """Return the URL of the page."""
    host = server.get_host()
    return f"http://{'localhost' if host in _EVERYWHERE else host}:{server.get_port()}"


def import_ahead() -> threading.Thread:
    """Start to import mjviser in a thread, and return the thread. The import takes a second."""
    thread = threading.Thread(target=importlib.import_module, args=("mjviser",), daemon=True)
    thread.start()
    return thread


class Requests:
    """A queue of the user's requests, which keeps only the latest request about each subject.

    So a user who drags a slider does not fill the queue.
    """

    def __init__(self) -> None:
        self._waiting: dict[object, Callable[[], None]] = {}
        self._new = threading.Condition()

    def put(self, about: str | None, action: Callable[[], None]) -> None:
        """Add a request.

        Args:
            about: The subject. The request replaces a waiting request about the same subject. If None, no request is
                replaced.
            action: The work to do.
        """
        key = object() if about is None else about
        with self._new:
            self._waiting.pop(key, None)
            self._waiting[key] = action
            self._new.notify()

    def put_changes(self, handle: Any, about: str, action: Callable[[Any], None]) -> Any:
        """Watch a control: whenever a user changes its value, add a request. Changes by the program are ignored.

        Args:
            handle: The control. It is returned.
            about: The subject of the requests.
            action: The work to do. It gets the new value of the control.
        """

        @handle.on_update
        def _(event: Any) -> None:
            if event.client is not None:
                self.put(about, partial(action, event.target.value))

        return handle

    def put_moves(self, gui: viser.GuiApi, name: str, move: Callable[[int], None]) -> None:
        """Add two buttons to the page, which decrease and increase a value by 1.

        Args:
            gui: The controls of the page.
            name: Name of the value, which is written on the buttons.
            move: The work to do. It gets -1 or 1.
        """
        steps = {f"◀ {name}": -1, f"{name} ▶": 1}
        arrows = gui.add_button_group(" ", tuple(steps))
        arrows.on_click(lambda event: self.put(None, partial(move, steps[event.target.value])))

    def take(self, seconds: float) -> list[Callable[[], None]]:
        """Return the waiting requests in order. If the queue is empty, wait up to `seconds` [s] for a request."""
        with self._new:
            self._new.wait_for(lambda: self._waiting, seconds)
            taken, self._waiting = self._waiting, {}
        return list(taken.values())
