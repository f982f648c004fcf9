"""Layouts that a randomizer makes for itself, and sources that do not fit."""

from dataclasses import replace

import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import ArgumentError, ArgumentTypeError, SceneMismatchError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.layout.pipeline import Chooser, LayoutPipeline
from sceniris_gym.layout.source import LayoutSource
from sceniris_gym.levels import LevelReplay
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.randomizer import ResetRandomizer
from tests.sim.conftest import SMALL_ARM
from tests.sim.stepping import DERIVED, STATE, snapshot, step


@pytest.mark.parametrize("prefetch", [False, True])
def test_it_makes_its_own_layouts_of_a_scene(prefetch: bool):
    """Without a generator the layouts are those of a LayoutGenerator of the same seed and split, made ahead or not."""
    scene = {
        "model": str(SMALL_ARM),
        "floor": {"size": [1.6, 1.6]},
        "objects": {"block": {"on": "floor", "region": {"box": [[-0.3, -0.6], [0.3, 0.6]]}}},
    }
    compiled = compile_scene(SceneConfig.load(scene, {"bank": 4}), "cpu")
    with wp.ScopedDevice("cpu"):
        model, data = mjw.put_model(compiled.mjm), mjw.make_data(compiled.mjm, 3)
    randomizer = ResetRandomizer(compiled, model, data, seed=5, split="eval", prefetch=prefetch)
    twin = LayoutGenerator(compiled, 3, seed=5, split="eval")
    for _ in range(2):
        randomizer.reset()
        twin.generate()
        np.testing.assert_array_equal(data.qpos.numpy(), twin.layouts.qpos.numpy())
    randomizer.reseed(np.array([False, False, True]), seed=[9, 9, 5])
    randomizer.reset(torch.tensor([False, False, True]))
    np.testing.assert_array_equal(randomizer.layouts.seed.numpy(), [5, 6, 5])
    np.testing.assert_array_equal(randomizer.layouts.episode.numpy(), [1, 1, 0])
    assert set(randomizer.rejection_counts()) == {"block"}
    assert (randomizer.pipeline.ahead is not None) == prefetch
    if prefetch:
        with pytest.raises(ValueError, match="Leave out the layout_source, or leave out"):
            ResetRandomizer(compiled, model, data, layout_source=twin, prefetch=True)
        with pytest.raises(TypeError, match=r"prefetch should be a boolean, a wp\.Stream or None, got <class 'str'>"):
            ResetRandomizer(compiled, model, data, prefetch="no")


class Own(LayoutSource):
    """A source without a split, for two worlds."""

    def __init__(self, compiled: CompiledScene) -> None:
        self.layouts = Layouts.create(compiled, 2)


def test_a_pipeline_takes_the_split_of_its_randomizer(make_randomizer, small_scene):
    """A source of one's own has none; levels and a chooser of its own do not go together."""
    worlds = make_randomizer(2)
    model, data = worlds.model, worlds.data
    pipeline = LayoutPipeline(Own(small_scene))
    randomizer = ResetRandomizer(small_scene, model, data, layout_source=pipeline, split="eval")
    assert (randomizer.split, randomizer.pipeline.split) == ("eval", "eval")
    with pytest.raises(ArgumentTypeError, match="layout_source should be a LayoutSource"):
        # pyrefly: ignore[bad-argument-type]
        ResetRandomizer(small_scene, model, data, layout_source=3, curriculum=LevelReplay())
    pipeline = LayoutPipeline(Own(small_scene), chooser=Chooser())
    with pytest.raises(ArgumentError, match="both curriculum and layout_source choose layouts"):
        ResetRandomizer(small_scene, model, data, layout_source=pipeline, curriculum=LevelReplay())


def test_layouts_of_another_scene_are_refused(make_randomizer, small_scene):
    """Also where all sizes agree."""
    randomizer = make_randomizer(2)
    other = compile_scene({"model": str(SMALL_ARM), "attempts": 11}, "cpu")
    source = LayoutGenerator(other, 2)
    with pytest.raises(SceneMismatchError, match="layout_source makes layouts of scene"):
        ResetRandomizer(small_scene, randomizer.model, randomizer.data, layout_source=source)


def test_stored_layouts_are_put_back(make_randomizer, rows):
    """World i gets row rows[i], -1 leaves it untouched; numpy arrays and kept layouts do."""
    randomizer = make_randomizer(4)
    randomizer.reset()
    step(randomizer)
    before = snapshot(randomizer.data)
    randomizer.write(rows, [5, -1, 5, 0])
    after = snapshot(randomizer.data)
    np.testing.assert_array_equal(after["qpos"][[0, 2, 3]], rows.qpos[[5, 5, 0]])
    np.testing.assert_array_equal(after["mocap_quat"][[0, 2, 3]], rows.mocap_quat[[5, 5, 0]])
    assert (after["time"][[0, 2, 3]] == 0).all()
    for name in STATE + DERIVED:
        np.testing.assert_array_equal(after[name][1], before[name][1], err_msg=name)

    randomizer.write(randomizer.layouts, torch.tensor([-1, 3, -1, -1]))
    np.testing.assert_array_equal(randomizer.data.qpos.numpy()[1], rows.qpos[3])


@pytest.mark.parametrize(
    ("which", "error", "match"),
    [
        ([0, 7], ArgumentError, r"rows\[1\] should be from 0 to 6.* got 7"),
        ([0, -2], ArgumentError, r"rows\[1\] should be .* got -2"),
        ([0], ArgumentError, r"shape \(2,\)"),
        ([0.5, 1.0], ArgumentTypeError, "float64"),
    ],
)
def test_wrong_rows_say_what_is_wrong(make_randomizer, rows, which, error, match):
    """Rows that do not exist are refused, not written as something else."""
    with pytest.raises(error, match=match):
        make_randomizer(2).write(rows, which)


def test_stored_layouts_of_another_scene_or_shape_are_refused(make_randomizer, rows):
    """The error has the shape that there is, and the one that should be."""
    randomizer = make_randomizer(2)
    short = replace(rows, qpos=rows.qpos[:, :5])
    with pytest.raises(SceneMismatchError, match=r"layouts\.qpos should have shape \(nrow, 12\).* got \(7, 5\)"):
        randomizer.write(short, [0, 1])
    with pytest.raises(SceneMismatchError, match=r"belongs to scene 0123456789abcdef, but '.*' is now scene"):
        randomizer.write(replace(rows, scene="0123456789abcdef"), [0, 1])  # in which places may mean something else
    flat = replace(rows, mocap_quat=rows.mocap_quat[:, :, :3])
    with pytest.raises(SceneMismatchError, match=r"layouts\.mocap_quat should have shape .*, 4\).* got \(7, \d, 3\)"):
        randomizer.write(flat, [0, 1])
    for name in ("present", "start", "draw_seed"):
        with pytest.raises(SceneMismatchError, match=rf"layouts\.{name} should have shape"):
            randomizer.write(replace(rows, **{name: np.zeros((7, 3), np.int32)}), [0, 1])
    broken = np.where(np.arange(7)[:, None] == 3, np.nan, rows.qpos)
    with pytest.raises(SceneMismatchError, match=r"layouts: row 3 has a non-finite"):
        randomizer.write(replace(rows, qpos=broken), [0, 1])
    with pytest.raises(SceneMismatchError, match=r"layouts\.start should be from -1 to -1, got 7 in row 0"):
        randomizer.write(replace(rows, start=np.full(7, 7, np.int32)), [0, 1])
    with pytest.raises(ArgumentTypeError, match="layouts should be Layouts or a LayoutTable"):
        randomizer.write(3, [0, 1])
