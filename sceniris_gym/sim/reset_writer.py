"""`ResetWriter`: writes layouts into the masked worlds, draws the worlds' physics, and removes old contacts."""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.model_fields import ModelFields
from sceniris_gym.sim.rest import RestMap, close_grippers
from sceniris_gym.sim.variants import VariantWriter
from sceniris_gym.sim.versions import keyframe_plastic
from sceniris_gym.sim.write import StateWriter, poses_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LANES = 32
"""Threads that clear the constraint rows of a world."""


@wp.struct
class Words:
    """The memory of a contact field: the address of the first contact's value, and the value's size in 32-bit words."""

    address: wp.uint64
    width: int


@wp.kernel
def _mark_kept(mask: wp.array[wp.bool], nacon: wp.array[int], worldid: wp.array[int], kept_out: wp.array[int]):
    conid = wp.tid()
    kept = int(0)
    if conid < nacon[0]:
        if not mask[worldid[conid]]:
            kept = 1
    kept_out[conid] = kept


@wp.kernel
def _list_movers(kept: wp.array[int], rank: wp.array[int], mover_out: wp.array[int], nacon_out: wp.array[int]):
    conid = wp.tid()
    room = rank.shape[0]
    total = rank[room - 1]
    # a count above the room means that contacts were lost, so it stays, unless this drop frees enough room
    if conid == 0 and total < wp.min(nacon_out[0], room):
        nacon_out[0] = total
    if conid >= total and kept[conid] != 0:
        mover_out[rank[conid] - rank[total - 1] - 1] = conid


@wp.kernel
def _fill_holes(
    kept: wp.array[int],
    rank: wp.array[int],
    mover: wp.array[int],
    fields: wp.array[Words],
    worldid: wp.array[int],
    efc_address: wp.array2d[int],
    efc_id_out: wp.array2d[int],
):
    conid = wp.tid()
    if conid >= rank[rank.shape[0] - 1] or kept[conid] != 0:
        return
    source = mover[conid - rank[conid]]  # `conid - rank` is the number of earlier holes
    for i in range(fields.shape[0]):
        words = wp.array(ptr=fields[i].address, shape=(wp.max(source, conid) + 1, fields[i].width), dtype=int)
        for k in range(fields[i].width):
            words[conid, k] = words[source, k]
    world = worldid[conid]
    for i in range(efc_address.shape[1]):
        row = efc_address[conid, i]
        # addresses are from the last constraint pass, and rows beyond njmax were never made
        if row >= 0 and row < efc_id_out.shape[1]:
            if efc_id_out[world, row] == source:
                efc_id_out[world, row] = conid


