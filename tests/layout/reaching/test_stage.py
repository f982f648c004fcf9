"""The reach stage as a whole: layouts with joints are pure functions of their seeds, and failures are counted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Layouts, LayoutStatus
from sceniris_gym.layout.wave.search import default_size
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.reach.solve import POS_TOL
from tests.layout.grasped import IN_FRONT, cluttered, is_clear, scene, taken
from tests.layout.scenes import box_mjcf, compile_on_cpu, read


@pytest.fixture(scope="module", params=["ik", "clear"])
def compiled(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """The cluttered scene for both tiers."""
    return cluttered(tmp_path_factory.mktemp(request.param), request.param)


def bits(layouts: Layouts) -> list[bytes]:
    """Return all that each row of a batch holds, its grasps included."""
    own = [
        getattr(layouts, name).cpu().numpy() for name in ("grasp", "grasp_qpos", "pregrasp_qpos", "first_pass_valid")
    ]
    rows = read(layouts)
    return [rows[i : i + 1].bits() + b"".join(a[i].tobytes() for a in own) for i in range(layouts.nworld)]


def test_rejected_grasps_start_anew_and_are_counted(compiled: CompiledScene):
    """An object out of the arm's reach costs a restart, and is counted under its cause."""
    generator = LayoutGenerator(compiled, 200, seed=5)
    generator.generate()
    counts = generator.rejection_counts()
    assert counts["bar"]["no_ik"] > 20
    assert counts["post_0"]["no_ik"] == 0
    assert (counts["bar"]["blocked"] + counts["can"]["blocked"] > 0) == is_clear(compiled)
    first = generator.layouts.first_pass_valid.cpu().numpy()
    assert 0.0 < first.mean() < 0.9
    assert (generator.layouts.attempts.cpu().numpy()[first == 1] < 100).all()


def test_a_layout_is_the_same_in_any_batch(compiled: CompiledScene):
    """Alone, among others, under a mask and in a later round: the same bits for a seed and an episode."""
    expected = {}
    for seed in range(6):
        generator = LayoutGenerator(compiled, 1, seed=seed)
        for episode in range(3):
            generator.generate()
            expected[seed, episode] = bits(generator.layouts)[0]
    many = LayoutGenerator(compiled, 6)
    rng = np.random.default_rng(0)
    for _ in range(6):
        mask = wp.array(rng.random(6) < 0.5, dtype=bool, device="cpu")
        before = bits(many.layouts)
        many.generate(mask)
        for i, (old, new) in enumerate(zip(before, bits(many.layouts), strict=True)):
            episode = int(many.layouts.episode.cpu().numpy()[i])
            if not mask.numpy()[i]:
                assert new == old
            elif episode < 3:
                assert new == expected[i, episode]


def test_restarts_that_run_at_once_change_no_bit(compiled: CompiledScene):
    """The lowest restart that has joints is kept, and what came after it is not counted."""
    rows = []
    for words in ({}, {"rows": 300, "busy": 500}, {"rows": 40, "grasps": 30}):
        generator = LayoutGenerator(compiled, 30, seed=6, size=replace(default_size("cpu"), **words))
        generator.generate()
        rows.append(
            (bits(generator.layouts), generator.layouts.attempts.cpu().numpy().tolist(), generator.rejection_counts())
        )
    assert rows[1:] == rows[:1] * 2


@pytest.mark.cuda
@pytest.mark.parametrize("tier", ["ik", "clear"])
def test_what_is_tried_at_once_changes_no_bit_on_a_gpu(tmp_path: Path, tier: str):
    """Grasps and starts one by one, with room for few worlds, and with more lanes: the first that passes is kept."""
    compiled = cluttered(tmp_path, tier, device="cuda:0")
    rows = []
    for words in ({}, {"busy": 1}, {"grasps": 100}, {"block_dim": 64}):
        size = replace(default_size("cuda:0"), **words)
        generator = LayoutGenerator(compiled, 256, seed=6, size=size)
        for _ in range(2):
            generator.generate()
        rows.append(bits(generator.layouts))
    assert rows[1:] == rows[:1] * 3


def test_generation_runs_in_a_captured_graph(compiled: CompiledScene):
    """All rounds are in the graph; replayed, it makes one episode after the other."""
    plain, captured = LayoutGenerator(compiled, 20, seed=7), LayoutGenerator(compiled, 20, seed=7)
    with wp.ScopedCapture(device="cpu") as capture:
        captured.generate()
    captured.reseed(seed=7)
    for _ in range(2):
        plain.generate()
        wp.capture_launch(capture.graph)
        assert bits(captured.layouts) == bits(plain.layouts)


