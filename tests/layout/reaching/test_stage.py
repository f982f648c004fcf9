"""The tiers `ik` and `clear`: joints that MuJoCo C confirms, in layouts that are pure functions of their seeds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Layouts, Status
from sceniris_gym.layout.reaching.ik import SAME_BRANCH
from sceniris_gym.layout.wave.search import default_size
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.reach.solve import POS_TOL, ROT_TOL
from tests.layout.grasped import arm_mjcf, cluttered, scene, states, taken
from tests.layout.scenes import box_mjcf, compile_on_cpu, read, write_mjcf
from tests.oracle.solids import Solids

IN_FRONT = {"box": [[0.35, -0.15], [0.55, 0.15]]}
HAND = {f"picker/{name}" for name in ("link6", "left", "right")}


@pytest.fixture(scope="module", params=["ik", "clear"])
def compiled(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """The cluttered scene for both tiers."""
    return cluttered(tmp_path_factory.mktemp(request.param), request.param)


def bits(layouts: Layouts) -> list[bytes]:
    """All that a row of a batch holds, its grasps included."""
    own = [getattr(layouts, name).numpy() for name in ("grasp", "grasp_qpos", "pregrasp_qpos", "first_pass_valid")]
    rows = read(layouts)
    return [rows[i : i + 1].bits() + b"".join(a[i].tobytes() for a in own) for i in range(layouts.nworld)]


def is_clear(compiled: CompiledScene) -> bool:
    """Whether a world is that of the tier `clear`."""
    return compiled.config.objects["can"].reachable == "clear"


def test_accepted_joints_hold_by_mujoco(compiled: CompiledScene):
    """Within limits, at the grasp to 1 mm and 0.5 degrees, and clear of the robot itself: without exception."""
    generator = LayoutGenerator(compiled, 300, seed=3)
    generator.generate()
    found = list(taken(compiled, generator.layouts, "grasp_qpos"))
    assert len(found) == 600
    assert max(t.far for t in found) <= POS_TOL
    assert max(t.turned for t in found) <= ROT_TOL
    assert all(t.within for t in found)
    assert not any(t.itself for t in found)
    # among the posts the arm would hit something now and then
    assert any(t.others for t in found) != is_clear(compiled)


def test_pre_grasps_of_clear_hold_by_mujoco(compiled: CompiledScene):
    """8 cm back along the approach, without contact, joints close to those of the grasp; nan for other tiers."""
    generator = LayoutGenerator(compiled, 300, seed=4)
    generator.generate()
    layouts = generator.layouts
    if not is_clear(compiled):
        assert np.isnan(layouts.pregrasp_qpos.numpy()).all()
        return
    found = list(taken(compiled, layouts, "pregrasp_qpos"))
    assert len(found) == 600
    assert max(t.far for t in found) <= POS_TOL
    assert max(t.turned for t in found) <= ROT_TOL
    assert not any(t.itself or t.others for t in found)
    change = layouts.pregrasp_qpos.numpy() - layouts.grasp_qpos.numpy()
    assert np.nanmax(np.abs(change)) <= SAME_BRANCH + 1e-6
    assert np.isnan(change[:, :, 6:]).all()


def test_rejected_grasps_start_anew_and_are_counted(compiled: CompiledScene):
    """What is placed out of the arm's reach costs a restart, and is counted for the object and its cause."""
    generator = LayoutGenerator(compiled, 200, seed=5)
    generator.generate()
    counts = generator.rejection_counts()
    assert counts["bar"]["no_ik"] > 20
    assert counts["post_0"]["no_ik"] == 0
    assert (counts["bar"]["blocked"] + counts["can"]["blocked"] > 0) == is_clear(compiled)
    first = generator.layouts.first_pass_valid.numpy()
    assert 0.0 < first.mean() < 0.9
    assert (generator.layouts.attempts.numpy()[first == 1] < 100).all()


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
            episode = int(many.layouts.episode.numpy()[i])
            if not mask.numpy()[i]:
                assert new == old
            elif episode < 3:
                assert new == expected[i, episode]


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
    captured.reseed(7)
    for _ in range(2):
        plain.generate()
        wp.capture_launch(capture.graph)
        assert bits(captured.layouts) == bits(plain.layouts)


