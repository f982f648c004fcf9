"""Takes the contacts of some worlds out of the list that all worlds share."""

from __future__ import annotations

import dataclasses

import mujoco_warp as mjw
import warp as wp

wp.set_module_options({"enable_backward": False})

FIELDS_A_LAUNCH = 10
"""Fields of a contact that one launch of `_fill_holes` copies."""


@wp.func
def _is_kept(rank: wp.array[int], conid: int) -> bool:
    before = int(0)
    if conid > 0:
        before = rank[conid - 1]
    return rank[conid] != before


@wp.func
def _copy_words(words: wp.array2d[int], source: int, target: int):
    for i in range(words.shape[1]):
        words[target, i] = words[source, i]


@wp.kernel
def _mark_kept(mask: wp.array[wp.bool], nacon: wp.array[int], worldid: wp.array[int], kept_out: wp.array[int]):
    conid = wp.tid()
    kept = int(0)
    if conid < nacon[0]:
        if not mask[worldid[conid]]:
            kept = 1
    kept_out[conid] = kept


@wp.kernel
def _list_movers(rank: wp.array[int], mover_out: wp.array[int], nacon_out: wp.array[int]):
    conid = wp.tid()
    room = rank.shape[0]
    total = rank[room - 1]
    # a count above the room tells that contacts were lost; it stays if there was nothing to drop
    if conid == 0 and total < wp.min(nacon_out[0], room):
        nacon_out[0] = total
    if conid >= total and _is_kept(rank, conid):
        mover_out[rank[conid] - rank[total - 1] - 1] = conid


@wp.kernel
def _fill_holes(
    rank: wp.array[int],
    mover: wp.array[int],
    # In and out: fields of contacts, each of which may have no columns
    a: wp.array2d[int],
    b: wp.array2d[int],
    c: wp.array2d[int],
    d: wp.array2d[int],
    e: wp.array2d[int],
    f: wp.array2d[int],
    g: wp.array2d[int],
    h: wp.array2d[int],
    i: wp.array2d[int],
    j: wp.array2d[int],
):
    conid = wp.tid()
    if conid >= rank[rank.shape[0] - 1] or _is_kept(rank, conid):
        return
    source = mover[conid - rank[conid]]  # as many holes lie before this one
    _copy_words(a, source, conid)
    _copy_words(b, source, conid)
    _copy_words(c, source, conid)
    _copy_words(d, source, conid)
    _copy_words(e, source, conid)
    _copy_words(f, source, conid)
    _copy_words(g, source, conid)
    _copy_words(h, source, conid)
    _copy_words(i, source, conid)
    _copy_words(j, source, conid)


@wp.kernel
def _renumber_rows(
    rank: wp.array[int],
    mover: wp.array[int],
    worldid: wp.array[int],
    efc_address: wp.array2d[int],
    efc_id_out: wp.array2d[int],
):
    conid = wp.tid()
    if conid >= rank[rank.shape[0] - 1] or _is_kept(rank, conid):
        return
    world, source = worldid[conid], mover[conid - rank[conid]]
    for i in range(efc_address.shape[1]):
        row = efc_address[conid, i]
        # addresses are from the last constraint pass, and rows beyond njmax were never made
        if row >= 0 and row < efc_id_out.shape[1]:
            if efc_id_out[world, row] == source:
                efc_id_out[world, row] = conid


class ContactList:
    """The contacts of all worlds, from which those of some worlds can be dropped.

    `mjw.reset_data` overwrites contacts of reset worlds where they are listed, so they count on as contacts between
    geoms (0, 0) of world 0. Here they leave the list instead: the last contacts of other worlds move into the places
    that become free, and `nacon` counts those that are left. The contacts that stay keep their bits, but not always
    their order, and constraint rows (`efc.id`) follow those that move. The same input gives the same list.

    Nothing waits for the device, so it can be captured in a graph.

    Args:
        d: The data; its arrays are used in place. Three integers per contact are allocated.
    """

    def __init__(self, d: mjw.Data) -> None:
        self._d = d
        room, device = d.contact.worldid.shape[0], d.nacon.device
        self._kept, self._rank, self._mover = (wp.zeros(room, dtype=wp.int32, device=device) for _ in range(3))
        fields = [getattr(d.contact, field.name) for field in dataclasses.fields(d.contact)]
        words = [_as_words(field) for field in fields if isinstance(field, wp.array) and field.size > 0]
        empty = wp.empty((room, 0), dtype=wp.int32, device=device)
        words += [empty] * (-len(words) % FIELDS_A_LAUNCH)
        self._words = [words[first : first + FIELDS_A_LAUNCH] for first in range(0, len(words), FIELDS_A_LAUNCH)]

    def launch_drop(self, mask: wp.array) -> None:
        """Drop the contacts of the worlds in `mask`, shape (nworld,), bool."""
        room, contact, nacon = self._rank.shape[0], self._d.contact, self._d.nacon
        if room == 0:
            return
        moves = [self._rank, self._mover]
        with wp.ScopedDevice(nacon.device):
            wp.launch(_mark_kept, room, inputs=[mask, nacon, contact.worldid], outputs=[self._kept])
            wp.utils.array_scan(self._kept, self._rank, inclusive=True)
            wp.launch(_list_movers, room, inputs=[self._rank], outputs=[self._mover, nacon])
            for words in self._words:
                wp.launch(_fill_holes, room, inputs=[*moves, *words])
            rows = [contact.worldid, contact.efc_address]
            wp.launch(_renumber_rows, room, inputs=[*moves, *rows], outputs=[self._d.efc.id])


def _as_words(field: wp.array) -> wp.array:
    """Return an array of one row per contact as its 32-bit words, shape (naconmax, words), in the same memory."""
    shape = (field.shape[0], field.strides[0] // 4)
    view = wp.array(ptr=field.ptr, dtype=wp.int32, shape=shape, device=field.device)
    view._ref = field  # the memory is the field's
    return view
