"""Fixtures of the tests of programs: a folder with their assets, and a cube to reach for."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.layout.scenes import box_mjcf
from tests.program.scenes import BOX, GADGET


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the assets of these tests."""
    (tmp_path / "box.xml").write_text(BOX)
    (tmp_path / "gadget.xml").write_text(GADGET)
    return tmp_path


@pytest.fixture
def cube(folder: Path) -> str:
    """A cube of 4 cm, which is taken at half its height."""
    return box_mjcf(folder, "cube", 0.04, 0.04, 0.04)
