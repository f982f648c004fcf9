"""The page's server: on this machine alone, quiet, and missing by name where its extra is not installed."""

from __future__ import annotations

import importlib.util
import socket
import subprocess
import sys
import threading
import time
import urllib.request

import pytest

from sceniris_gym.errors import ArgumentError, MissingExtraError
from sceniris_gym.viewer import server as module
from sceniris_gym.viewer.server import Requests, address, close_server, import_ahead, open_server, refusal
from tests.viewer.pages import free_port

VISER = pytest.mark.skipif(importlib.util.find_spec("mjviser") is None, reason="needs the extra 'viewer'")


@VISER
def test_the_page_answers_on_this_machine_and_nothing_is_printed(capfd: pytest.CaptureFixture):
    """A second page takes the next port, where the first one is in use."""
    port = free_port()
    first, second = open_server(port=port), open_server(port=port)
    try:
        assert address(first) == f"http://127.0.0.1:{port}"
        assert address(second) != address(first)
        assert b"<html" in urllib.request.urlopen(address(first), timeout=20).read()
    finally:
        close_server(first)
        close_server(second)
    assert capfd.readouterr().out == ""


@VISER
def test_every_address_is_said_as_one_that_a_browser_takes():
    """0.0.0.0 is no place to go to."""
    server = open_server("0.0.0.0", free_port())
    try:
        assert address(server).startswith("http://localhost:")
    finally:
        close_server(server)


@VISER
def test_other_sites_do_not_reach_the_page():
    """By a name that leads here, or from a browser that is on this machine: neither the page nor its socket."""
    port = free_port()
    server = open_server(port=port, origins=["https://hub.example.org"])
    sub = f"Sec-WebSocket-Protocol: viser-v{importlib.import_module('viser').__version__}"
    shake = f"Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {22 * 'A'}==\r\n{sub}\r\n"

    def status(host: str, more: str, connection: str) -> str:
        with socket.create_connection(("127.0.0.1", port), 20) as asked:
            asked.sendall(f"GET / HTTP/1.1\r\nHost: {host}\r\nConnection: {connection}\r\n{more}\r\n".encode())
            return asked.recv(12).decode().split()[1]

    try:
        for host, origin, answer in (
            (f"127.0.0.1:{port}", "", "200"),
            ("localhost:9", "http://localhost:8888", "200"),
            ("hub.example.org", "https://hub.example.org", "200"),
            (f"site.example:{port}", "", "403"),
            (f"localhost:{port}", "http://site.example", "403"),
            ("[", "", "403"),
            ("localhost", "http://[", "403"),
            ("localhost\r\nHost: localhost", "", "403"),
            ("localhost", "http://localhost\r\nOrigin: http://localhost", "403"),
        ):
            origin = origin and f"Origin: {origin}\r\n"
            assert status(host, origin, "close") == answer
            assert status(host, origin + shake, "Upgrade") == answer.replace("200", "101")
    finally:
        close_server(server)


@pytest.mark.parametrize(
    ("host", "asked", "origin", "fits"),
    [
        ("127.0.0.1", "[::1]:8080", "http://127.9.9.9", True),
        ("127.0.0.1", "a.localhost:1", None, True),
        ("127.0.0.1", "127.0.0.1.example", None, False),
        ("127.0.0.1", "notlocalhost", None, False),
        ("127.0.0.1", "localhost", "null", False),
        ("127.0.0.1", "localhost", "file://", False),
        ("127.0.0.1", "localhost#.site.example", None, False),
        ("127.0.0.1", "localhost/.site.example", None, False),
        ("127.0.0.1", "localhost?.site.example", None, False),
        ("127.0.0.1", "localhost", "http://site.example@localhost", False),
        ("127.0.0.1", "192.168.0.7:8080", None, False),
        ("127.0.0.1", "", None, False),
        ("0.0.0.0", "192.168.0.7:8080", "http://192.168.0.7:8080", True),
        ("0.0.0.0", "192.168.0.7:8080", "http://192.168.0.8:8080", False),
        ("0.0.0.0", "box:8080", None, False),
        ("box", "BOX:8080", "http://box:8080", True),
        ("box", "box:8080", "http://box:9090", False),
        ("box", "localhost", "https://Hub.example.org", True),
        ("127.0.0.1", "hub.example.org", None, True),
        ("127.0.0.1", "localhost", "https://hub.example.org.site.example", False),
    ],
)
def test_a_request_is_judged_by_its_name_and_its_site(host: str, asked: str, origin: str | None, fits: bool):
    """Names of this machine at any port, numbers where others may come in, and what was named; refused with the way."""
    headers = {"Host": asked} | ({} if origin is None else {"Origin": origin})
    why = refusal(headers, host, ["https://hub.example.org/", ""])
    assert (why is None) == fits
    assert why is None or "--allow-origin" in why


@VISER
def test_an_address_of_another_machine_is_refused():
    """An address at which viser would wait for ever is refused."""
    with pytest.raises(ArgumentError, match=r"--host 192\.0\.2\.1: cannot listen there"):
        open_server("192.0.2.1", free_port())


def test_what_is_missing_is_said_with_its_extra(monkeypatch: pytest.MonkeyPatch):
    """And how to install it."""
    monkeypatch.setattr(module.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"viser is not installed.*\.\[viewer\]"):
        open_server()


def test_the_server_imports_nothing_heavy():
    """Neither what makes layouts nor what draws them, before the address is there."""
    code = "import sys, sceniris_gym.viewer.server; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"torch", "warp", "mujoco", "mujoco_warp", "trimesh", "scipy", "viser", "mjviser"} & set(loaded)


@VISER
def test_what_draws_is_imported_beside():
    """In a thread of its own."""
    import_ahead().join()
    assert "mjviser" in sys.modules


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