def test_an_exhausted_world_takes_grasps_from_the_bank(tmp_path: Path):
    """Out of restarts in the last stage, a world gets an entry of the bank whose grasps hold in it."""
    compiled = cluttered(tmp_path, "clear", restarts=0)
    generator = LayoutGenerator(compiled, 100, seed=8)
    generator.generate()
    fallen = generator.layouts.status.numpy() == Status.FALLBACK
    assert 10 < fallen.sum() < 90
    assert not generator.layouts.first_pass_valid.numpy()[fallen].any()
    for which in ("grasp_qpos", "pregrasp_qpos"):
        found = list(taken(compiled, generator.layouts, which))
        assert len(found) == 200
        assert max(t.far for t in found) <= POS_TOL
        assert not any(t.itself or t.others for t in found)


def test_what_is_absent_has_no_grasp(tmp_path: Path):
    """An object that its group leaves out is not asked for, and nothing of an earlier episode stays in its row."""
    bar = box_mjcf(tmp_path, "bar", 0.12, 0.05, 0.04)
    thing = {"asset": bar, "on": "floor", "region": IN_FRONT, "reachable": "clear"}
    groups = {"some": {"of": ["one", "two"], "count": [0, 2]}}
    compiled = compile_on_cpu(scene(tmp_path, {"one": thing, "two": thing}, groups=groups))
    generator = LayoutGenerator(compiled, 50, seed=9)
    for _ in range(2):
        generator.generate()
        layouts = generator.layouts
        here = layouts.present.numpy()[:, :2] == 1
        assert 0 < here.sum() < here.size
        assert ((layouts.grasp.numpy() >= 0) == here).all()
        for joints in (layouts.grasp_qpos.numpy(), layouts.pregrasp_qpos.numpy()):
            assert (np.isfinite(joints[:, :, :6]).all(axis=2) == here).all()


def test_what_is_out_of_reach_is_refused(tmp_path: Path):
    """A region that the arm does not reach to makes the scene infeasible, for want of joints."""
    bar = box_mjcf(tmp_path, "bar", 0.12, 0.05, 0.04)
    far = {"asset": bar, "on": "floor", "region": {"box": [[-0.7, -0.7], [-0.66, 0.7]]}, "reachable": "ik"}
    near = {"asset": "can", "on": "floor", "region": IN_FRONT}
    with pytest.raises(InfeasibleSceneError, match="no_ik") as info:
        compile_on_cpu(scene(tmp_path, {"far": far, "near": near}, robot=None, restarts=1), {"robot.base": [0.4, 0, 0]})
    assert info.value.name == "far"


def test_a_lid_over_the_object_blocks_the_arm(tmp_path: Path):
    """Joints that put the hand through a lid are found by `ik`, and refused by `clear`."""
    bar = box_mjcf(tmp_path, "bar", 0.12, 0.05, 0.04)
    lid = box_mjcf(tmp_path, "lid", 0.4, 0.6, 0.02)
    objects = {
        "lid": {"asset": lid, "kind": "fixture", "region": {"box": [[0.45, 0, 0.06], [0.45, 0, 0.06]]}},
        "bar": {"asset": bar, "on": "floor", "region": IN_FRONT, "reachable": "ik"},
    }
    words = scene(tmp_path, objects, restarts=1)
    words["objects"]["lid"]["orientation"] = "fixed"
    compile_on_cpu(words)
    words["objects"]["bar"]["reachable"] = "clear"
    with pytest.raises(InfeasibleSceneError, match="blocked"):
        compile_on_cpu(words)


def test_an_arm_that_would_hit_itself_has_no_joints(tmp_path: Path):
    """A ring around the arm's own base, through which it would have to reach."""
    bar = box_mjcf(tmp_path, "bar", 0.12, 0.05, 0.04)
    walls = "".join(
        f'<geom type="box" size="0.02 0.4 0.3" pos="{0.3 * x} {0.3 * y} 0.3" euler="0 0 {turn}"/>'
        for x, y, turn in ((1, 0, 0), (0, 1, 90), (-1, 0, 0), (0, -1, 90))
    )
    objects = {"bar": {"asset": bar, "on": "floor", "region": IN_FRONT, "reachable": "ik"}}
    compile_on_cpu(scene(tmp_path, objects, restarts=1))
    with pytest.raises(InfeasibleSceneError, match="no_ik"):
        compile_on_cpu(scene(tmp_path, objects, robot=arm_mjcf(tmp_path, walls, "walled"), restarts=1))


