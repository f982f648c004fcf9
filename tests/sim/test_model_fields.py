"""Model fields with a row for each world, in a loop of one's own."""

from __future__ import annotations

import copy
from collections.abc import Callable

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import torch
import warp as wp

from sceniris_gym.errors import ArgumentError, ArgumentTypeError, FixedError, SceneMismatchError, UnknownNameError
from sceniris_gym.layout.stored import StoredLayouts
from sceniris_gym.sim.derived import FOLLOWS
from sceniris_gym.sim.fit import make_worlds
from sceniris_gym.sim.model_fields import widen
from sceniris_gym.sim.randomizer import ResetRandomizer

NWORLD = 5
ALL = ("body_mass", "body_inertia", "dof_damping", "actuator_gear", "cam_pos", "light_pos")


@pytest.fixture
def make(small_scene, rows) -> Callable[..., ResetRandomizer]:
    """Return a function that makes a randomizer over a Model in which some fields have a row for each world."""

    def make_randomizer(*fields: str, nworld: int = NWORLD, graph: bool = True, **kwargs) -> ResetRandomizer:
        model, data = make_worlds(small_scene, nworld, fields=fields, nconmax=32, njmax=128)
        stored = StoredLayouts(small_scene, rows, nworld, seed=2)
        return ResetRandomizer(small_scene, model, data, layout_source=stored, graph=graph, **kwargs)

    return make_randomizer


def scaled(randomizer: ResetRandomizer, name: str, mask: np.ndarray) -> None:
    """Scale a field in the masked worlds by numbers drawn by its name."""
    array, factor = randomizer.model_field(name).numpy(), 0.5 + randomizer.random(name).numpy()
    nominal = np.reshape(getattr(randomizer.compiled.mjm, name), (1, *array.shape[1:]))
    values = nominal * factor.reshape(-1, *[1] * (array.ndim - 1))
    array[mask] = values[mask]  # NumPy's view of the memory of a CPU


@pytest.mark.usefixtures("recorded")
@pytest.mark.oldest
@pytest.mark.parametrize("graph", [True, False])
def test_steps_read_what_is_written_and_all_else_follows(make, small_scene, graph: bool):
    """Each world steps as MuJoCo C does with a model of its own, also after worlds were written to by a mask."""
    randomizer = make(*ALL, graph=graph)
    for name in ALL:
        randomizer.model_field(name)
    for mask in (np.ones(NWORLD, bool), np.array([True, False, True, False, False])):
        randomizer.reset(mask)
        for name in ALL:
            scaled(randomizer, name, mask)
        randomizer.refresh()
    m, d = randomizer.model, randomizer.data
    for world in range(NWORLD):
        mjm = copy.copy(small_scene.mjm)
        for name in ALL:
            getattr(mjm, name)[:] = getattr(m, name).numpy()[world]
        data = mujoco.MjData(mjm)
        mujoco.mj_setConst(mjm, data)
        for name in FOLLOWS:
            found, wanted = getattr(m, name).numpy()[world], getattr(mjm, name)
            np.testing.assert_allclose(found, wanted.reshape(found.shape), rtol=1e-5, atol=2e-6, err_msg=name)
        mujoco.mj_resetData(mjm, data)
        data.qpos[:], data.ctrl[:], data.act[:] = (array.numpy()[world] for array in (d.qpos, d.ctrl, d.act))
        data.mocap_pos[:], data.mocap_quat[:] = d.mocap_pos.numpy()[world], d.mocap_quat.numpy()[world]
        mujoco.mj_forward(mjm, data)
        assert np.abs(data.actuator_force[:2]).max() < 1e-4  # held by the gears of this world
        with wp.ScopedDevice("cpu"):
            mjw.forward(m, d)
        free = np.r_[0, 7:11]  # without the block, whose contact is a matter of rounding
        np.testing.assert_allclose(d.qacc.numpy()[world, free], data.qacc[free], rtol=1e-3, atol=2e-3)


def test_other_worlds_keep_every_bit_of_the_model(make):
    """Of the fields and of what follows from them."""
    randomizer = make(*ALL)
    for name in ALL:
        randomizer.model_field(name)
    mask, names = np.array([False, True, False, True, False]), {*ALL, *FOLLOWS}
    for now in (np.ones(NWORLD, bool), mask):
        before = {name: getattr(randomizer.model, name).numpy().copy() for name in names}
        randomizer.reset(now)
        for name in ALL:
            scaled(randomizer, name, now)
        randomizer.refresh()
    for name in names:
        after = getattr(randomizer.model, name).numpy()
        np.testing.assert_array_equal(after[~mask], before[name][~mask], err_msg=name)
        if before[name].size and name not in ("light_dir0", "cam_mat0"):
            assert (after[mask] != before[name][mask]).any(), name


