"""Cold starts: in processes of their own, with caches of their own."""

from __future__ import annotations

import io
import json
import shutil
import sys
from pathlib import Path

import pytest

from benchmarks.paper import cold as module
from benchmarks.paper.cold import cold
from benchmarks.paper.scenes import PHYSICS


def test_a_fresh_process_makes_layouts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Its parts take no longer than all of it. With the kernels of this machine, since compiling takes a while."""
    monkeypatch.setattr(module, "_CACHES", ())
    found = cold(PHYSICS, 8, "cpu", tmp_path)
    assert found["valid"] == 1.0
    assert found["peak_bytes"] > 5e7
    assert 0.0 < found["imports_s"] + found["compile_s"] + found["generate_s"] < found["cold_s"]


def test_a_process_that_fails_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """With the scene and the status; here the process is one that only fails."""
    monkeypatch.setattr(module.sys, "executable", shutil.which("false"))
    with pytest.raises(RuntimeError, match="'nowhere' ended with 1"):
        cold(("nowhere", {}), 8, "cpu", tmp_path)


def test_caches_are_those_of_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """All of them, so that nothing that an earlier start has left is found in an empty folder."""
    seen = {}

    class Process:
        returncode = 0

        def __init__(self, command: list[str], env: dict[str, str], **_: object) -> None:
            seen.update(env, command=command)
            self.stdout = io.StringIO(f"a word of a library\n{module._DONE}{json.dumps({'valid': 1.0})}\n")

        def __enter__(self) -> Process:
            return self

        def __exit__(self, *_: object) -> None:
            pass

    monkeypatch.setattr(module.subprocess, "Popen", Process)
    assert cold(PHYSICS, 8, "cpu", tmp_path)["valid"] == 1.0
    assert seen["command"][:1] == [sys.executable]
    for name in ("WARP_CACHE_PATH", "CUDA_CACHE_PATH", "XDG_CACHE_HOME"):
        assert Path(seen[name]).is_relative_to(tmp_path)
