"""`ResetWriter`: writes rows of layouts into the masked worlds, draws their physics, and removes their contacts."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

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
    """The memory of a field of contacts: the address of the first one, and the 32-bit words of each."""

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
    # a count above the room says that contacts were lost; it stays if there was nothing to drop
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
    source = mover[conid - rank[conid]]  # as many holes lie before this one
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
    """The contacts of all worlds, from which those of the masked worlds can be dropped.

    `mjw.reset_data` overwrites contacts of reset worlds where they are listed, so they still count, as contacts between
    geoms (0, 0) of world 0. `launch_drop` removes them from the list instead: the last contacts of other worlds move
    into the free places, and `nacon` counts those that are left. The contacts that stay keep their bits, but not always
    their order, and constraint rows (`efc.id`) follow those that move. The same input gives the same list.

    `mjw.reset_data` also leaves constraint rows as they are. The solver reads rows by tiles of 16, those behind the
    last constraint too, so NaNs of a broken world would come back with the first constraint after its reset.

    Nothing waits for the device, so it can be captured in a graph.

    Args:
        d: The data; its arrays are used in place. Three integers per contact are allocated.
        mask: The worlds whose contacts are dropped, shape (nworld,), bool; read at every launch.
    """

    def __init__(self, d: mjw.Data, mask: wp.array) -> None:
        self._d, self._mask = d, mask
        room, device = d.contact.worldid.shape[0], d.nacon.device
        self._kept, self._rank, self._mover = (wp.zeros(room, dtype=wp.int32, device=device) for _ in range(3))
        fields = [getattr(d.contact, field.name) for field in dataclasses.fields(d.contact)]
        words = [(a.ptr, a.strides[0] // 4) for a in fields if isinstance(a, wp.array) and a.size > 0]
        self._words = wp.array(np.array(words, Words.numpy_dtype()), dtype=Words, device=device)

    def launch_drop(self) -> None:
        """Drop the contacts of the masked worlds, and zero the Jacobian and the mass of their constraint rows."""
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


@dataclass(frozen=True)
class Simulation:
    """The worlds of a scene, and what belongs to all that is written into them.

    Attributes:
        compiled: The scene.
        model: Its model.
        data: Data of the worlds; its arrays are used in place.
        split: The split of the layouts.
        rest: Controls and activations at rest.
        refresh: Launches that follow, and bring up to date what is computed from the state.
        origins: Origins of the worlds [m], shape (nworld,), vec3; None adds nothing.
        variants: The writer of variants, None in a scene without.
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
    """Writer of all that a reset changes in the masked worlds.

    Args:
        simulation: The worlds.
        fields: The fields of the model that have a row for each world.
        mask: The worlds to write into, shape (nworld,), bool; read at every launch.
        whole: Reset worlds as a whole, rather than the objects and robots of the scene alone.
        count: A count of each world that begins at 0 again, shape (nworld,), int32.

    Attributes:
        variants: The writer of variants, None in a scene without.
        variant: The variant of each object that is present, as `VariantWriter.variant`.
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
        self._contacts = ContactList(d, mask)
        close_grippers(simulation.rest, compiled)
        words = {"bodies": bodies, "origins": simulation.origins, "plastic": plastic, "count": count}
        self._writer = StateWriter(mjm, d, mask, simulation.rest, **words)

    def launch(self, layouts: LayoutsView, rows: wp.array | None = None) -> None:
        """Write layouts into the masked worlds.

        Args:
            layouts: The layouts, with their params; without these they have those of the scene file.
            rows: Row of `layouts` for every masked world, shape (nworld,), int32; None gives world i row i.
        """
        m, d, poses, pose_rows = self._simulation.model, self._simulation.data, poses_of(layouts), rows
        if self.variants is not None:
            poses, pose_rows = self.variants.launch(poses, self._mask, layouts.present, rows), None
        self._fields.launch_draw(self._mask, layouts, rows)
        self._contacts.launch_drop()
        if self._whole:
            # reset_data zeroes the contact count of all worlds when it resets world 0
            wp.copy(self._nacon, d.nacon)
            mjw.reset_data(m, d, reset=self._mask)
            wp.copy(d.nacon, self._nacon)
        self._writer.launch(poses, pose_rows, layouts.start if self._has_starts else None, rows)
        self._fields.launch_wait()
        self._simulation.refresh()
