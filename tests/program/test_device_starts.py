"""Device code's view of starts: every field is filled, and it survives the file of a compiled scene."""

from __future__ import annotations

import numpy as np
import warp as wp

from sceniris_gym.program.archive import from_arrays, to_arrays
from sceniris_gym.program.device_starts import Starts
from tests.layout.starting import starting


def test_starts_are_kept_with_a_compiled_scene():
    """All fields are the same after a round trip."""
    compiled = starting()
    again = from_arrays(compiled.scene, "cpu", to_arrays(compiled)).starts
    assert compiled.starts is not None
    assert again is not None
    for name in Starts.vars:
        field, other = getattr(compiled.starts, name), getattr(again, name)
        assert isinstance(field, wp.array)
        np.testing.assert_array_equal(field.numpy(), other.numpy())
