"""Skipping of tests that need a GPU, for all tests."""

from __future__ import annotations

import os

import pytest

os.environ["SCENIRIS_GYM_CACHE"] = "off"  # what is tested is how scenes are compiled, not what was kept of them


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip the tests marked `cuda` where Warp finds no GPU, and say so."""
    marked = [item for item in items if item.get_closest_marker("cuda")]
    if not marked:
        return
    import warp as wp

    if wp.get_cuda_device_count() == 0:
        for item in marked:
            item.add_marker(pytest.mark.skip(reason="needs an NVIDIA GPU, and there is none here"))
