"""Drawn fields, and what follows from them: a function of seed and episode, however worlds come to a layout."""

from __future__ import annotations

from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import warp as wp

from sceniris_gym.errors import ArgumentError
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.fit import make_worlds
from sceniris_gym.sim.randomizer import ResetRandomizer

NWORLD = 6
DRAWS = {"mass": {"scale": [0.5, 2.0]}, "friction": {"scale": [0.5, 2.0]}, "rgba": {"scale": [0.5, 1.0]}}
VARIANTS = {"variants": {"can": {"asset": "can"}, "lemon": {"asset": "lemon"}, "brick": {"asset": "brick"}}}
WORDS = {
    "objects": {name: {"randomize": DRAWS} for name in ("can", "block")},
    "robot": {"randomize": {"gains": {"scale": [0.5, 2.0]}, "armature": {"scale": [0.5, 2.0]}}},
    "randomize": {"cameras": {"overview": {"pos": {"add": [-0.1, 0.1]}}}},
}
FOLLOW = ("body_subtreemass", "body_invweight0", "dof_invweight0", "actuator_acc0", "cam_poscom0", "cam_mat0")


@pytest.fixture(scope="module", params=["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
def device(request) -> str:
    """Return a device."""
    return request.param


def compiled_scene(device: str, *, variants: bool) -> CompiledScene:
    """Return a scene with draws that much follows from, and an object with variants if so."""
    words: dict[str, Any] = {"base": "tabletop_lift", "bank": 8, **WORDS}
    if variants:
        words["objects"] = {**WORDS["objects"], "extra": {**VARIANTS, "on": "table", "randomize": DRAWS}}
    return compile_scene(words, device)


@pytest.fixture(scope="module")
def scene(device: str) -> CompiledScene:
    """Return the scene without variants."""
    return compiled_scene(device, variants=False)


def make(scene: CompiledScene, nworld: int = NWORLD, **kwargs: Any) -> ResetRandomizer:
    """Return a randomizer of worlds whose Model has rows of all fields that are drawn."""
    return ResetRandomizer(scene, *make_worlds(scene, nworld, nconmax=64, njmax=256), seed=7, **kwargs)


def values(randomizer: ResetRandomizer) -> dict[str, np.ndarray]:
    """Copy the fields with a row for each world, and the controls, once the device is done."""
    wp.synchronize_device(randomizer.device)
    fields = randomizer.fields
    found = {name: getattr(randomizer.model, name) for name in fields.varied} | fields.rows
    return {name: array.numpy().copy() for name, array in (found | {"ctrl": randomizer.data.ctrl}).items()}


@pytest.mark.parametrize("variants", [False, True])
def test_bits_are_those_of_one_world_alone(device: str, variants: bool):
    """After resets by masks, reseeds and stored layouts, with layouts made ahead or not, and with a graph or not."""
    scene = compiled_scene(device, variants=variants)
    some, steps = np.arange(NWORLD) % 2 == 0, []
    alone = make(scene, 1, prefetch=False, graph=False)
    for prefetch, graph in ((True, True), (True, False), (False, True)):
        randomizer = make(scene, prefetch=prefetch, graph=graph)
        for step in range(6):
            mask, before = None if step in (0, 3) else some if step % 2 else ~some, values(randomizer)
            if step == 4:
                randomizer.reseed(~some, seed=11)
            randomizer.reset(mask)
            after = values(randomizer)
            if mask is not None:
                for name, array in after.items():
                    np.testing.assert_array_equal(array[~mask], before[name][~mask], err_msg=name)
        randomizer.write(randomizer.layouts, np.array([3, -1, -1, 0, -1, 5]))
        steps.append((after, values(randomizer)))
        for name, array in steps[-1][1].items():
            np.testing.assert_array_equal(array, after[name][[3, 1, 2, 0, 4, 5]], err_msg=name)
        for earlier, later in zip(steps[0], steps[-1], strict=True):
            for name, array in earlier.items():
                np.testing.assert_array_equal(array, later[name], err_msg=f"{name} {prefetch} {graph}")
    assert {*FOLLOW, "body_mass", "geom_friction", "rest"} < set(after)
    seed, episode = (getattr(randomizer.layouts, name).cpu().numpy() for name in ("seed", "episode"))
    for world in range(NWORLD):
        alone.reset(layouts={"seed": int(seed[world]), "episode": int(episode[world])})
        for name, array in values(alone).items():
            np.testing.assert_array_equal(array[0], after[name][world], err_msg=f"{name} {world}")


@pytest.mark.parametrize("variants", [False, True])
@pytest.mark.parametrize("shared", [False, True])
def test_two_randomizers_of_the_same_worlds_draw_what_one_would(device: str, shared: bool, variants: bool):
    """Each has layouts of its own, from the values of the model; fields follow what was drawn last."""
    scene = compiled_scene(device, variants=variants)
    one, alone = make(scene, prefetch=True), make(scene, prefetch=False)
    one.reset()
    alone.pipeline.reseed(seed=70)
    worlds: Any = Mock(spec=Batch, model=one.model, data=one.data, fields=one.fields)
    words: dict[str, Any] = {"seed": 70, "prefetch": True}
    if shared:
        other = ResetRandomizer.of_batch(worlds, scene, **words)
    else:
        other = ResetRandomizer(scene, one.model, one.data, **words)
    for randomizer in (other, one, other, alone, alone):
        randomizer.reset()
    rows, wanted = values(other), values(alone)
    for name, array in rows.items():
        np.testing.assert_array_equal(array, wanted[name], err_msg=name)
    np.testing.assert_allclose(rows["body_subtreemass"][:, 0], rows["body_mass"].sum(axis=1), rtol=1e-5)


def test_randomizers_that_share_fields_have_the_same_params_of_draws(scene: CompiledScene):
    """The fields draw by the columns of one row of params."""
    name = "objects.can.randomize.mass"
    batch = Batch(scene.scene, NWORLD, scene.device)
    ResetRandomizer.of_batch(batch, scene, params=(name,))
    for params in ((), ("objects.*.randomize.*",)):
        with pytest.raises(ArgumentError, match="params: another randomizer of the same Batch"):
            ResetRandomizer.of_batch(batch, scene, params=params)
    ResetRandomizer.of_batch(batch, scene, params=(name,))


def test_params_narrow_draws(scene: CompiledScene):
    """Also of layouts that were made ahead before the param was set."""
    name = "objects.can.randomize.mass"
    one, other = (make(scene, prefetch=prefetch, params=(name,)) for prefetch in (True, False))
    for randomizer in (one, other):
        for step in range(4):
            if step == 2:
                randomizer.pipeline.set_params({name: [1.0, 1.1]}, np.arange(NWORLD) < 3)
            randomizer.reset()
            wp.synchronize_device(randomizer.device)
    rows = values(other)
    for field, array in values(one).items():
        np.testing.assert_array_equal(array, rows[field], err_msg=field)
    factors = one.fields.parameter("can.mass", "test").numpy()[:, 0]
    assert ((factors >= 1.0) & (factors <= 1.1))[:3].all()
    assert not ((factors >= 1.0) & (factors <= 1.1)).all()