def test_only_the_hand_may_touch_what_it_grasps(tmp_path: Path):
    """A handle at the foot of a wall of the same object: no forearm in the wall, and no hand before the grasp."""
    body = '<geom type="box" size="0.02 0.02 0.02" pos="0.07 0 0.02"/>'
    body += '<geom type="box" size="0.01 0.15 0.15" pos="-0.02 0 0.15"/>'
    body += '<site name="grasp_handle" pos="0.07 0 0.02" quat="0 1 0 0"/>'
    wall = {"asset": write_mjcf(tmp_path, "wall", body), "on": "floor", "region": IN_FRONT, "reachable": "clear"}
    layouts = LayoutGenerator(compile_on_cpu(scene(tmp_path, {"wall": wall})), 300, seed=11)
    layouts.generate()
    grasps, before = (list(taken(layouts.compiled, layouts.layouts, f"{w}grasp_qpos")) for w in ("", "pre"))
    assert len(grasps) == len(before) == 300
    assert {name for t in grasps for name in t.on_target} <= HAND
    assert not any(t.on_target for t in before)


def test_long_fingers_may_surround_what_they_grasp_before_they_grasp_it(tmp_path: Path):
    """Fingers of 15 cm around a post of 13 cm: 8 cm back they still stand beside it, and touch it nowhere."""
    body = '<geom type="box" size="0.02 0.02 0.065" pos="0 0 0.065"/>'
    body += '<site name="grasp_low" pos="0 0 0.02" quat="0 1 0 0"/>'
    post = {"asset": write_mjcf(tmp_path, "post", body), "on": "floor", "region": IN_FRONT, "reachable": "clear"}
    robot = arm_mjcf(tmp_path, name="grabber", longer=0.08)
    layouts = LayoutGenerator(compile_on_cpu(scene(tmp_path, {"post": post}, robot)), 100, seed=12)
    layouts.generate()
    before = list(taken(layouts.compiled, layouts.layouts, "pregrasp_qpos"))
    assert len(before) == 100
    assert not any(t.on_target or t.others for t in before)
    assert layouts.rejection_counts()["post"]["blocked"] == 0


@pytest.mark.slow
def test_what_is_drawn_is_kept_clear_of(tmp_path: Path):
    """With `geometry: visual` a grasp and its pre-grasp are clear of the meshes that are drawn, by FCL."""
    compiled = cluttered(tmp_path, "clear", geometry="visual")
    solids = Solids(compiled.mjm, "visual")
    generator = LayoutGenerator(compiled, 40, seed=10)
    generator.generate()
    robot = solids.geoms("picker")
    parts = {name: solids.geoms(name) for name in compiled.object_names}
    for which in ("grasp_qpos", "pregrasp_qpos"):
        for data, name in states(compiled, generator.layouts, which):
            others = [g for other, geoms in parts.items() if other != name for g in geoms]
            assert solids.distance(data, robot, others) > 0.0


_OF_IK = ["_open_candidates", "_look_up", "_choose_starts", "_solve", "_pose_arm", "_test 6-6", "_accept"]
_OF_CLEAR = ["_open_candidates", "_look_up", "_pose_hand", "_test 1-1", "_pose_hand", "_test 2-3"]
_OF_CLEAR += ["_choose_starts", "_solve", "_solve", "_pose_arm", "_test 6-7", "_pose_arm", "_test 8-10", "_accept"]


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
                steps = "-".join(map(str, words["inputs"][2:4]))
                launched.append(f"_test {steps}" if kernel.key == "_test" else kernel.key)
            launch(kernel, *args, **words)

        monkeypatch.setattr(wp, name, recorded)

    record("launch")
    record("launch_tiled")
    generator.launch_generate(None)
    assert (generator.layouts.status.numpy() == Status.VALID).all()
    waves = "|".join(launched).split("_plan_wave")[1:]
    assert [wave.strip("|").split("|")[: len(steps)] for wave in waves] == [steps] * len(waves)
    assert (len(waves) > 0) == (tier is not None)
