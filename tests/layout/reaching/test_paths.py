"""Paths to a grasp, walked in MuJoCo C, which shares no code with their search."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from sceniris_gym import cli
from sceniris_gym.commands.replay import replay
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.dataset.reader import LayoutDataset
from sceniris_gym.errors import ArgumentError, SceneKeyError
from sceniris_gym.layout.claims import judge_reach, reach_claims
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layout_id import LayoutId
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.layout.tables import make_table
from sceniris_gym.layout.wave.search import default_size
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.vector.vector_env import SceneVectorEnv
from tests.layout.scenes import prefetched
from tests.layout.walked import corners_of, walked

NWORLD = 24
LIFT: dict[str, Any] = {
    "base": "tabletop_lift",
    "objects": {n: {"reachable": "path"} for n in ("can", "lemon", "block")},
}
CUPBOARD: dict[str, Any] = {
    "floor": {"size": [2.4, 2.0]},
    "robot": {"asset": "panda", "base": [0, 0, 0.3]},
    "objects": {
        "cupboard": {
            "asset": "cupboard",
            "kind": "fixture",
            "on": "floor",
            "region": {"box": [[0.55, -0.1], [0.65, 0.1]]},
            "orientation": {"yaw": [-100, -80]},
            "joints": {"door": {"fraction": [0.7, 1.0]}},
        },
        "can": {"asset": "can", "inside": "cupboard", "ratio_on_support": 1, "reachable": "path"},
    },
}


@pytest.fixture(scope="module", params=["lift", "cupboard"])
def made(request: pytest.FixtureRequest) -> tuple[CompiledScene, LayoutGenerator]:
    """Return a scene and its layouts with paths."""
    compiled = compile_scene({"lift": LIFT, "cupboard": CUPBOARD}[request.param], "cpu")
    generator = LayoutGenerator(compiled, NWORLD)
    generator.generate()
    return compiled, generator


def test_no_point_of_a_path_touches_anything(made: tuple[CompiledScene, LayoutGenerator]):
    """At 400 points, interpolated here; only the hand may touch the target, on the last piece."""
    compiled, generator = made
    found = walked(compiled, generator.layouts)
    assert [walk for walk in found if walk.hit] == []
    assert any(not np.array_equal(walk.corners[1], walk.corners[3]) for walk in found)


@pytest.mark.parametrize("words", [{"rows": 32, "grasps": 40}, {"grasps": 900, "busy": 3, "blocks": 256}])
def test_how_much_is_tried_at_once_changes_no_bit(made: tuple[CompiledScene, LayoutGenerator], words: dict[str, int]):
    """Capacities and the number of worlds; a world's layouts depend on its seed alone."""
    compiled, generator = made
    other = LayoutGenerator(compiled, NWORLD - 5, size=dataclasses.replace(default_size("cpu"), **words))
    other.generate()
    for name in ("qpos", "path", "pregrasp_qpos", "grasp_qpos", "status"):
        ours, theirs = (getattr(each.layouts, name).numpy()[: NWORLD - 5] for each in (generator, other))
        np.testing.assert_array_equal(ours, theirs, err_msg=name)


def test_a_start_proves_its_own_path():
    """Paths to a handle and to a banana are needed only where a world starts on them, whatever `reachable` says."""
    opened = {"cabinet/upper": {"fraction": [0.9, 1.0]}}
    handle = {"robot": "path", "of": "cabinet", "grasp": "upper_handle*"}
    starts = [{}, handle, {"robot": "path", "of": "banana", "joints": opened}]
    compiled = compile_scene({"base": "drawer_open_pick", "start": starts}, "cpu")
    generator = LayoutGenerator(compiled, 96)
    generator.generate()
    table = generator.table()
    assert compiled.reaching is not None
    for name, kind in (("cabinet", 1), ("banana", 2)):
        column = compiled.reaching.names.index(name)
        has = np.isfinite(corners_of(generator.layouts, column, 7)).all(axis=(1, 2))
        np.testing.assert_array_equal(has, table.start == kind)
        assert has.sum() > 10
    assert (table.start == 0).any()
    claims = reach_claims(compiled, table)
    assert [(claim.name, claim.tier.word) for claim in claims] == [
        *(("cabinet", "clear"), ("cabinet", "path")),
        *(("banana", "map"), ("banana", "path")),
    ]
    assert judge_reach(compiled, table, claims) == []
    envs = SceneVectorEnv("sceniris_gym.envs.drawer_open_pick:DrawerOpenPick", 24, scene=compiled)
    envs.reset(seed=0)
    corners, number = envs.state.path("cabinet")
    begun = envs.state.start == 1
    assert begun.any()
    assert torch.equal(corners.isfinite().all(dim=2).all(dim=1), begun)
    assert torch.equal(number > 0, begun)
    envs.close()
    table.path[table.start == 2] += 0.2
    found = judge_reach(compiled, table, reach_claims(compiled, table))
    assert {u.name for u in found} <= {"banana"}
    assert found


