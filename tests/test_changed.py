"""The tests that a change is checked with."""

from __future__ import annotations

from tests.changed import ALWAYS, touching
from tests.sources import ROOT


def test_a_change_is_tested_where_its_module_is_imported():
    """By its own tests, by those that import it, and by those of a folder in which anything else changed."""
    tests = sorted((ROOT / "tests").rglob("test_*.py"))
    found = set(touching(["sceniris_gym/device/transforms.py"], tests))
    assert {"tests/device/test_transforms.py", *ALWAYS} <= found
    assert "tests/config/test_loader.py" not in found
    assert "tests/test_kernels.py" in touching(["tests/kernel_accesses.py"], tests)
    assert "tests/docs/test_words.py" in touching(["docs/index.md"], tests)
    assert set(touching([], tests)) == ALWAYS
