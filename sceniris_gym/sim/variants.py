"""`VariantWriter`: turns layouts into those of the simulated scene, and bodies into the variants that are present."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.device.blocks import block_sync
from sceniris_gym.errors import SceneMismatchError
from sceniris_gym.layout.masks import row_of
from sceniris_gym.program.plan import slot_names
from sceniris_gym.scene.draws import nominal_values
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.variants import places_of_geoms
from sceniris_gym.sim.write import Poses

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

LANES = 512
"""Lanes that read or write a world: each waits for memory once a word."""
_BODY = ("mass", "inertia", "ipos", "iquat", "invweight0", "subtreemass", "gravcomp")
_DOF = ("invweight0", "armature", "damping", "dampingpoly", "frictionloss")
_GEOM = (
    *("dataid", "matid", "solmix", "solref", "solimp", "size", "aabb", "rbound", "pos", "quat", "friction"),
    *("margin", "gap", "surfacevel", "adhesion", "rgba"),
)
# Values of a geom that a variant has no use for; without a mesh and with this margin [m] it meets nothing.
_UNUSED = {"dataid": -1, "matid": -1, "margin": -1.0e6, "rgba": 0.0}


def fields_of_variants() -> tuple[str, ...]:
    """Return the fields of a mujoco_warp Model in which variants differ, as far as this version has them."""
    named = (("body", _BODY), ("dof", _DOF), ("geom", _GEOM))
    known = mjw.Model.__dataclass_fields__
    return tuple(name for kind, fields in named for field in fields if (name := f"{kind}_{field}") in known)


@wp.struct
class Places:
    """Places of layouts, with the variant that each belongs to: its object and its number there, (-1, -1) for none.

    Attributes:
        slot_kind: Variants of slots, shape (nslot,).
        qpos_kind: Variants of joint positions, shape (nq,).
        mocap_kind: Variants of mocap bodies, shape (nmocap,).
        qpos_adr: Addresses of joint positions in the simulation.
        mocap_adr: Numbers of mocap bodies in the simulation.
    """

    slot_kind: wp.array[wp.vec2i]
    qpos_kind: wp.array[wp.vec2i]
    mocap_kind: wp.array[wp.vec2i]
    qpos_adr: wp.array[int]
    mocap_adr: wp.array[int]


@wp.func
def is_absent(kind: wp.vec2i, variant: wp.array[int]) -> bool:
    """Return whether something belongs to a variant that is not there."""
    if kind[0] < 0:
        return False
    return variant[kind[0]] != kind[1]


@wp.kernel
def _write_variants(
    places: Places,
    # Words of the model:
    table: wp.array2d[int],
    owner: wp.array[int],
    address: wp.array[wp.uint64],
    stride: wp.array[wp.int64],
    # Bodies with variants, and the mass of all others:
    bodies: wp.array[int],
    mass: float,
    # In:
    mask: wp.array[wp.bool],
    rows: wp.array[int],
    present: wp.array2d[int],
    # Poses in: qpos, mocap_pos, mocap_quat
    poses_in: Poses,
    # Out:
    variant: wp.array2d[int],
    # Poses out: qpos, mocap_pos, mocap_quat
    poses_out: Poses,
    subtreemass_out: wp.array2d[float],
):
    worldid, lane = wp.tid()
    if not mask[worldid]:
        return
    row = row_of(worldid, rows)
    if present:
        for i in range(lane, places.slot_kind.shape[0], wp.block_dim()):
            kind = places.slot_kind[i]
            if kind[0] >= 0 and present[row, i] != 0:
                variant[worldid, kind[0]] = kind[1]
        block_sync()
        for i in range(lane, address.shape[0], wp.block_dim()):
            at = address[i] + wp.uint64(stride[i] * wp.int64(worldid))
            word = wp.array(ptr=at, shape=(1,), dtype=int)
            word[0] = table[variant[worldid, owner[i]], i]
        block_sync()
        if lane == 0:
            total = mass
            for i in range(bodies.shape[0]):
                total += subtreemass_out[worldid, bodies[i]]
            subtreemass_out[worldid, 0] = total
    for i in range(lane, places.qpos_adr.shape[0], wp.block_dim()):
        if not is_absent(places.qpos_kind[i], variant[worldid]):
            poses_out.qpos[worldid, places.qpos_adr[i]] = poses_in.qpos[row, i]
    for i in range(lane, places.mocap_adr.shape[0], wp.block_dim()):
        if not is_absent(places.mocap_kind[i], variant[worldid]):
            poses_out.mocap_pos[worldid, places.mocap_adr[i]] = poses_in.mocap_pos[row, i]
            poses_out.mocap_quat[worldid, places.mocap_adr[i]] = poses_in.mocap_quat[row, i]


class VariantWriter:
    """Writes the variants that layouts have into the masked worlds: fields of the model, and poses for the StateWriter.

    Args:
        scene: A scene in which objects have variants.
        m: Model of the scene as it is simulated, with a row for each world where variants differ: see
            `model_fields.put_model`.
        nworld: Number of worlds.
        varied: Copies of these fields, to which the same is written, with the colours that are seen:
            `ModelFields.varied`.

    Attributes:
        places: Places of layouts and their variants.
        variant: The variant of each object that is present, numbered as in the scene file, objects in the order of
            `SceneConfig.variants`; shape (nworld, number of objects with variants), int32.

    Raises:
        SceneMismatchError: The Model has one row for all worlds.
    """

    def __init__(self, scene: SceneModel, m: mjw.Model, nworld: int, varied: Mapping[str, wp.array]) -> None:
        for name in fields_of_variants():
            if getattr(m, name).size and getattr(m, name).shape[0] != nworld:
                raise SceneMismatchError(
                    f"ResetRandomizer: model.{name} has one row for all worlds and should have {nworld}, as objects "
                    "have variants. Make the Model by sceniris_gym.put_model(compiled, nworld)."
                )
        self._device = m.qpos0.device
        sim, variants = scene.sim.mjm, scene.config.variants
        bodies, mocap = [scene.sim.bodies[name] for name in variants], (nworld, max(sim.nmocap, 1))
        with wp.ScopedDevice(self._device):
            self.variant = wp.zeros((nworld, len(variants)), dtype=int)
            self._poses = Poses()
            self._poses.qpos = wp.zeros((nworld, sim.nq), dtype=float)
            self._poses.mocap_pos, self._poses.mocap_quat = (wp.zeros(mocap, dtype=each) for each in (wp.vec3, wp.quat))
            self.places, self._words = _places(scene), _words(scene, m, varied)
            self._masses = [wp.array(bodies, dtype=int), np.delete(sim.body_mass, bodies).sum()]
        # kernels have their addresses alone
        self._fields = [*(getattr(m, name) for name in fields_of_variants()), *varied.values()]
        self._subtreemass = m.body_subtreemass

    def launch(
        self, poses: Poses, mask: wp.array, present: wp.array | None = None, rows: wp.array | None = None
    ) -> Poses:
        """Write the variants of layouts into the masked worlds, and return the poses of all worlds as simulated.

        Args:
            poses: Poses of the scene with all variants.
            mask: Which worlds, shape (nworld,), bool.
            present: Which objects are present, shape (nrow, nslot), int32; None if worlds keep their variants.
            rows: Row of `poses` for every masked world, shape (nworld,), int32; None gives world i row i.
        """
        inputs = [self.places, *self._words, *self._masses, mask, rows, present, poses]
        words = {"outputs": [self.variant, self._poses, self._subtreemass], "block_dim": LANES}
        wp.launch_tiled(_write_variants, dim=[self.variant.shape[0]], inputs=inputs, **words, device=self._device)
        return self._poses


def _places(scene: SceneModel) -> Places:
    """Return the places of a scene, on the current device."""
    full, sim, kind = scene.mjm, scene.sim.mjm, np.full((scene.mjm.nbody, 2), -1)
    for i, members in enumerate(scene.config.variants.values()):
        kind[[scene.bodies[member] for member in members]] = [(i, number) for number in range(len(members))]
    owners = np.repeat(full.jnt_bodyid, np.diff([*full.jnt_qposadr.tolist(), full.nq]))
    mocap = np.flatnonzero(full.body_mocapid >= 0)
    mocap = mocap[np.argsort(full.body_mocapid[mocap])]
    first = full.jnt_qposadr[full.body_jntadr[owners]], sim.jnt_qposadr[sim.body_jntadr[scene.sim_bodies[owners]]]
    kinds = (kind[bodies] for bodies in ([scene.bodies[name] for name in slot_names(scene.config)], owners, mocap))
    adr = np.arange(full.nq) - first[0] + first[1], sim.body_mocapid[scene.sim_bodies[mocap]]
    places = Places()
    places.slot_kind, places.qpos_kind, places.mocap_kind = (wp.array(each, dtype=wp.vec2i, ndim=1) for each in kinds)
    places.qpos_adr, places.mocap_adr = (wp.array(each, dtype=int, ndim=1) for each in adr)
    return places


def _words(scene: SceneModel, m: mjw.Model, varied: Mapping[str, wp.array]) -> list[wp.array]:
    """Return a table of words of 32 bits, shape (most variants, nword), and the objects and addresses of the words."""
    words: list[tuple[int, wp.array, int, int, np.ndarray]] = []
    for k, (name, members) in enumerate(scene.config.variants.items()):
        bodies = [scene.bodies[member] for member in members]
        for field, i, values, _ in _rows(scene, name, bodies, seen=False):
            words += [(k, getattr(m, field), i, word, column) for word, column in enumerate(values.T)]
        # nobody else writes to copies, so they keep what is the same in all variants, but for colours of draws
        for field, i, values, held in _rows(scene, name, bodies, seen=True):
            differs = (values != held).any(axis=0) | (field == "geom_rgba")
            words += [(k, varied[field], i, word, values[:, word]) for word in np.flatnonzero(differs).tolist()]
    table = np.zeros((max(map(len, scene.config.variants.values())), len(words)), np.int32)
    for column, (*_, values) in zip(table.T, words, strict=True):
        column[: len(values)] = values
    address = [array.ptr + i * array.strides[1] + 4 * word for _, array, i, word, _ in words]
    stride = [array.strides[0] for _, array, *_ in words]
    arrays = [wp.array(table, dtype=int), wp.array([k for k, *_ in words], dtype=int)]
    return [*arrays, wp.array(address, dtype=wp.uint64), wp.array(stride, dtype=wp.int64)]


def _rows(scene: SceneModel, name: str, bodies: list[int], *, seen: bool) -> list[tuple[str, int, Any, Any]]:
    """Return the values of an object's variants: field, element of the simulated model, words (nvariant, width).

    The words that the simulated model begins with follow, shape (width,). If the values are to be `seen`, colours are
    those of materials where these show.
    """
    full, sim, body = scene.mjm, scene.sim.mjm, scene.sim.bodies[name]
    geoms = np.full((len(bodies), sim.body_geomnum[body]), -1)
    for row, own, first in zip(geoms, places_of_geoms(full, bodies)[1], full.body_geomadr[bodies], strict=True):
        row[own] = first + np.arange(len(own))
    dofs = full.body_dofadr[bodies][:, None] + np.arange(sim.body_dofnum[body])
    elements = {"body": (body, np.array(bodies)[:, None]), "dof": (sim.body_dofadr[body], dofs)}
    elements["geom"] = sim.body_geomadr[body], geoms
    found = []
    for field in fields_of_variants():
        kind, _, word = field.partition("_")
        theirs, ours = getattr(full, field), getattr(sim, field)
        theirs = nominal_values(full, field) if seen and field == "geom_rgba" else theirs
        words = np.int32 if theirs.dtype.kind == "i" else np.float32
        # where nothing moves there are no degrees of freedom
        theirs, ours = (values.reshape(len(values), values[:1].size).astype(words) for values in (theirs, ours))
        first, sources = elements[kind]
        for i, source in enumerate(sources.T, int(first)):
            values = theirs[source]
            values[source < 0] = _UNUSED.get(word, ours[i])
            found.append((field, i, values.view(np.int32), ours[i].view(np.int32)))
    return found