def test_starts_are_on_the_path():
    """At the drawn share of its length by the largest change of a joint, fingers open, at rest."""
    starts = [{"robot": "path", "of": "can", "share": [0.0, 1.0]}, {"robot": "path", "of": "can", "share": [1.0, 1.0]}]
    compiled = compile_scene({**LIFT, "start": starts}, "cpu")
    generator = LayoutGenerator(compiled, 64)
    generator.generate()
    assert compiled.reaching is not None
    layouts, arm = generator.layouts, compiled.reaching.arms[0].arm
    column = compiled.reaching.names.index("can")
    joints, shares = corners_of(layouts, column, 7), []
    for world in range(64):
        lengths = np.abs(np.diff(joints[world], axis=0)).max(axis=1)
        found = layouts.qpos[world].numpy()[arm.qposadr]
        dense = np.concatenate(
            [np.linspace(a, b, 2000) for a, b in zip(joints[world], joints[world, 1:], strict=False)]
        )
        at = np.concatenate([np.linspace(0, n, 2000) + lengths[:i].sum() for i, n in enumerate(lengths)])
        nearest = np.abs(dense - found).max(axis=1).argmin()
        assert np.abs(dense[nearest] - found).max() < 2e-3
        shares.append(at[nearest] / lengths.sum())
    ends = layouts.start.numpy() == 1
    assert np.allclose(np.array(shares)[ends], 1.0, atol=2e-3)
    assert np.array(shares)[~ends].min() < 0.2
    assert 0.35 < np.mean(np.array(shares)[~ends]) < 0.65


def test_stored_layouts_data_sets_and_ids_keep_the_path(tmp_path: Path):
    """A table on the device, a data set on disk, layouts made ahead, and an id's layout in another batch."""
    compiled = compile_scene(LIFT, "cpu")
    generator = LayoutGenerator(compiled, 6, seed=5)
    generator.generate()
    path = generator.layouts.path.numpy().copy()
    assert np.isfinite(path).any()
    table, first = make_table(compiled, 6, 5), generator.layouts.ids("train")[3]
    stored = StoredLayouts(compiled, table, 6)
    stored.generate()
    np.testing.assert_array_equal(stored.layouts.path.numpy(), table.path)
    ahead = prefetched(LayoutGenerator(compiled, 6, seed=5), graph=False)
    for _ in range(2):
        ahead.generate()
    generator.generate()
    np.testing.assert_array_equal(ahead.layouts.path.numpy(), generator.layouts.path.numpy())
    assert (generator.layouts.path.numpy() != path).any()
    (tmp_path / "lift.yaml").write_text(json.dumps(LIFT))
    words = ["generate", str(tmp_path / "lift.yaml"), "-n", "6", "--seed", "5", "--device", "cpu", "-o"]
    cli.main([*words, str(tmp_path / "set")])
    np.testing.assert_array_equal(LayoutDataset(tmp_path / "set").table().path, table.path)
    again = replay(compiled, LayoutId.parse(first))
    np.testing.assert_array_equal(again.path[0], path[3])


def test_a_task_reads_the_corners_and_their_number():
    """Of all worlds, in the order home, vias, pre-grasp, grasp; a name without a path is refused."""
    envs = SceneVectorEnv("sceniris_gym.envs.tabletop_lift:TabletopLift", 8, scene=LIFT, device="cpu")
    envs.reset(seed=0)
    s = envs.state
    corners, number = s.path("can")
    assert corners.shape == (8, 5, 7)
    assert torch.equal(corners[:, 3], s.pregrasp_qpos("can"))
    assert torch.equal(corners[:, 4], s.grasp_qpos("can"))
    vias = (corners[:, 1:3] != corners[:, 3:4]).any(dim=2).sum(dim=1)
    assert torch.equal(number.long(), 3 + vias)
    envs.close()
    envs = SceneVectorEnv("sceniris_gym.envs.tabletop_lift:TabletopLift", 2, device="cpu")
    envs.reset(seed=0)
    with pytest.raises(ArgumentError, match="'can' should have 'reachable: path'"):
        envs.state.path("can")
    envs.close()


def test_variants_and_redraws_have_paths():
    """The path of the present variant starts at home; a redraw of its target finds one from the arm's present pose."""
    scene = {"base": "tabletop_lift_any", "objects": {"target": {"reachable": "path"}}}
    envs = SceneVectorEnv("sceniris_gym.envs.tabletop_lift_any:TabletopLiftAny", 12, scene=scene, device="cpu")
    envs.reset(seed=0)
    s = envs.state
    home, (corners, number) = s.qpos("panda")[:, :7].clone(), s.path("target")
    assert len(envs.randomizer.variants.unique()) > 2
    np.testing.assert_array_equal(corners[:, 0].numpy(), home.numpy())
    assert ((number >= 3) & (number <= 5)).all()
    before = s.pose("target").clone()
    envs.redraw(["target"], np.arange(12) < 6)
    moved = (s.pose("target") != before).any(dim=1)
    assert moved[:6].all()
    assert not moved[6:].any()
    envs.close()


@pytest.mark.parametrize(
    ("overrides", "error"),
    [
        ({"objects.can.margin": 0.002, "objects.can.reachable": "clear"}, "'margin' only together with"),
        ({"objects.can.margin": 0.0}, "margin"),
        ({"start": [{"robot": "path", "of": "can", "share": [0.5, 1.2]}]}, "share"),
        ({"start": [{"robot": "grasp", "of": "can", "share": [0.5, 1.0]}]}, "'share' only if 'robot' is 'path'"),
        ({"start": [{"robot": "path"}]}, "'of'"),
        ({"objects.can.reachable": False, "start": [{"robot": "path", "of": "can"}]}, "needs the key 'reachable'"),
        ({"start": [{"robot": "grasp", "of": "can", "lift": [0.1, 0.2]}]}, "held in the air"),
    ],
)
def test_words_that_cannot_be_together_are_refused(overrides: dict[str, Any], error: str):
    """By name, before anything is compiled."""
    with pytest.raises(SceneKeyError, match=error):
        SceneConfig.load(SceneConfig.load(LIFT), overrides)
