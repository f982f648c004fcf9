"""Posed robots against the layout: no robot hits itself or anything else, except for a hand at its target."""

from __future__ import annotations

from pathlib import Path

import pytest

from sceniris_gym.errors import InfeasibleSceneError
from sceniris_gym.layout.generate import LayoutGenerator
from tests.layout.grasped import IN_FRONT, arm_mjcf, cluttered, scene, states, taken
from tests.layout.scenes import box_mjcf, compile_on_cpu, write_mjcf
from tests.oracle.solids import Solids

HAND = {f"picker/{name}" for name in ("link6", "left", "right")}


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
def test_drawn_meshes_are_kept_clear_of(tmp_path: Path):
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
