"""Device code's view of standing: every field is filled, and it survives the file of a compiled scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sceniris_gym.program.device_statics import Statics
from tests.layout.scenes import box_mjcf, compile_on_cpu
from tests.program.round_trip import assert_comes_back


def test_statics_are_kept_with_a_compiled_scene(tmp_path: Path):
    """All fields are the same after a round trip."""
    crate = {"asset": box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.05)}
    scene = {"floor": {"size": [1, 1]}, "objects": {"a": {**crate, "on": "floor"}, "b": {**crate, "on": "a"}}}
    compiled = compile_on_cpu(scene, bank=2)
    assert_comes_back(compiled, "statics", Statics)
    assert compiled.statics is not None
    assert (
        compiled.statics.body_weight.numpy()[0, 1:].tolist() == compiled.mjm.body_mass[1:].astype(np.float32).tolist()
    )
