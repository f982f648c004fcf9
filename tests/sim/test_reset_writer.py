"""Resets that leave the other worlds alone: their state, their contacts, and arrays that are computed from it."""

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest

from sceniris_gym.sim.randomizer import PROMISED
from tests.sim.stepping import DERIVED, STATE, snapshot, step


def contacts_of(d: mjw.Data, world: int) -> set[bytes]:
    """Return the listed contacts of a world as the bytes of what describes them."""
    number, fields = int(d.nacon.numpy()[0]), ("dist", "pos", "frame", "friction", "geom", "type", "efc_address")
    columns = [getattr(d.contact, name).numpy()[:number] for name in fields]
    listed = np.flatnonzero(d.contact.worldid.numpy()[:number] == world)
    return {b"".join(column[i].tobytes() for column in columns) for i in listed}


@pytest.mark.parametrize("graph", [True, False])
@pytest.mark.parametrize("mask", [[1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 1, 0], [1, 0, 1, 1]])
def test_a_reset_leaves_no_ghost_contacts(make_randomizer, mask, graph):
    """Contacts of reset worlds are gone, those of the others are the same ones, and the count counts nothing else."""
    randomizer = make_randomizer(4, graph=graph)
    randomizer.reset()
    step(randomizer)
    before = [contacts_of(randomizer.data, world) for world in range(4)]
    assert all(before)
    randomizer.reset(np.array(mask, bool))
    for world in range(4):
        assert contacts_of(randomizer.data, world) == (set() if mask[world] else before[world])
    assert int(randomizer.data.nacon.numpy()[0]) == sum(len(before[world]) for world in range(4) if not mask[world])


def test_after_a_reset_of_all_worlds_there_are_no_contacts(make_randomizer):
    """The count is 0 until something collides; with needs=["contacts"] it is the number that collide now."""
    plain, current = make_randomizer(3), make_randomizer(3, needs=["contacts"])
    for randomizer in (plain, current):
        randomizer.reset()
        step(randomizer)
        assert int(randomizer.data.nacon.numpy()[0]) > 0
        randomizer.reset()
    assert int(plain.data.nacon.numpy()[0]) == 0
    mjw.kinematics(plain.model, plain.data)
    mjw.com_pos(plain.model, plain.data)
    mjw.collision(plain.model, plain.data)
    for world in range(3):
        assert contacts_of(current.data, world) == contacts_of(plain.data, world)


@pytest.mark.oldest
def test_other_worlds_stay_the_same_to_the_bit(make_randomizer):
    """A masked reset changes nothing in the worlds that are not masked."""
    randomizer = make_randomizer(4)
    randomizer.reset()
    step(randomizer)
    before = snapshot(randomizer.data)
    randomizer.reset(np.array([True, False, True, False]))
    after = snapshot(randomizer.data)
    for name in STATE + DERIVED:
        np.testing.assert_array_equal(after[name][[1, 3]], before[name][[1, 3]], err_msg=name)
    assert not np.array_equal(after["qpos"][[0, 2]], before["qpos"][[0, 2]])


def test_other_worlds_go_on_as_if_nothing_had_been_reset(make_randomizer):
    """After resets of some worlds the others step to the same bits as in a batch without resets, contacts included."""
    disturbed, quiet = make_randomizer(4), make_randomizer(4)
    for randomizer in (disturbed, quiet):
        randomizer.reset()
    for mask in ([1, 0, 0, 0], [1, 0, 1, 0], [0, 0, 1, 0]):
        for randomizer in (disturbed, quiet):
            for _ in range(3):  # a bare loop: kinematics lag a step behind
                mjw.step(randomizer.model, randomizer.data)
        disturbed.reset(np.array(mask, bool))
        for name in PROMISED:
            found, expected = (getattr(r.data, name).numpy()[[1, 3]] for r in (disturbed, quiet))
            np.testing.assert_array_equal(found, expected, err_msg=name)


def test_derived_arrays_are_made_current_in_all_worlds(make_randomizer):
    """In a bare loop xpos is a step older than qpos; after a reset it belongs to qpos in the other worlds too."""
    randomizer = make_randomizer(2)
    randomizer.reset()
    randomizer.data.qvel.fill_(0.5)
    mjw.step(randomizer.model, randomizer.data)
    before = randomizer.data.xpos.numpy()[1].copy()
    randomizer.reset(np.array([True, False]))
    mjm = randomizer.compiled.mjm
    data = mujoco.MjData(mjm)
    data.qpos[:] = randomizer.data.qpos.numpy()[1]
    data.mocap_pos[:] = randomizer.data.mocap_pos.numpy()[1]
    data.mocap_quat[:] = randomizer.data.mocap_quat.numpy()[1]
    mujoco.mj_kinematics(mjm, data)
    np.testing.assert_allclose(randomizer.data.xpos.numpy()[1], data.xpos, atol=1e-6)
    assert np.abs(before - data.xpos).max() > 1e-4


def test_a_world_with_nans_is_cured(make_randomizer, rows):
    """After its reset a broken world steps exactly as a sound one does."""
    sick, sound = make_randomizer(2, seed=[4, 4]), make_randomizer(2, seed=[4, 4])
    for randomizer in (sick, sound):
        randomizer.reset()
        step(randomizer)
    d = sick.data
    for name in ("qpos", "qvel", "act", "ctrl", "qacc_warmstart", "qacc", "qfrc_applied", "M", "xfrc_applied"):
        values = getattr(d, name).numpy()
        values[1] = np.nan
        getattr(d, name).assign(values)
    step(sick)
    assert np.isnan(d.qpos.numpy()[1]).any()
    for randomizer in (sick, sound):
        randomizer.reset()
        step(randomizer)
    assert np.isfinite(sick.data.qpos.numpy()).all()
    np.testing.assert_array_equal(sick.data.qpos.numpy(), sound.data.qpos.numpy())


def test_the_arm_stays_where_it_was_placed(make_randomizer, rows):
    """Position actuators hold the sampled pose, over a gear and a tendon too: half a second later nothing moved."""
    randomizer = make_randomizer(7)
    randomizer.reset()
    placed = randomizer.data.qpos.numpy()[:, 8:12].copy()
    step(randomizer, 100)
    np.testing.assert_allclose(randomizer.data.qpos.numpy()[:, 8:12], placed, atol=2e-3)
    np.testing.assert_allclose(placed, rows.qpos[:, 8:12])