def test_an_exhausted_world_takes_grasps_from_the_bank(tmp_path: Path):
    """Out of restarts in the last stage, a world gets an entry of the bank whose grasps hold in it."""
    compiled = cluttered(tmp_path, "clear", restarts=0)
    generator = LayoutGenerator(compiled, 100, seed=8)
    generator.generate()
    fallen = generator.layouts.status.cpu().numpy() == LayoutStatus.FALLBACK
    assert 10 < fallen.sum() < 90
    assert not generator.layouts.first_pass_valid.cpu().numpy()[fallen].any()
    for which in ("grasp_qpos", "pregrasp_qpos"):
        found = list(taken(compiled, generator.layouts, which))
        assert len(found) == 200
        assert max(t.far for t in found) <= POS_TOL
        assert not any(t.itself or t.others for t in found)


def test_absent_objects_have_no_grasp(tmp_path: Path):
    """An object that its group leaves out is not asked for, and nothing of an earlier episode stays in its row."""
    bar = box_mjcf(tmp_path, "bar", 0.12, 0.05, 0.04)
    thing = {"asset": bar, "on": "floor", "region": IN_FRONT, "reachable": "clear"}
    groups = {"some": {"of": ["one", "two"], "count": [0, 2]}}
    compiled = compile_on_cpu(scene(tmp_path, {"one": thing, "two": thing}, groups=groups))
    generator = LayoutGenerator(compiled, 50, seed=9)
    for _ in range(2):
        generator.generate()
        layouts = generator.layouts
        here = layouts.present.cpu().numpy()[:, :2] == 1
        assert 0 < here.sum() < here.size
        assert ((layouts.grasp.cpu().numpy() >= 0) == here).all()
        for joints in (layouts.grasp_qpos.cpu().numpy(), layouts.pregrasp_qpos.cpu().numpy()):
            assert (np.isfinite(joints[:, :, :6]).all(axis=2) == here).all()


def test_objects_out_of_reach_are_refused(tmp_path: Path):
    """A region beyond the arm's reach makes the scene infeasible, with the cause NO_IK."""
    bar = box_mjcf(tmp_path, "bar", 0.12, 0.05, 0.04)
    far = {"asset": bar, "on": "floor", "region": {"box": [[-0.7, -0.7], [-0.66, 0.7]]}, "reachable": "ik"}
    near = {"asset": "can", "on": "floor", "region": IN_FRONT}
    with pytest.raises(InfeasibleSceneError, match="no_ik") as info:
        compile_on_cpu(scene(tmp_path, {"far": far, "near": near}, robot=None, restarts=1), {"robot.base": [0.4, 0, 0]})
    assert info.value.name == "far"


_OF_IK = ["_look_up", "_solve", "_pose", "_test 6-7-6", "_accept"]
_OF_CLEAR = ["_look_up", "_pose", "_test 1-2-3", "_solve", "_solve", "_pose", "_test 6-8-10"]
_OF_CLEAR += ["_accept"]


@pytest.mark.parametrize(("tier", "steps"), [("ik", _OF_IK), ("clear", _OF_CLEAR), (None, [])])
def test_a_scene_launches_the_steps_of_its_tiers_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tier: str | None, steps: list[str]
):
    """In their order, wave by wave, as long as any world waits; nothing of it in a scene without the stage."""
    bar = box_mjcf(tmp_path, "bar", 0.12, 0.05, 0.04)
    words = {"asset": bar, "on": "floor", "region": IN_FRONT, "reachable": tier}
    objects = {"bar": {k: v for k, v in words.items() if v is not None}}
    generator = LayoutGenerator(compile_on_cpu(scene(tmp_path, objects, restarts=2)), 4)
    launched = []

    def record(name: str) -> None:
        launch = getattr(wp, name)

        def recorded(kernel: wp.Kernel, *args: Any, **words: Any) -> None:
            if "layout.reaching" in kernel.module.name:
                steps = "-".join(map(str, words["inputs"][3:6]))
                launched.append(f"_test {steps}" if kernel.key == "_test" else kernel.key)
            launch(kernel, *args, **words)

        monkeypatch.setattr(wp, name, recorded)

    record("launch")
    record("launch_tiled")
    generator.launch_generate(None)
    assert (generator.layouts.status.cpu().numpy() == LayoutStatus.VALID).all()
    waves = "|".join(launched).split("_open_candidates|")[1:]
    assert [wave.strip("|").split("|")[: len(steps)] for wave in waves] == [steps] * len(waves)
    assert (len(waves) > 0) == (tier is not None)
