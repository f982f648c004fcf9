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
from typing import Any

import pytest

CACHE = "SCENIRIS_GYM_CACHE"
HERE = Path(__file__).parent
# Tests in these folders check the compiling itself, so they compile every scene anew.
COMPILING = {"collide", "config", "device", "geometry", "grasping", "layout", "placement", "program", "reach", "scene"}

# Processes that tests start hear Ctrl-C, also where a shell runs the tests in the background, with SIGINT ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)

# MuJoCo-Warp asks for MuJoCo's version three times for each model, which parses 8 ms of metadata.
importlib.metadata.version = functools.cache(importlib.metadata.version)

os.environ[CACHE] = "off"  # the cache in the home folder is never used, not even during collection
if "PYTEST_XDIST_WORKER" not in os.environ:
    # The cache of this run, shared by its workers and the processes that tests start.
    SCENES = os.environ["SCENIRIS_GYM_TEST_SCENES"] = tempfile.mkdtemp(prefix="sceniris_gym_scenes_")
    atexit.register(shutil.rmtree, SCENES, ignore_errors=True)


def pytest_configure(config: pytest.Config) -> None:
    """Give each worker one OpenMP thread: more threads than cores mostly wait for each other."""
    if config.getoption("numprocesses", None):
        os.environ.setdefault("OMP_NUM_THREADS", "1")


def pytest_collection_finish() -> None:
    """Collect garbage less often, and skip the million imported objects that live until the end."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(5_000)


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Tell the seconds that each folder of tests took, where durations are asked for: a folder that grows is seen."""
    if terminalreporter.config.option.durations is None:
        return
    seconds: Counter[str] = Counter()
    for reports in terminalreporter.stats.values():
        for report in reports:
            if hasattr(report, "duration"):
                seconds[report.nodeid.split("::")[0].rpartition("/")[0]] += report.duration
    terminalreporter.write_sep("=", "seconds by folder")
    for folder, duration in seconds.most_common():
        terminalreporter.write_line(f"{duration:7.1f} {folder}")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Share compiled scenes between tests, except where a test checks the compiling."""
    compiling = item.path.relative_to(HERE).parts[0] in COMPILING
    os.environ[CACHE] = "off" if compiling else os.environ["SCENIRIS_GYM_TEST_SCENES"]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip the tests marked `cuda` where Warp finds no GPU, and say so."""
    marked = [item for item in items if item.get_closest_marker("cuda")]
    if not marked:
        return
    import warp as wp

    if wp.get_cuda_device_count() == 0:
        for item in marked:
            item.add_marker(pytest.mark.skip(reason="needs an NVIDIA GPU, and there is none here"))
