"""Mixed scenes are a function of their number; their judge has each world's own model, and finds what is wrong."""

from __future__ import annotations

import os
from collections import Counter
from typing import Any

import mujoco
import numpy as np
import pytest

from sceniris_gym.commands.replay import drawn, replay
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.build import build_model
from tests.generators.mixed_scenes import CARRIERS, make
from tests.generators.mixed_things import CURVED, JOINTED
from tests.oracle.world_judge import WorldJudge
from tests.stress.mixed import Outcome, Task, main, report, try_worlds
from tests.stress.workers import try_all

NWORLD = 6
WORDS = {"tin": "tin", "block": "block"}
DRAWN_FIELDS = ("body_mass", "body_inertia", "body_ipos")
DRAWN = {"mass": {"scale": [0.5, 2.0]}, "ipos": {"add": [[-0.004, 0, 0], [0.004, 0, 0]]}}


def words(thing: dict[str, Any]) -> dict[str, Any]:
    """Return a scene with a thing beside a brick whose physics is drawn."""
    near = {"on": "floor", "region": {"box": [[-0.3, -0.3], [-0.1, 0.3]]}}
    objects = {"thing": {**thing, **near}, "brick": {"asset": "brick", "on": "floor", "randomize": DRAWN}}
    return {"floor": {"size": [1.0, 1.0]}, "objects": objects, "bank": 2}


@pytest.fixture(scope="module")
def compiled() -> CompiledScene:
    """Return a scene with variants and draws."""
    return compile_scene(words({"variants": {name: {"asset": name} for name in WORDS}}), "cpu", cache=False)


@pytest.fixture
def judge(compiled: CompiledScene) -> WorldJudge:
    """Return the judge of some of its worlds."""
    return WorldJudge(compiled, np.arange(NWORLD))


def test_a_scene_is_a_function_of_its_number():
    """Twice the same scene, and another one for another number."""
    scenes = [make(number) for number in range(30)]
    assert scenes == [make(number) for number in range(30)]
    assert len({str(scene.words) for scene in scenes}) == len(scenes)


def test_scenes_mix_everything():
    """Every feature comes up, and most scenes have several of them."""
    count = Counter(feature for number in range(200) for feature in make(number).features)
    draws = {
        f"drawn {word}" for word in ("mass", "ipos", "friction", "solref", "solimp", "frictionloss", "gravity", "robot")
    }
    more = {
        "stack",
        "variants",
        "joints",
        "group",
        "tight",
        "start held",
        "start place",
        "own model",
        "gap",
        "tower",
        "based",
    }
    assert {*CARRIERS, *CURVED, *JOINTED, *draws, *more} <= set(count)
    assert sum(count.values()) > 5 * 200


def test_a_world_has_the_model_of_its_variant(judge: WorldJudge, compiled: CompiledScene):
    """It moves as a scene in which the variant is a plain object, with the masses that replay draws for its id."""
    ids = [LayoutId.parse(text) for text in judge.randomizer.pipeline.ids(judge.randomizer.split)]
    variants = judge.randomizer.variants.cpu().numpy()[:, 0]
    assert set(variants.tolist()) == {0, 1}
    for world, number in enumerate(variants.tolist()):
        full, _ = drawn(compiled, replay(compiled, ids[world]))
        own = build_model(SceneConfig.load(words({"asset": list(WORDS)[number]}))).mjm
        for field in DRAWN_FIELDS:
            getattr(own, field)[own.body("brick").id] = getattr(full, field)[full.body("brick").id]
        own.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        own.body_sameframe[:] = 0
        alone, theirs = mujoco.MjData(own), judge.worlds.model(world)
        mujoco.mj_setConst(own, alone)
        data = mujoco.MjData(theirs)
        judge.worlds.put(data, world)
        alone.qpos[:] = data.qpos
        for model, state in ((own, alone), (theirs, data)):
            mujoco.mj_step(model, state, 30)
        assert data.ncon == alone.ncon > 3
        np.testing.assert_allclose(data.qpos, alone.qpos, atol=3e-4)  # contacts are soft, fields of single precision
        for field in (*DRAWN_FIELDS, "body_invweight0", "body_subtreemass", "dof_invweight0"):
            np.testing.assert_allclose(getattr(theirs, field), getattr(own, field), rtol=2e-5, atol=1e-7)


def test_the_judge_finds_what_falls_and_what_is_inside_of_something(judge: WorldJudge):
    """Worlds as they are have no fault; one with a thing in the air and one with a thing in the floor have."""
    assert not any(verdict.faults for verdict in judge.judge())
    adr = judge.mjm.jnt_qposadr[judge.mjm.body("brick").jntadr[0]]
    judge.worlds.states["qpos"][1, adr + 2] += 0.05
    judge.worlds.states["qpos"][2, adr + 2] -= 0.002
    verdicts = list(judge.judge())
    assert [verdict.faults for verdict in verdicts] == [(), ("moved",), ("deep",), *[()] * (NWORLD - 3)]
    assert verdicts[1].who == "brick" and verdicts[1].moved == pytest.approx(0.05, abs=5e-3)
    assert verdicts[2].deep == pytest.approx(0.0015, abs=1e-4) and "brick" in verdicts[2].pair


def test_a_report_counts_faults_by_status_and_feature():
    """Shares are of all worlds, slips of those that hold something; a figure that is missed is told."""
    one = Outcome("1", ["stack"], worlds=Counter(valid=3, fallback=1), faults=Counter({"fallback moved": 1}))
    two = Outcome("2", ["start"], worlds=Counter(valid=4, held=2), faults=Counter({"valid slipped": 1}))
    lines = list(report({"1": one, "2": two, "3": Outcome("3", refused="SomeError: objects.a")}, {}))
    assert lines[1].split()[:6] == ["stack", "1", "0", "3", "1", "0"]
    assert next(line for line in lines if line.startswith("all")).split()[-2:] == ["12.500%", "50.000%"]
    assert one.misses(0.2) and not one.misses(0.3) and two.misses(0.3)


def test_the_command_writes_a_random_scene_and_counts_a_refusal(tmp_path):
    """Files of a scene are written; a given one that is wrong is refused, and misses no figure."""
    assert main(["--show", "3", "--out", str(tmp_path)]) == 0
    assert (tmp_path / "scene.yaml").is_file()
    part = try_worlds(Task("wrong", {"objects": {"a": {"asset": "nowhere.xml"}}}, 0, 4))
    assert part.refused.startswith("AssetNotFoundError") or "nowhere.xml" in part.refused
    assert not part.misses(0.0)


def test_a_process_that_dies_is_replaced():
    """Its task is lost with the reason, and the next one is tried."""
    lost = "task {}: {}".format
    assert list(try_all(os._exit, [3, 4], 1, lost)) == [f"task {i}: crash with exit code {i}" for i in (3, 4)]
    assert sorted(try_all(abs, [-1, -2, -3], 2, lost)) == [1, 2, 3]
