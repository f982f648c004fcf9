"""Contacts and constraint rows at a reset: those of reset worlds go, and those of the others stay."""

from __future__ import annotations

import dataclasses

import mujoco
import mujoco_warp as mjw
import numpy as np
import pytest
import warp as wp

from sceniris_gym.device.sequence import LaunchSequence
from sceniris_gym.sim.contacts import ContactList

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
        drop()
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
