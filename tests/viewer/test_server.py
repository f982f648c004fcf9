"""The page's server: on this machine alone, quiet, and missing by name where its extra is not installed."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import urllib.request

import pytest

from sceniris_gym.errors import ArgumentError, MissingExtraError
from sceniris_gym.viewer import server as module
from sceniris_gym.viewer.server import address, close_server, import_ahead, open_server
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
def test_an_address_of_another_machine_is_refused():
    """An address at which viser would wait for ever is refused."""
    with pytest.raises(ArgumentError, match=r"--host 192\.0\.2\.1: cannot listen there"):
        open_server("192.0.2.1", free_port())


def test_what_is_missing_is_said_with_its_extra(monkeypatch: pytest.MonkeyPatch):
    """And how to install it."""
    monkeypatch.setattr(module.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"viser is not installed.*sceniris-gym\[viewer\]"):
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
