"""Settings and options of a training."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sceniris_gym.errors import ArgumentError, SceneKeyError, UnknownNameError
from sceniris_gym.training.settings import Options, Settings, settings_of


def test_the_entropy_bonus_falls_with_the_steps():
    """Evenly until its last weight, and not at all where a task has none."""
    cooled = replace(Settings(), entropy=0.004, last_entropy=0.001, cooling=30.0)
    assert [cooled.entropy_after(n) for n in (0, 10_000_000, 90_000_000)] == pytest.approx([0.004, 0.003, 0.001])
    assert replace(cooled, last_entropy=None).entropy_after(20_000_000) == 0.004


def test_settings_to_try_are_named():
    """A setting that there is gets the value; others are refused."""
    changed = settings_of("TabletopReach-v0", ("gamma=0.5", "hidden=[8, 8]"))
    assert (changed.gamma, changed.hidden) == (0.5, (8, 8))
    with pytest.raises(UnknownNameError, match=r"--set: unknown setting 'gama'\. Did you mean 'gamma'"):
        settings_of("TabletopReach-v0", ("gama=0.5",))
    with pytest.raises(SceneKeyError, match="--set gamma: should be KEY=VALUE"):
        settings_of("TabletopReach-v0", ("gamma",))
    for wrong in ("gamma=2", "steps=-1", "hidden='x'", "init_std=null"):
        with pytest.raises(SceneKeyError, match=f"--set: {wrong.partition('=')[0]}: "):
            settings_of("TabletopReach-v0", (wrong,))


def test_a_task_without_settings_of_its_own_has_the_defaults():
    """Those that were not tuned for any task, with the changes that are asked for."""
    assert settings_of("KitchenReset-v0") == Settings()
    assert settings_of("module:Own-v0", ("last_entropy=null", "gamma=0.9")) == Settings(gamma=0.9)


@pytest.mark.parametrize("options", [{"minutes": 0.0}, {"minutes": float("nan")}, {"million_steps": -1.0}])
def test_a_run_has_an_end_after_its_start(options: dict[str, float]):
    """Time and steps are above 0."""
    (name,) = options
    with pytest.raises(ArgumentError, match=rf"--{name.replace('_', '-')} .*: should be above 0"):
        Options("TabletopReach-v0", **options).check()  # pyrefly: ignore[bad-argument-type]
