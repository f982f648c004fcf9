"""Device code's view of conditions: every field is filled, and it survives the file of a compiled scene."""

from __future__ import annotations

from pathlib import Path

from sceniris_gym.program.device_conditions import Conditions
from tests.layout.scenes import box_mjcf, compile_on_cpu
from tests.program.round_trip import assert_comes_back


def test_conditions_are_kept_with_a_compiled_scene(tmp_path: Path):
    """All fields are the same after a round trip; without a condition there are none."""
    crate = {"asset": box_mjcf(tmp_path, "crate", 0.05, 0.05, 0.05), "on": "floor"}
    groups = {"some": {"of": ["a"], "count": [0, 1]}}
    plain = {"floor": {"size": [1, 1]}, "objects": {"a": crate, "b": crate}, "groups": groups}
    assert compile_on_cpu(plain, bank=2).conditions is None
    compiled = compile_on_cpu(plain, {"objects.b.if": "a"}, bank=2)
    assert_comes_back(compiled, "conditions", Conditions)
    conditions = compiled.conditions
    assert conditions is not None
    assert conditions.order.numpy().tolist() == [0, 1]
    assert conditions.leaf.numpy().tolist() == [0, 1]
    assert (conditions.term_holds.numpy().tolist(), conditions.term_slot.numpy().tolist()) == ([1], [0])
