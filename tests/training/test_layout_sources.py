"""Sources of layouts: banks, and placement without checks."""

from __future__ import annotations

import numpy as np

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.training import layout_sources
from tests.layout.scenes import compile_on_cpu
from tests.training.scenes import reach_scene


def test_a_bank_for_training_goes_on_by_the_number_of_worlds(compiled: CompiledScene):
    """Of three worlds one with seed s gets row s + 2 * episode; two rows of one bank are two layouts."""
    rows = layout_sources.valid_rows(compiled, 7, seed=100)
    assert rows.qpos.shape == (7, compiled.mjm.nq)
    assert len(np.unique(rows.qpos, axis=0)) == 7
    generator = layout_sources.bank(rows)(compiled, 3)
    generator.reseed(seed=[1, 2, 3])
    for episode in range(4):
        generator.generate()
        expected = rows.qpos[[(seed + 2 * episode) % 7 for seed in (1, 2, 3)]]
        np.testing.assert_array_equal(generator.layouts.qpos.cpu().numpy(), expected)


def test_a_bank_larger_than_the_worlds_is_served_whole(compiled: CompiledScene):
    """Four worlds go through nine rows in three episodes."""
    rows = layout_sources.valid_rows(compiled, 9, seed=100)
    source, seen = layout_sources.bank(rows)(compiled, 4), set()
    source.reseed(seed=[5, 6, 7, 8])
    for _ in range(3):
        source.generate()
        seen |= {row.tobytes() for row in source.layouts.qpos.cpu().numpy()}
    assert len(seen) == 9


def test_placement_without_checks_takes_the_first_candidate():
    """No candidate collides any more, and objects lie where the first ones were drawn; the scene stays as it was."""
    plain = reach_scene(reachable=False)
    generator = layout_sources.uniform()(plain, 64)
    generator.reseed(seed=np.arange(64))
    generator.generate()
    checked = LayoutGenerator(plain, 64, seed=0)
    checked.generate()
    assert not any(causes["collision"] for causes in generator.rejection_counts().values())
    assert any(causes["collision"] for causes in checked.rejection_counts().values())
    same = (generator.layouts.qpos.cpu().numpy() == checked.layouts.qpos.cpu().numpy()).all(axis=1)
    first = checked.layouts.attempts.cpu().numpy() == generator.layouts.attempts.cpu().numpy()
    np.testing.assert_array_equal(same, first)
    assert first.any()
    assert not first.all()


def test_placement_without_checks_rejects_nothing():
    """Neither for collisions nor for reach."""
    plain = reach_scene(reachable=False)
    generator = layout_sources.uniform()(plain, 64)
    generator.generate()
    assert not any(any(causes.values()) for causes in generator.rejection_counts().values())


def test_nothing_is_rejected_for_a_collision():
    """With either geometry; the scene itself stays as it was."""
    for geometry in ("physics", "visual"):
        compiled = compile_on_cpu("mid", {"geometry": geometry})
        for scene, some in ((layout_sources.unchecked(compiled), False), (compiled, True)):
            generator = LayoutGenerator(scene, 64)
            generator.generate()
            rejected = sum(causes["collision"] for causes in generator.rejection_counts().values())
            assert (rejected > 0) == some
