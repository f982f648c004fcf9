"""Layouts that a randomizer makes for itself, and sources that do not fit."""

import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.errors import SceneMismatchError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.sim.randomizer import ResetRandomizer
from tests.sim.conftest import SMALL_ARM


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
    randomizer.reseed([9, 9, 5], np.array([False, False, True]))
    randomizer.reset(torch.tensor([False, False, True]))
    np.testing.assert_array_equal(randomizer.layouts.seed.numpy(), [5, 6, 5])
    np.testing.assert_array_equal(randomizer.layouts.episode.numpy(), [1, 1, 0])
    assert set(randomizer.rejection_counts()) == {"block"}
    assert (randomizer.pipeline.ahead is not None) == prefetch
    if prefetch:
        with pytest.raises(ValueError, match="Give either them or a layout_source"):
            ResetRandomizer(compiled, model, data, layout_source=twin, prefetch=True)
        with pytest.raises(TypeError, match=r"prefetch should be a boolean, a wp\.Stream or None, got <class 'str'>"):
            ResetRandomizer(compiled, model, data, prefetch="no")  # type: ignore[arg-type]


def test_layouts_of_another_scene_are_refused(make_randomizer, small_scene):
    """Also where all sizes agree."""
    randomizer = make_randomizer(2)
    other = compile_scene({"model": str(SMALL_ARM), "attempts": 11}, "cpu")
    source = LayoutGenerator(other, 2)
    with pytest.raises(SceneMismatchError, match="layout_source makes layouts of scene"):
        ResetRandomizer(small_scene, randomizer.model, randomizer.data, layout_source=source)
