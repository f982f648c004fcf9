"""Fixture of the tests of programs: a folder with their assets."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.program.scenes import BOX, GADGET


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the assets of these tests."""
    (tmp_path / "box.xml").write_text(BOX)
    (tmp_path / "gadget.xml").write_text(GADGET)
    return tmp_path
