"""Fields that follow from drawn ones, made ahead with the next layouts."""

from __future__ import annotations

from typing import Any

import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.draws import drawn_fields
from sceniris_gym.sim.model_fields import put_model
from sceniris_gym.sim.randomizer import ResetRandomizer

NWORLD = 6
WORDS = {
    "objects": {name: {"randomize": {"mass": {"scale": [0.5, 2.0]}}} for name in ("can", "block")},
    "robot": {"randomize": {"gains": {"scale": [0.5, 2.0]}, "armature": {"scale": [0.5, 2.0]}}},
    "randomize": {"cameras": {"overview": {"pos": {"add": [-0.1, 0.1]}}}},
}
FOLLOW = ("body_subtreemass", "body_invweight0", "dof_invweight0", "actuator_acc0", "cam_poscom0", "cam_mat0")


@pytest.fixture(scope="module", params=["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
def scene(request) -> CompiledScene:
    """Return a scene with draws that much follows from."""
    return compile_scene({"base": "tabletop_lift", "bank": 8, **WORDS}, request.param)


def make(scene: CompiledScene, nworld: int = NWORLD, **kwargs: Any) -> ResetRandomizer:
    """Return a randomizer of worlds whose Model has rows of all fields that are drawn."""
    with wp.ScopedDevice(scene.device):
        data = mjw.make_data(scene.sim_mjm, nworld, nconmax=64, njmax=256)
    return ResetRandomizer(scene, put_model(scene, nworld), data, seed=7, **kwargs)


def values(randomizer: ResetRandomizer) -> dict[str, np.ndarray]:
    """Copy the fields, and the controls."""
    found = {name: array.numpy().copy() for name, array in randomizer.fields.rows.items()}
    return found | {"ctrl": randomizer.data.ctrl.numpy().copy()}


def found_anew(randomizer: ResetRandomizer) -> np.ndarray:
    """Reset all worlds after what was made ahead is spoilt, and return those in which none of it shows."""
    derived = randomizer.fields._derived
    assert derived is not None
    wp.synchronize_device(randomizer.device)
    for made, _ in derived._kept:
        made.fill_(np.nan)
    randomizer.reset()
    wp.synchronize_device(randomizer.device)
    return np.isfinite(randomizer.fields.rows["body_subtreemass"].numpy()[:, 0])


@pytest.mark.parametrize("graph", [True, False])
def test_bits_are_those_made_in_place(scene: CompiledScene, graph: bool):
    """For all worlds, some of them, reseeded ones that were not ready, and stored layouts."""
    one, other = make(scene, prefetch=True, graph=graph), make(scene, prefetch=False)
    some = np.arange(NWORLD) % 2 == 0
    for step in range(6):
        mask = None if step in (0, 3) else some if step % 2 else ~some
        for randomizer in (one, other):
            if step == 4:
                randomizer.reseed(11, some)
            before = values(randomizer)
            randomizer.reset(mask)
        ours, theirs = values(one), values(other)
        assert set(FOLLOW) < set(ours)
        for name, array in ours.items():
            np.testing.assert_array_equal(array, theirs[name], err_msg=f"{name} {step}")
            if mask is not None:
                np.testing.assert_array_equal(array[~mask], before[name][~mask])
        wp.synchronize_device(one.device)  # a GPU has made the next layouts by then
    for randomizer in (one, other):
        randomizer.write(randomizer.layouts, np.array([3, -1, -1, 0, -1, 5]))
    for name, array in values(one).items():
        np.testing.assert_array_equal(array, values(other)[name], err_msg=name)


def test_a_reseeded_world_is_drawn_in_place(scene: CompiledScene):
    """As its next layout was made by another seed, and the others are served."""
    randomizer = make(scene, prefetch=True)
    for _ in range(2):
        randomizer.reset()
        wp.synchronize_device(randomizer.device)
    assert not found_anew(randomizer).any()
    chosen = np.arange(NWORLD) < 2
    randomizer.reseed(99, chosen)
    np.testing.assert_array_equal(found_anew(randomizer), chosen)


def test_nothing_is_copied_where_a_task_writes(scene: CompiledScene):
    """Inverse weights of a mass of one's own are found in the reset, also if the field is asked for later."""
    randomizer = make(scene, prefetch=True)
    randomizer.reset()
    mass = randomizer.model_field("body_mass", "lemon")
    wp.to_torch(mass)[:] = 3.0
    for _ in range(2):
        assert found_anew(randomizer).all()
    rows = randomizer.fields.rows
    np.testing.assert_allclose(rows["body_subtreemass"].numpy()[:, 0], rows["body_mass"].numpy().sum(axis=1), rtol=1e-5)


def test_nothing_is_copied_where_two_sources_reset_the_same_worlds(scene: CompiledScene):
    """Each with layouts of its own; fields follow what was drawn last."""
    one = make(scene, prefetch=True)
    words = {"fields": one.fields, "seed": 70, "prefetch": True}
    other = ResetRandomizer(scene, one.model, one.data, **words)
    for randomizer in (one, other, one, other):
        randomizer.reset()
        wp.synchronize_device(randomizer.device)
    rows = one.fields.rows
    np.testing.assert_allclose(rows["body_subtreemass"].numpy()[:, 0], rows["body_mass"].numpy().sum(axis=1), rtol=1e-5)


def test_draws_that_nothing_follows_from_take_no_memory(scene: CompiledScene):
    """Also without layouts that are made ahead."""
    friction = {"objects": {"can": {"randomize": {"friction": {"scale": [0.5, 2.0]}}}}}
    for words, prefetch in ((friction, True), (WORDS, False)):
        compiled = compile_scene({"base": "tabletop_lift", "bank": 8, **words}, scene.device)
        assert drawn_fields(compiled.scene.draws)
        derived = make(compiled, 2, prefetch=prefetch).fields._derived
        assert derived is None or not derived.is_made_ahead


def test_knobs_narrow_what_is_made_ahead(scene: CompiledScene):
    """As what is found in place, also in layouts that were made ahead before the knob was set."""
    name = "objects.can.randomize.mass"
    one, other = (make(scene, prefetch=prefetch, knobs=(name,)) for prefetch in (True, False))
    for randomizer in (one, other):
        for step in range(4):
            if step == 2:
                randomizer.set_knob(name, [1.0, 1.1], np.arange(NWORLD) < 3)
            randomizer.reset()
            wp.synchronize_device(randomizer.device)
    for field, array in values(one).items():
        np.testing.assert_array_equal(array, values(other)[field], err_msg=field)
    factors = one.fields.parameter("can.mass", "test").numpy()[:, 0]
    assert ((factors >= 1.0) & (factors <= 1.1))[:3].all()
    assert not ((factors >= 1.0) & (factors <= 1.1)).all()
