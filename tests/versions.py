"""Tests of what MuJoCo does in its newer versions alone."""

from __future__ import annotations

import mujoco
import pytest

OLDEST = mujoco.__version__ == "3.11.0"
OLD = int(mujoco.__version__.split(".")[0]) < 4


def since_4(reason: str) -> pytest.MarkDecorator:
    """Return a mark that skips a test with MuJoCo before 4.0, for a reason that says what is different there."""
    return pytest.mark.skipif(OLD, reason=f"MuJoCo before 4.0: {reason}")


def since_3_12(reason: str) -> pytest.MarkDecorator:
    """Return a mark that skips a test with MuJoCo 3.11, for a reason that says what is different there."""
    return pytest.mark.skipif(OLDEST, reason=f"MuJoCo 3.11: {reason}")
