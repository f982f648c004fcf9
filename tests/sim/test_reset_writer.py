"""Resets that leave the other worlds alone: their state, their contacts, and arrays that are computed from it."""

from __future__ import annotations

import dataclasses

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.device.sequence import LaunchSequence
from sceniris_gym.sim.randomizer import ResetRandomizer
from sceniris_gym.sim.reset_writer import ContactList
from tests.sim.stepping import DERIVED, STATE, snapshot, step


def contacts_of(d: mjw.Data, world: int) -> set[bytes]:
    """Return the listed contacts of a world as the bytes of what describes them."""
    number, fields = int(d.nacon.numpy()[0]), ("dist", "pos", "frame", "friction", "geom", "type", "efc_address")
    columns = [getattr(d.contact, name).numpy()[:number] for name in fields]
    listed = np.flatnonzero(d.contact.worldid.numpy()[:number] == world)
    return {b"".join(column[i].tobytes() for column in columns) for i in listed}


@pytest.mark.usefixtures("recorded")
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
        for name in ResetRandomizer.STATE_FIELDS:
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


NWORLD = 5
BALL = """
<mujoco><option cone="{cone}" jacobian="{jacobian}"/>
<worldbody><geom type="plane" size="1 1 1"/><body><freejoint/><geom size="0.1"/></body>
</worldbody></mujoco>
"""


def made(number: int, room: int, seed: int = 0, cone: str = "pyramidal", device: str = "cpu") -> mjw.Data:
    """Return data with room for `room` contacts and `number` of them counted, all their fields random bits."""
    mjm = mujoco.MjModel.from_xml_string(BALL.format(cone=cone, jacobian="auto"))
    rng = np.random.default_rng(seed)
    with wp.ScopedDevice(device):
        d = mjw.make_data(mjm, NWORLD, naconmax=room, njmax=max(1, 8 * room))
        for field in dataclasses.fields(d.contact):
            array = getattr(d.contact, field.name)
            bits = rng.integers(-(2**31), 2**31, array.numpy().shape)
            array.assign(bits.astype(np.int32).view(array.numpy().dtype) if array.size else array.numpy())
        d.contact.worldid.assign(rng.integers(0, NWORLD, room).astype(np.int32))
        d.nacon.assign(np.array([number], np.int32))
        # each contact has constraint rows of its own in its world, and they know it
        width = d.contact.efc_address.shape[1]
        address = np.arange(room * width, dtype=np.int32).reshape(room, width)
        address[:, -1] = -1
        ids = np.full(d.efc.id.shape, -1, np.int32)
        for conid, world in enumerate(d.contact.worldid.numpy()[:number]):
            ids[world, address[conid, :-1]] = conid
        d.contact.efc_address.assign(address)
        d.efc.id.assign(ids)
    return d


def listed(d: mjw.Data) -> list[bytes]:
    """Return the listed contacts as the bytes of all their fields."""
    number = min(int(d.nacon.numpy()[0]), d.naconmax)
    fields = [getattr(d.contact, field.name).numpy() for field in dataclasses.fields(d.contact)]
    return [b"".join(field[i].tobytes() for field in fields if field.size) for i in range(number)]


@pytest.mark.usefixtures("recorded")
@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda:0", marks=pytest.mark.cuda)])
@pytest.mark.parametrize("graph", [False, True])
@pytest.mark.parametrize(
    ("number", "room"), [(0, 1), (1, 1), (1, 40), (7, 7), (33, 40), (40, 40), (90, 40), (700, 1000)]
)
def test_contacts_of_masked_worlds_leave_and_others_stay(number: int, room: int, graph: bool, device: str):
    """Every mask of worlds: what stays is exactly what belongs to the other worlds, bit for bit; the rest is gone."""
    for bits in range(2**NWORLD):
        mask = (bits >> np.arange(NWORLD)) % 2 == 1
        d = made(number, room, seed=bits, device=device)
        worlds = d.contact.worldid.numpy()[:number].copy()
        before = listed(d)
        contacts = ContactList(d, wp.array(mask, dtype=wp.bool, device=device))
        drop = LaunchSequence(contacts.launch_drop, wp.get_device(device), graph=graph)
        drop.replay()
        kept = [contact for contact, world in zip(before, worlds, strict=False) if not mask[world]]
        assert sorted(listed(d)) == sorted(kept)
        if not mask[worlds].any():
            assert listed(d) == before
            assert int(d.nacon.numpy()[0]) == number, "a count beyond the room tells that contacts were lost"
        else:
            assert int(d.nacon.numpy()[0]) == len(kept)
        if graph and bits > 8:
            break


@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_constraint_rows_follow_their_contacts(cone: str):
    """A row of a world that stays names the place at which its contact is listed now."""
    d = made(60, 80, cone=cone)
    ContactList(d, wp.array([True, False, False, True, False], dtype=wp.bool, device="cpu")).launch_drop()
    ids, worlds = d.efc.id.numpy(), d.contact.worldid.numpy()
    assert 0 < d.nacon.numpy()[0] < 60
    for conid in range(int(d.nacon.numpy()[0])):
        for row in d.contact.efc_address.numpy()[conid]:
            assert row < 0 or ids[worlds[conid], row] == conid


def test_the_first_contacts_keep_their_places():
    """Contacts that need not move stay where they are, and the same list gives the same list again."""
    mask = wp.array([False, True, False, False, True], dtype=wp.bool, device="cpu")
    lists = []
    for _ in range(2):
        d = made(60, 80)
        before, stays = listed(d), ~np.isin(d.contact.worldid.numpy()[:60], [1, 4])
        ContactList(d, mask).launch_drop()
        after = listed(d)
        for conid in np.flatnonzero(stays[: len(after)]):
            assert after[conid] == before[conid]
        lists.append(after)
    assert lists[0] == lists[1]


def test_data_without_room_for_contacts_is_left_alone():
    """A model whose data has no place for a contact has none to drop."""
    mjm = mujoco.MjModel.from_xml_string("<mujoco><worldbody><body mocap='true'/></worldbody></mujoco>")
    with wp.ScopedDevice("cpu"):
        d = mjw.make_data(mjm, NWORLD, naconmax=0, njmax=1)
        ContactList(d, wp.ones(NWORLD, dtype=wp.bool)).launch_drop()
    assert d.nacon.numpy()[0] == 0


@pytest.mark.parametrize("jacobian", ["dense", "sparse"])
def test_rows_of_masked_worlds_are_zero_and_others_stay(jacobian: str):
    """Jacobian and mass of all rows, those that only fill a tile included."""
    mjm = mujoco.MjModel.from_xml_string(BALL.format(cone="pyramidal", jacobian=jacobian))
    with wp.ScopedDevice("cpu"):
        d = mjw.make_data(mjm, 3, njmax=37)
        for array in (d.efc.J, d.efc.D):
            array.fill_(float("nan"))
        ContactList(d, wp.array([True, False, True], dtype=wp.bool)).launch_drop()
    for array in (d.efc.J, d.efc.D):
        assert array.size > 0
        assert not array.numpy()[[0, 2]].any()
        assert np.isnan(array.numpy()[1]).all()
