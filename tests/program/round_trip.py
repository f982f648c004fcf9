"""A compiled scene as arrays and back."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.layout.scene_cache import from_arrays, to_arrays
from sceniris_gym.program.compiled import CompiledScene


def assert_comes_back(compiled: CompiledScene, part: str, struct: Any) -> None:
    """Check that all fields of a struct of a compiled scene are the same after a round trip."""
    own, again = getattr(compiled, part), getattr(from_arrays(compiled.scene, "cpu", to_arrays(compiled)), part)
    assert own is not None
    assert again is not None
    for name in struct.vars:
        field, other = getattr(own, name), getattr(again, name)
        assert isinstance(field, wp.array)
        np.testing.assert_array_equal(field.numpy(), other.numpy())