@pytest.mark.usefixtures("recorded")
def test_values_are_those_of_seed_and_episode(make):
    """For another number of worlds, order and masks, with a graph and without: equal bits, derived fields too."""
    one, other = make(*ALL), make(*ALL, nworld=2, graph=False)
    names = {*ALL, *FOLLOWS}
    for randomizer, steps in ((one, [[0, 1, 2, 3, 4], [1, 4], [0]]), (other, [[0, 1], [0], [1]])):
        for name in ALL:
            randomizer.model_field(name)
        for worlds in steps:
            mask = np.isin(np.arange(randomizer.data.nworld), worlds)
            randomizer.reset(mask)
            for name in ALL:
                scaled(randomizer, name, mask)
            randomizer.refresh()
    np.testing.assert_array_equal(one.layouts.episode.numpy()[:2], other.layouts.episode.numpy())
    for name in names:
        np.testing.assert_array_equal(getattr(one.model, name).numpy()[:2], getattr(other.model, name).numpy(), name)


def test_a_model_with_one_row_is_refused_with_the_line_that_mends_it(make, make_randomizer):
    """Also where a field that follows has one row."""
    with pytest.raises(SceneMismatchError, match=r'make_worlds\(compiled, 4, fields=\("body_mass",\)\)'):
        make_randomizer(4).model_field("body_mass")
    randomizer = make()
    widen(randomizer.model, "body_mass", NWORLD)
    with pytest.raises(SceneMismatchError, match=r'make_worlds\(compiled, 5, fields=\("body_mass",\)\)'):
        randomizer.model_field("body_mass")


def test_late_requests_and_replaced_arrays_are_errors(make, small_scene):
    """As captured steps and resets would not see them."""
    randomizer = make("body_mass", "geom_friction")
    randomizer.model_field("body_mass", "block")
    randomizer.reset()
    assert randomizer.model_field("body_mass").shape == (NWORLD, small_scene.mjm.nbody)
    assert randomizer.model_field("geom_friction").shape[0] == NWORLD  # named to make_worlds
    with pytest.raises(ArgumentError, match="requested too late"):
        randomizer.model_field("dof_damping")
    for each in (randomizer, make("body_mass")):  # also before the first reset
        each.model.body_mass = wp.clone(each.model.body_mass)
        for call in (each.reset, each.refresh):
            with pytest.raises(FixedError, match="write into model_field"):
                call()


def test_factors_are_of_the_values_of_the_model(make, small_scene):
    """In the worlds of the latest reset alone, as often as it is; inertias follow, friction is that of sliding."""
    wanted = np.ones(NWORLD, np.float32)
    randomizer, block = make("body_mass", "geom_friction"), small_scene.mjm.body("block").id
    geom, factors = small_scene.mjm.body_geomadr[block], np.array([0.5, 1.0, 2.0, 3.0, 4.0], np.float32)
    for mask in (np.ones(NWORLD, bool), np.array([True, False, True, False, False])):
        randomizer.reset(mask)
        for name in ("body_mass", "geom_friction"):
            randomizer.scale_field(name, "block", wp.array(factors, dtype=float))
            randomizer.scale_field(name, "block", wp.to_torch(wp.array(factors, dtype=float)))
            randomizer.scale_field(name, "block", factors)
        randomizer.refresh()
        wanted, factors = np.where(mask, factors, wanted), factors[::-1].copy()
    m, mjm = randomizer.model, small_scene.mjm
    np.testing.assert_allclose(m.body_mass.numpy()[:, block], wanted * mjm.body_mass[block], rtol=1e-6)
    np.testing.assert_allclose(m.body_inertia.numpy()[:, block], np.outer(wanted, mjm.body_inertia[block]), rtol=1e-6)
    np.testing.assert_allclose(m.body_invweight0.numpy()[0, block, 0] * m.body_mass.numpy()[0, block], 1.0, rtol=1e-5)
    friction = m.geom_friction.numpy()[:, geom]
    np.testing.assert_allclose(friction[:, 0], wanted * mjm.geom_friction[geom, 0], rtol=1e-6)
    np.testing.assert_allclose(friction[:, 1:], np.tile(mjm.geom_friction[geom, 1:], (NWORLD, 1)), rtol=1e-6)
    others = np.delete(m.body_mass.numpy(), block, axis=1)
    np.testing.assert_array_equal(others, np.tile(others[0], (NWORLD, 1)))


