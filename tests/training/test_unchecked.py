"""Placement without any check."""

from __future__ import annotations

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.training.unchecked import unchecked
from tests.layout.scenes import compile_on_cpu


def test_nothing_is_rejected_for_a_collision():
    """With either geometry; the scene itself stays as it was."""
    for geometry in ("physics", "visual"):
        compiled = compile_on_cpu("mid", {"geometry": geometry})
        for scene, some in ((unchecked(compiled), False), (compiled, True)):
            generator = LayoutGenerator(scene, 64)
            generator.generate()
            rejected = sum(causes["collision"] for causes in generator.rejection_counts().values())
            assert (rejected > 0) == some
