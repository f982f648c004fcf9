"""Free grasps: objects that are placed later leave one to each target of tier `clear`, whatever is tried at once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.wave.search import default_size
from sceniris_gym.program.compiled import CompiledScene
from tests.layout.grasped import IN_FRONT, scene, taken
from tests.layout.scenes import box_mjcf, compile_on_cpu

N = 100


def crowded(folder: Path, **target: Any) -> CompiledScene:
    """Compile a bar among four posts as high as the hand, near enough to be in its way."""
    bar, post = box_mjcf(folder, "bar", 0.12, 0.05, 0.04), box_mjcf(folder, "post", 0.04, 0.04, 0.2)
    near = {
        "asset": post,
        "on": "floor",
        "relations": [{"near": "bar", "measure": "bounds", "distance": {"max": 0.03}}],
    }
    words = {"asset": bar, "on": "floor", "region": IN_FRONT, "reachable": "clear", **target}
    objects = {"bar": words, **{f"post_{i}": near for i in range(4)}}
    return compile_on_cpu(scene(folder, objects, restarts=30), bank=8)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> CompiledScene:
    """The crowded bar."""
    return crowded(tmp_path_factory.mktemp("crowded"))


def test_what_would_take_the_last_grasp_is_drawn_again(compiled: CompiledScene):
    """It counts as blocked, the bar itself less often, and the grasps that are kept are clear by MuJoCo C."""
    generator = LayoutGenerator(compiled, N, seed=4)
    generator.generate()
    counts, layouts = generator.rejection_counts(), generator.layouts
    assert sum(counts[f"post_{i}"]["blocked"] for i in range(4)) > N // 2
    assert counts["bar"]["blocked"] < N // 2
    assert (layouts.status.numpy() == LayoutStatus.VALID).all()
    for which in ("grasp_qpos", "pregrasp_qpos"):
        found = list(taken(compiled, layouts, which))
        assert len(found) == N
        assert not any(t.itself or t.others for t in found)


@pytest.mark.parametrize("words", [{"rows": 300, "busy": 500}, {"rows": 40, "grasps": 30}, {"candidates": 7}])
def test_what_is_tried_at_once_changes_no_free_grasp(compiled: CompiledScene, words: dict[str, int]):
    """The same layouts, grasps and counts as one at a time."""
    made = []
    for size in (default_size("cpu"), replace(default_size("cpu"), **words)):
        generator = LayoutGenerator(compiled, 30, seed=5, size=size)
        generator.generate()
        names = ("qpos", "grasp", "grasp_qpos", "pregrasp_qpos", "attempts", "rejections")
        made.append([getattr(generator.layouts, name).numpy().tobytes() for name in names])
    assert made[0] == made[1]


def test_only_targets_with_objects_after_them_are_asked_for_free_grasps(tmp_path: Path, compiled: CompiledScene):
    """A tier below `clear` asks for none, and a grasp of each target belongs to that target."""
    assert compiled.reaching is not None
    view, grasps = compiled.reaching.arms[0].view, compiled.reaching.targets[0].grasp_set.grasps
    assert view.early_grasp.numpy().tolist() == list(range(len(grasps)))
    assert (view.grasp_reach.numpy() == 0).all()
    before = view.hand_before.numpy()
    assert (np.diff(before) >= 0).all()
    assert before[-1] == view.arm_broadnum.numpy()[view.arm_hand.numpy()[0]]
    other = crowded(tmp_path, reachable="ik").reaching
    assert other is not None
    assert other.arms[0].view.early_grasp.shape == (0,)
