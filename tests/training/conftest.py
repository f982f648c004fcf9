"""A scene for tests of training."""

from __future__ import annotations

import pytest

from sceniris_gym.program.compiled import CompiledScene
from tests.training.scenes import reach_scene


@pytest.fixture
def compiled() -> CompiledScene:
    """Return the CompiledScene of TabletopReach-v0."""
    return reach_scene()
