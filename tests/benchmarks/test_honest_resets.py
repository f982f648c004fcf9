"""Counts of resets that start in contact, or explode."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import honest_resets
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ContactBudgetError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.training.layout_sources import unchecked
from tests.versions import since_4


def test_bad_resets_are_counted(compiled: CompiledScene):
    """None of the generator's, some of those without checks; contacts with the support are no fault."""
    options = honest_resets.Options(num_envs=48, nconmax=64, njmax=256)
    good, pairs = honest_resets.Judge(compiled, LayoutGenerator(compiled, 48), options).look(0)
    assert (good["layouts"], good["either"]) == (48, 0)
    assert not pairs
    drawn = LayoutGenerator(unchecked(compiled), 48)
    bad, pairs = honest_resets.Judge(compiled, drawn, options).look(0)
    assert 2 <= bad["in_contact"] <= bad["either"]
    assert not any("table" in pair for pair in pairs)
    assert honest_resets.supports(compiled.scene)["can"] == "table"


def test_resets_of_variants_are_judged_in_the_body_that_variants_share():
    """Its velocities and contacts are those of the simulated model, which has fewer bodies than the compiled scene."""
    thing = {"on": "table", "ratio_on_support": 1, "variants": {name: {"asset": name} for name in ("can", "orange")}}
    objects = {"table": {"asset": "table", "kind": "static"}, "first": thing, "second": thing}
    compiled = compile_scene(SceneConfig.model_validate({"objects": objects}), "cpu")
    options = honest_resets.Options(num_envs=48, nconmax=64, njmax=256)
    good, pairs = honest_resets.Judge(compiled, LayoutGenerator(compiled, 48), options).look(0)
    assert (good["layouts"], good["either"]) == (48, 0)
    assert not pairs


def judge_with_room(compiled: CompiledScene, nconmax: int, njmax: int) -> honest_resets.Judge:
    """Return a judge of unchecked layouts in 48 worlds, with so much room."""
    options = honest_resets.Options(num_envs=48, nconmax=nconmax, njmax=njmax)
    return honest_resets.Judge(compiled, LayoutGenerator(unchecked(compiled), 48), options)


@since_4("mujoco_warp reads beyond its arrays where pairs do not fit")
def test_resets_are_not_judged_where_pairs_did_not_fit(compiled: CompiledScene):
    """Even if all contacts did."""
    pairs = judge_with_room(compiled, nconmax=1, njmax=256)
    with pytest.raises(ContactBudgetError, match="nconmax=1 is too small"):
        pairs.look(0)
    assert pairs.batch.data.nacon.numpy()[0] < 48 < pairs.batch.data.ncollision.numpy()[0], "the contacts alone fit"


def test_resets_are_not_judged_where_a_contact_was_lost(compiled: CompiledScene):
    """Neither where scratch for convex ones or rows do not fit, nor when it happens while they are watched."""
    with pytest.raises(ContactBudgetError, match="njmax=8 is too small"):
        judge_with_room(compiled, nconmax=64, njmax=8).look(0)
    convex = judge_with_room(compiled, nconmax=64, njmax=256)
    convex.batch.data.naccdmax = 1
    with pytest.raises(ContactBudgetError, match="nconmax"):
        convex.look(0)
    other = judge_with_room(compiled, nconmax=64, njmax=256)
    overflow = np.zeros(48, np.int32)
    overflow[5] = honest_resets.OverflowType.EPA_HORIZON
    other.batch.data.overflow.assign(overflow)
    with pytest.raises(RuntimeError, match="EPA_HORIZON"):
        other._touching()


def test_counts_are_kept_for_the_same_options_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A file with the answer is left alone, also with other room; other options are refused; half a line is redone."""
    seeds: list[int] = []

    def look(self: honest_resets.Judge, seed: int) -> tuple[Counter, Counter]:
        seeds.append(seed)
        return Counter(layouts=self.batch.nworld, in_contact=1), Counter()

    monkeypatch.setattr(honest_resets.Judge, "look", look)
    options = honest_resets.Options(
        layouts=8, num_envs=4, tasks=("TabletopReach-v0",), out=tmp_path / "honest.jsonl", device="cpu", njmax=64
    )
    honest_resets.main(options)
    told = options.out.read_text()
    lines = [json.loads(line) for line in told.splitlines()]
    assert [(line["placement"], line["layouts"], line["in_contact"]) for line in lines] == [
        ("fresh", 8, 2),
        ("uniform", 8, 2),
    ]
    honest_resets.main(replace(options, njmax=128))
    for other in ({"layouts": 64}, {"num_envs": 8}, {"seed": 3}):
        with pytest.raises(SystemExit, match="other options"):
            honest_resets.main(replace(options, **other))  # pyrefly: ignore[bad-argument-type]
    assert (len(seeds), options.out.read_text()) == (4, told)
    options.out.write_text(told[:-20])  # stopped while it wrote the last line
    honest_resets.main(options)
    assert (len(seeds), options.out.read_text()) == (6, told)


def test_doors_and_drawers_are_watched_too():
    """A drawer counts as fast as it slides, a door as its outer edge; the arm does not count, and a NaN is too fast."""
    scene: dict[str, Any] = {
        "floor": {"size": [3.0, 3.0]},
        "robot": {"asset": "panda", "base": [0.0, -1.0, 0.0]},
        "objects": {
            "cabinet": {
                "asset": "cabinet",
                "kind": "fixture",
                "on": "floor",
                "region": {"box": [[-0.8, 0.0], [-0.7, 0.1]]},
            },
            "cupboard": {
                "asset": "cupboard",
                "kind": "fixture",
                "on": "floor",
                "region": {"box": [[0.7, 0.0], [0.8, 0.1]]},
            },
        },
    }
    compiled = compile_scene(SceneConfig.load(scene, {"bank": 4}), "cpu")
    dofs = {compiled.mjm.joint(i).name: int(compiled.mjm.jnt_dofadr[i]) for i in range(compiled.mjm.njnt)}
    options = honest_resets.Options(num_envs=4, nconmax=64, njmax=256)
    judge = honest_resets.Judge(compiled, LayoutGenerator(compiled, 4), options)
    assert set(judge.levers) == {dofs[name] for name in ("cabinet/upper", "cabinet/lower", "cupboard/door")}
    geoms = [
        g for g in range(compiled.mjm.ngeom) if compiled.mjm.body(compiled.mjm.geom_bodyid[g]).name == "cupboard/door"
    ]
    width = max(2.0 * compiled.mjm.geom_aabb[g, 3:].max() for g in geoms)
    assert 0.5 * width < judge.levers[dofs["cupboard/door"]] < 1.5 * width
    qvel = np.zeros((4, compiled.mjm.nv))
    qvel[0, dofs["cabinet/lower"]] = -1.5
    qvel[1, dofs["cupboard/door"]] = 2.0
    qvel[2, dofs["panda/joint1"]] = 3.0
    qvel[3, dofs["cabinet/upper"]] = np.nan
    assert judge.speeds(qvel).tolist() == pytest.approx([1.5, 2.0 * judge.levers[dofs["cupboard/door"]], 0.0, np.inf])
