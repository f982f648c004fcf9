"""Requests of a task that the worlds refuse; writers, fields and numbers have files of their own."""

from __future__ import annotations

import pytest
import torch

from sceniris_gym.errors import UnknownNameError
from sceniris_gym.sim.versions import SLEEPING
from tests.vector.conftest import SCENE
from tests.vector.workshop import state_of


@pytest.mark.skipif(not SLEEPING, reason="bodies sleep since MuJoCo 4")
def test_what_cannot_sleep_is_told_by_the_method_that_was_called():
    """Once it was said to have no velocity."""
    s = state_of({"model": SCENE["model"]})
    s._batch.model.opt.enableflags |= SLEEPING["enableflags"]
    with pytest.raises(UnknownNameError, match=r"State.sleep: unknown free object 'cabinet'. Valid: block"):
        s.sleep(("cabinet",), torch.ones(2, dtype=torch.bool))