@wp.kernel
def _clear_rows(mask: wp.array[wp.bool], j_out: wp.array3d[float], d_out: wp.array2d[float]):
    worldid, lane = wp.tid()
    if not mask[worldid]:
        return
    width = j_out.shape[2]
    for i in range(lane, j_out.shape[1] * width, LANES):
        j_out[worldid, i // width, i % width] = 0.0
    for i in range(lane, d_out.shape[1], LANES):
        d_out[worldid, i] = 0.0


class ContactList:
    """Drops the contacts of the masked worlds from the contact list of all worlds.

    `mjw.reset_data` overwrites the contacts of reset worlds in place. They remain in the list and count as contacts
    between geoms (0, 0) of world 0. `launch_drop` removes them instead: it moves the last contacts of other worlds into
    the free places, and sets `nacon` to the number of remaining contacts. Remaining contacts keep their values, but
    not always their order. In the constraint rows, `efc.id` is set to the new ids of the moved contacts. The same
    input gives the same list.

    `mjw.reset_data` does not clear constraint rows. The solver reads rows in tiles of 16, including rows beyond the
    last constraint. NaNs in the rows of a world would therefore return with the world's first constraint after a reset,
    so `launch_drop` also clears the rows of the masked worlds.

    Launches do not wait for the device, so they can be captured in a graph.

    Args:
        d: The Data. Launches use its arrays in place. The constructor allocates three integers per contact.
        mask: Worlds whose contacts are dropped, shape (nworld,), bool. Every launch reads it.
    """

    def __init__(self, d: mjw.Data, mask: wp.array) -> None:
        self._d, self._mask = d, mask
        room, device = d.contact.worldid.shape[0], d.nacon.device
        self._kept, self._rank, self._mover = (wp.zeros(room, dtype=wp.int32, device=device) for _ in range(3))
        fields = [getattr(d.contact, field.name) for field in dataclasses.fields(d.contact)]
        words = [(a.ptr, a.strides[0] // 4) for a in fields if isinstance(a, wp.array) and a.size > 0]
        # pyrefly: ignore[missing-attribute]
        self._words = wp.array(np.array(words, Words.numpy_dtype()), dtype=Words, device=device)

    def launch_drop(self) -> None:
        """Drop the contacts of the masked worlds, and zero the Jacobian and `D` of their constraint rows."""
        d, mask, room = self._d, self._mask, self._rank.shape[0]
        with wp.ScopedDevice(d.nacon.device):
            wp.launch(_clear_rows, (d.nworld, LANES), inputs=[mask], outputs=[d.efc.J, d.efc.D])
            if room == 0:
                return
            wp.launch(_mark_kept, room, inputs=[mask, d.nacon, d.contact.worldid], outputs=[self._kept])
            wp.utils.array_scan(self._kept, self._rank, inclusive=True)
            wp.launch(_list_movers, room, inputs=[self._kept, self._rank], outputs=[self._mover, d.nacon])
            inputs = [self._kept, self._rank, self._mover, self._words, d.contact.worldid, d.contact.efc_address]
            wp.launch(_fill_holes, room, inputs=inputs, outputs=[d.efc.id])


class Simulation(NamedTuple):
    """The simulated worlds of a scene, with everything that is needed to write into them.

    Attributes:
        compiled: The scene.
        model: The Model of the worlds.
        data: Data of the worlds. Launches use its arrays in place.
        split: The split of the layouts.
        rest: The RestMap of the worlds: controls and activations that hold a pose.
        refresh: Function without arguments. Writers call it after each write, to update the arrays computed from the
            state.
        origins: Origins of the worlds [m], shape (nworld,), vec3, or None for the world frame.
        variants: The VariantWriter, or None in a scene without variants.
    """

    compiled: CompiledScene
    model: mjw.Model
    data: mjw.Data
    split: str
    rest: RestMap
    refresh: Callable[[], None]
    origins: wp.array | None = None
    variants: VariantWriter | None = None


class ResetWriter:
    """Writes all changes of a reset into the masked worlds.

    Args:
        simulation: The worlds.
        fields: The ModelFields of the worlds.
        mask: Worlds to write into, shape (nworld,), bool. Every launch reads it.
        whole: If true, resets write whole worlds. If false, they write only the objects and robots of the scene.
        count: Counters, one per world, that a reset sets to 0, shape (nworld,), int32.

    Attributes:
        contacts: The ContactList of all worlds.
        variants: The VariantWriter, or None in a scene without variants.
        variant: Index of the present variant of each object with variants, see `VariantWriter.variant`.
    """

    def __init__(
        self, simulation: Simulation, fields: ModelFields, mask: wp.array, *, whole: bool, count: wp.array
    ) -> None:
        self._simulation, self._fields, self._mask, self._whole = simulation, fields, mask, whole
        compiled, d, self.variants = simulation.compiled, simulation.data, simulation.variants
        self._has_starts = bool(compiled.config.start)
        scene, mjm = compiled.scene.sim, compiled.sim_mjm
        with wp.ScopedDevice(d.qpos.device):
            self._nacon = wp.zeros_like(d.nacon)
            self.variant = wp.zeros((d.nworld, 0), dtype=int) if self.variants is None else self.variants.variant
        plastic = keyframe_plastic(mjm, scene.keyframe) if whole and scene.keyframe >= 0 else None
        bodies = None if whole else [body for name in scene.bodies for body in scene.subtree(name)]
        self.contacts = ContactList(d, mask)
        close_grippers(simulation.rest, compiled, compiled.sim_mjm)
        written = {"bodies": bodies, "origins": simulation.origins, "plastic": plastic, "count": count}
        self._writer = StateWriter(mjm, d, mask, simulation.rest, **written)

    def launch(self, layouts: LayoutsView, rows: wp.array | None = None) -> None:
        """Write layouts into the masked worlds.

        Args:
            layouts: The layouts. If they hold no values of params, physics are drawn from the scene file's ranges.
            rows: Row of `layouts` for each masked world, shape (nworld,), int32. None gives world i row i.
        """
        m, d, poses, pose_rows = self._simulation.model, self._simulation.data, poses_of(layouts), rows
        if self.variants is not None:
            poses, pose_rows = self.variants.launch(poses, self._mask, layouts.present, rows), None
        self._fields.launch_draw(self._mask, layouts, rows)
        self.contacts.launch_drop()
        if self._whole:
            # reset_data zeroes the contact count of all worlds when it resets world 0
            wp.copy(self._nacon, d.nacon)
            mjw.reset_data(m, d, reset=self._mask)
            wp.copy(d.nacon, self._nacon)
        self._writer.launch(poses, pose_rows, layouts if self._has_starts else None, rows)
        self._fields.launch_wait()
        self._fields.launch_bear(self._mask)
        self._simulation.refresh()
