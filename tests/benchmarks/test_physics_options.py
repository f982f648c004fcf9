"""Cost of options of the physics, each compared with the task as it is."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from benchmarks import physics_options
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.training import task_scenes


@pytest.mark.slow
def test_options_of_the_physics_are_compared_one_by_one(capsys: pytest.CaptureFixture):
    """A line for each, that of what cannot be measured too, and one whose name is wrong is refused."""
    options = physics_options.Options(
        num_envs=(2,), only=("whole", "iterations 5", "contacts / 2"), rounds=2, steps=2, device="cpu"
    )
    physics_options.main(options)
    told = [line for line in capsys.readouterr().out.splitlines() if line.startswith('{"variant"')]
    lines = {line["variant"]: line for line in map(json.loads, told)}
    assert lines["whole"]["skipped"] == "torch is captured on a GPU alone"
    for name in ("iterations 5", "contacts / 2"):
        assert set(lines[name]["ratio"]) == {"median", "min", "max"}
    with pytest.raises(SystemExit, match=r"unknown variants contact\. Valid: as it is, whole"):
        physics_options.main(replace(options, only=("contact",)))


def test_a_variant_differs_in_what_it_says_alone(compiled: CompiledScene):
    """Options and room of its own; the scene's model keeps its own ones."""
    base = task_scenes.make_env("TabletopReach-v0", 2, compiled)
    before = compiled.mjm.opt.disableflags
    changes = {
        "iterations 5": lambda envs: envs.batch.model.opt.iterations == 5,
        "rows / 2": lambda envs: envs.batch.data.njmax == base.batch.data.njmax // 2,
        "contacts x 2": lambda envs: envs.batch.data.naconmax == 2 * base.batch.data.naconmax,
        "without contacts": lambda envs: envs.batch.model.opt.disableflags != base.batch.model.opt.disableflags,
    }
    for name, differs in changes.items():
        with physics_options.VARIANTS[name].environment("TabletopReach-v0", base) as envs:
            assert differs(envs)
    assert compiled.mjm.opt.disableflags == before


def test_what_does_not_fit_is_not_measured(compiled: CompiledScene, monkeypatch: pytest.MonkeyPatch):
    """Contacts that are dropped take no time, so such a figure would mislead."""
    base = task_scenes.make_env("TabletopReach-v0", 2, compiled)
    monkeypatch.setitem(physics_options.VARIANTS, "contacts / 10", physics_options.Variant(contacts=0.1))
    found = physics_options.measure("contacts / 10", base, physics_options.Options(rounds=1, steps=1))
    assert "nconmax=4 is too small" in found["skipped"]
    assert "ms" not in found