def test_factors_of_another_shape_or_of_no_numbers_are_errors(make):
    """Named by the method that was called."""
    randomizer = make("body_mass", "geom_matid")
    randomizer.reset()
    with pytest.raises(ArgumentError, match=r"scale_field: factor should have shape \(5,\), got \(2,\)"):
        randomizer.scale_field("body_mass", "block", wp.ones(2, dtype=float))
    with pytest.raises(ArgumentError, match=r"factor should have shape \(5,\), got float"):
        randomizer.scale_field("body_mass", "block", 2.0)
    with pytest.raises(ArgumentError, match=r"scale_field: factor should hold float32, got float64"):
        randomizer.scale_field("body_mass", "block", wp.ones(NWORLD, dtype=wp.float64))
    ones = wp.ones(NWORLD, dtype=float)
    with pytest.raises(ArgumentError, match=r"mask should have shape \(5,\), got \(2,\)"):
        randomizer.fields.scale("body_mass", "block", ones, wp.ones(2, dtype=wp.bool), "scale_field")
    with pytest.raises(ArgumentError, match=r"'geom_matid' has no floats to scale"):
        randomizer.scale_field("geom_matid", "block", ones)


def test_a_capture_follows_a_first_call_with_the_same_names(make, small_scene):
    """The first call prepares it; a graph reads the factors of the moment."""
    randomizer, block = make("body_mass"), small_scene.mjm.body("block").id
    randomizer.reset()
    factors = wp.ones(NWORLD, dtype=float, device="cpu")
    with pytest.raises(ArgumentError, match="'body_mass' of 'block' should be scaled once"), wp.ScopedCapture("cpu"):
        randomizer.scale_field("body_mass", "block", factors)
    randomizer.scale_field("body_mass", "block", factors)
    with wp.ScopedCapture("cpu") as capture:
        randomizer.scale_field("body_mass", "block", factors)
    factors.fill_(3.0)
    wp.capture_launch(capture.graph)
    mass = randomizer.model.body_mass.numpy()[:, block]
    np.testing.assert_allclose(mass, np.full(NWORLD, 3.0 * small_scene.mjm.body_mass[block]), rtol=1e-6)


def test_fields_of_the_options_have_rows_too(make):
    """Gravity of each world."""
    randomizer = make("gravity", needs=("dynamics",))
    gravity = randomizer.model_field("gravity")
    assert gravity.shape == (NWORLD, 3)
    randomizer.reset()
    gravity.numpy()[1] = 0.0
    randomizer.refresh()
    weight = randomizer.data.qfrc_bias.numpy()[:, 3]
    np.testing.assert_allclose(weight, [0.981, 0.0, 0.981, 0.981, 0.981], atol=1e-5)


def test_arrays_that_are_read_are_torch_tensors(make):
    """Fields, counts and variants share memory with what launches write to; numbers by name are the caller's own."""
    randomizer = make("body_mass")
    counts, variants = randomizer.redrawer.counts, randomizer._writer.variant
    shared = {"redraw_count": counts.number, "redraw_status": counts.status, "variants": variants}
    for name, array in shared.items():
        assert getattr(randomizer, name) is getattr(randomizer, name)
        assert (getattr(randomizer, name).data_ptr(), getattr(randomizer, name).dtype) == (array.ptr or 0, torch.int32)
        with pytest.raises(FixedError, match=rf"ResetRandomizer\.{name} cannot be changed"):
            setattr(randomizer, name, None)
    for name, array in counts._asdict().items():
        assert getattr(randomizer.redrawer, name).data_ptr() == array.ptr
    assert randomizer.model_field("body_mass").data_ptr() == randomizer.model.body_mass.ptr
    drawn = randomizer.random("mass", (2, 3))
    assert (drawn.shape, drawn.dtype) == ((NWORLD, 2, 3), torch.float32)
    assert torch.equal(drawn, randomizer.random("mass", (2, 3)))


def test_unknown_fields_are_told_before_a_model_is_made(small_scene):
    """By their nearest names."""
    with pytest.raises(UnknownNameError, match="Did you mean 'geom_friction'"):
        make_worlds(small_scene, 3, fields="geom_frictions")
    with pytest.raises(ArgumentTypeError, match="make_worlds: fields"):
        make_worlds(small_scene, 3, fields=(("body_mass",),))  # pyrefly: ignore[bad-argument-type]
