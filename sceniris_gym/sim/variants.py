"""`VariantWriter`: turns layouts into those of the simulated scene, and bodies into the variants that are present."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
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

wp.set_module_options({"enable_backward": False})

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


@wp.kernel
def _write_variants(
    # Of each variant: its column in layouts, its object and its number
    members: wp.array[wp.vec3i],
    # Words of the model:
    table: wp.array[int],
    word_shared: wp.array[int],
    word_adr: wp.array[int],
    word_num: wp.array[int],
    address: wp.array[wp.uint64],
    stride: wp.array[wp.int64],
    # Addresses in layouts:
    qpos_shared: wp.array[int],
    qpos_adr: wp.array[int],
    mocap_shared: wp.array[int],
    mocap_adr: wp.array[int],
    source: wp.array[int],
    # Masses:
    first: wp.array[int],
    mass: wp.array[wp.float64],
    # In:
    mask: wp.array[wp.bool],
    rows: wp.array[int],
    present: wp.array2d[int],
    qpos_in: wp.array2d[float],
    mocap_pos_in: wp.array2d[wp.vec3],
    mocap_quat_in: wp.array2d[wp.quat],
    # Out:
    variant: wp.array2d[int],
    qpos_out: wp.array2d[float],
    mocap_pos_out: wp.array2d[wp.vec3],
    mocap_quat_out: wp.array2d[wp.quat],
    subtreemass_out: wp.array2d[float],
):
    worldid, lane = wp.tid()
    if not mask[worldid]:
        return
    row = row_of(worldid, rows)
    if present:
        for i in range(lane, members.shape[0], wp.block_dim()):
            member = members[i]
            if present[row, member[0]] != 0:
                variant[worldid, member[1]] = member[2]
        block_sync()
        for i in range(lane, address.shape[0], wp.block_dim()):
            at = address[i] + wp.uint64(stride[i] * wp.int64(worldid))
            word = wp.array(ptr=at, shape=(1,), dtype=int)
            word[0] = table[word_adr[i] + variant[worldid, word_shared[i]] * word_num[i]]
        if lane == 0:
            total = mass[mass.shape[0] - 1]  # of all that has no variants
            for s in range(variant.shape[1]):
                total += mass[first[s] + variant[worldid, s]]
            subtreemass_out[worldid, 0] = float(total)
    for i in range(lane, qpos_adr.shape[0], wp.block_dim()):
        adr = qpos_adr[i]
        if qpos_shared[i] >= 0:
            adr += source[first[qpos_shared[i]] + variant[worldid, qpos_shared[i]]]
        qpos_out[worldid, i] = qpos_in[row, adr]
    for i in range(lane, mocap_adr.shape[0], wp.block_dim()):
        mocapid = mocap_adr[i]
        if mocap_shared[i] >= 0:
            mocapid = source[first[mocap_shared[i]] + variant[worldid, mocap_shared[i]]]
        mocap_pos_out[worldid, i] = mocap_pos_in[row, mocapid]
        mocap_quat_out[worldid, i] = mocap_quat_in[row, mocapid]


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
        full, sim, variants = scene.mjm, scene.sim.mjm, scene.config.variants
        counts = [len(members) for members in variants.values()]
        bodies = [[scene.bodies[member] for member in members] for members in variants.values()]
        slots = slot_names(scene.config)
        numbered = [(k, *each) for k, members in enumerate(variants.values()) for each in enumerate(members)]
        with wp.ScopedDevice(self._device):
            self.variant = wp.zeros((nworld, len(variants)), dtype=int)
            mocap = (nworld, max(sim.nmocap, 1))
            kinds = ((nworld, sim.nq), float), (mocap, wp.vec3), (mocap, wp.quat)
            self._poses = Poses(*(wp.zeros(shape, dtype=dtype) for shape, dtype in kinds))
            self._members = wp.array([(slots.index(member), k, i) for k, i, member in numbered], dtype=wp.vec3i)
            masses = [float(full.body_mass[body]) for members in bodies for body in members]
            others = np.delete(sim.body_mass, [scene.sim.bodies[name] for name in variants]).sum()
            self._table = self._words(scene, m, bodies, varied)
            self._inputs = [
                *self._sources(scene, bodies),
                wp.array(np.cumsum([0, *counts[:-1]]), dtype=int),
                wp.array([*masses, others], dtype=wp.float64),
            ]
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
        inputs = [self._members, *self._table, *self._inputs, mask, rows, present, *poses]
        words = {"outputs": [self.variant, *self._poses, self._subtreemass], "block_dim": LANES}
        wp.launch_tiled(_write_variants, dim=[self.variant.shape[0]], inputs=inputs, **words, device=self._device)
        return self._poses

    def _words(
        self, scene: SceneModel, m: mjw.Model, bodies: list[list[int]], varied: Mapping[str, wp.array]
    ) -> list[wp.array]:
        """Return the table of all variants in words of 32 bits, and the words of the model that they are written to."""
        table: list[np.ndarray] = []
        shared, adr, num, address, stride = ([] for _ in range(5))
        size = 0
        for k, (name, members) in enumerate(zip(scene.config.variants, bodies, strict=True)):
            columns = []
            for field, i, values, _ in _rows(scene, name, members, seen=False):
                columns += [(getattr(m, field), i, word, values[:, word]) for word in range(values.shape[1])]
            # nobody else writes to copies, so they keep what is the same in all variants, but for colours of draws
            for field, i, values, held in _rows(scene, name, members, seen=True):
                differs = (values != held).any(axis=0) | (field == "geom_rgba")
                columns += [(varied[field], i, word, values[:, word]) for word in np.flatnonzero(differs).tolist()]
            width = len(columns)
            table.append(np.stack([values for *_, values in columns], axis=1).ravel())
            address += [array.ptr + i * array.strides[1] + 4 * word for array, i, word, _ in columns]
            stride += [array.strides[0] for array, *_ in columns]
            shared += [k] * width
            adr += range(size, size + width)
            num += [width] * width
            size += width * len(members)
        words = [wp.array(values, dtype=int) for values in (np.concatenate(table), shared, adr, num)]
        return [*words, wp.array(address, dtype=wp.uint64), wp.array(stride, dtype=wp.int64)]

    def _sources(self, scene: SceneModel, bodies: list[list[int]]) -> list[wp.array]:
        """Return where each element of qpos and each mocap body comes from in layouts."""
        full, sim, variants = scene.mjm, scene.sim.mjm, np.concatenate(bodies)
        number = np.full(sim.nbody, -1)
        number[[scene.sim.bodies[name] for name in scene.config.variants]] = range(len(bodies))
        qpos_shared, mocap_shared = number[owners_of_qpos(sim)], number[mocap_bodies(sim)]
        # bodies without variants keep their order
        others = [np.flatnonzero(~np.isin(of(full), variants)) for of in (owners_of_qpos, mocap_bodies)]
        qpos_adr, mocap_adr = (np.zeros(len(shared), int) for shared in (qpos_shared, mocap_shared))
        qpos_adr[qpos_shared < 0], mocap_adr[mocap_shared < 0] = others
        qpos_adr[qpos_shared >= 0] = np.resize(range(7), (qpos_shared >= 0).sum())  # each has a freejoint alone
        source, joints = full.body_mocapid[variants], full.body_jntadr[variants]
        source[joints >= 0] = full.jnt_qposadr[joints[joints >= 0]]
        values = (qpos_shared, qpos_adr, mocap_shared, mocap_adr, source)
        return [wp.array(each, dtype=int, ndim=1) for each in values]


def owners_of_qpos(mjm: mujoco.MjModel) -> np.ndarray:
    """Return the body that each element of qpos moves, shape (nq,)."""
    return np.repeat(mjm.jnt_bodyid, np.diff([*mjm.jnt_qposadr.tolist(), mjm.nq]))


def mocap_bodies(mjm: mujoco.MjModel) -> np.ndarray:
    """Return the mocap bodies in the order of their numbers, shape (nmocap,)."""
    bodies = np.flatnonzero(mjm.body_mocapid >= 0)
    return bodies[np.argsort(mjm.body_mocapid[bodies])]


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
