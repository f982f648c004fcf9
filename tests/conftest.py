"""Skipping of tests that need a GPU, and signals, threads, garbage collection and compiled scenes of all processes."""

from __future__ import annotations

import atexit
import functools
import gc
import importlib.metadata
import os
import shutil
import signal
import tempfile
from collections import Counter
from pathlib import Path

import pytest

CACHE = "SCENIRIS_GYM_CACHE"
HERE = Path(__file__).parent
# Tests in these folders and files check the compiling itself, so they compile every scene anew.
COMPILING = {"collide", "config", "device", "geometry", "grasping", "program", "reach", "scene"} | {
    f"layout/test_{name}.py" for name in ("blame", "compile", "scene_cache")
}
# The first worker begins with a file that needs nearly all kernels. The second begins with files that need none of
# those, for as long as the first compiles: two workers that need a module at the same time both compile it.
FIRST = [
    "test_examples.py",
    "importers/things/test_convex_parts.py",
    "importers/things/test_importer.py",
    "importers/things/test_folder.py",
    "assets/test_assets.py",
    "assets/test_fit.py",
    "assets/test_grasps.py",
    "geometry/test_colliders.py",
    "geometry/test_resting_poses.py",
    "reach/test_build.py",
    "reach/test_measures.py",
]

# Processes that tests start hear Ctrl-C, also where a shell runs the tests in the background, with SIGINT ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)

# MuJoCo-Warp asks for MuJoCo's version three times for each model, which parses 8 ms of metadata.
importlib.metadata.version = functools.cache(importlib.metadata.version)

# JAX would take three quarters of a GPU's memory from the tests of all other workers.
os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
os.environ[CACHE] = "off"  # the cache in the home folder is never used, not even during collection
if "PYTEST_XDIST_WORKER" not in os.environ:
    # The cache of this run, shared by its workers and the processes that tests start.
    SCENES = os.environ["SCENIRIS_GYM_TEST_SCENES"] = tempfile.mkdtemp(prefix="sceniris_gym_scenes_")
    atexit.register(shutil.rmtree, SCENES, ignore_errors=True)


def pytest_configure(config: pytest.Config) -> None:
    """Give each worker one OpenMP thread, as more mostly wait for each other, and files in the order of this file."""
    if config.getoption("markexpr") == "oldest":  # nearly all of their time is compiling, and bits are the same
        import warp

        warp.config.optimization_level = 0
    if config.getoption("numprocesses", None):
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        config.option.loadscopereorder = False
    if os.environ.get("PYTEST_XDIST_WORKER") == "gw1" and config.args == config.getini("testpaths"):
        # Of files without a cache, each of two workers then compiles half: they begin at different ends.
        found = [path for path in HERE.iterdir() if path.is_dir() or path.name.startswith("test_")]
        config.args = [str(path) for path in sorted(found, reverse=True)]


def pytest_collectstart() -> None:
    """Collect no garbage while files are imported, nearly all of which live until the end."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Collect garbage again, but less often, and skip the million imported objects that live until the end."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(5_000)
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Share compiled scenes between tests, except where a test checks the compiling."""
    path = item.path.relative_to(HERE)
    compiling = {path.parts[0], path.as_posix()} & COMPILING
    os.environ[CACHE] = "off" if compiling else os.environ["SCENIRIS_GYM_TEST_SCENES"]


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Record launch sequences into graphs at their first replay, also on a CPU."""
    from sceniris_gym.device import sequence

    monkeypatch.setattr(sequence, "_DIRECT_ON_CPU", 0)


def order_files(items: list[pytest.Item]) -> None:
    """Put first the files named above, then those with slow tests: short files at the end let workers end together."""
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    tests = Counter(item.path for item in items)
    first = {HERE / name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda i: (first.get(i.path, len(first)), -slow[i.path], -tests[i.path], i.path))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Print the seconds and the number of tests of each folder, where the longest tests are asked for."""
    if config.getoption("durations") is None:
        return
    seconds, tests = Counter[str](), Counter[str]()
    for report in (r for found in terminalreporter.stats.values() for r in found if hasattr(r, "duration")):
        parts = Path(report.nodeid.partition("::")[0]).parts
        folder = "/".join(parts[1:2] if len(parts) > 2 else parts[:1])
        seconds[folder] += report.duration
        tests[folder] += report.when == "call"
    terminalreporter.section("seconds by folder")
    for folder, spent in seconds.most_common():
        terminalreporter.write_line(f"{spent:7.1f} s  {tests[folder]:5d} tests  {folder}")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest files where there are workers; skip the tests marked `cuda` where Warp finds no GPU."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        order_files(items)
    marked = [item for item in items if item.get_closest_marker("cuda")]
    if not marked:
        return
    import warp as wp

    if wp.get_cuda_device_count() == 0:
        for item in marked:
            item.add_marker(pytest.mark.skip(reason="needs an NVIDIA GPU, and there is none here"))
