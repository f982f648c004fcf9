"""Fixtures of the tests of scenes: a folder with their assets."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.scene.assets import ARM, BALL, CHEST, OWN, TETRAHEDRON


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the assets of these tests."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "knob.obj").write_text(TETRAHEDRON)
    for name, text in {"chest": CHEST, "ball": BALL, "arm": ARM, "own": OWN}.items():
        (tmp_path / f"{name}.xml").write_text(text)
    return tmp_path
