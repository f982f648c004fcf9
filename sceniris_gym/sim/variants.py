"""Variants of objects. Layouts have bodies for each variant, but in simulated worlds the variants share bodies."""

from collections.abc import Iterator, Mapping, Sequence

import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.device.blocks import block_sync
from sceniris_gym.errors import SceneMismatchError
from sceniris_gym.layout.layouts import LayoutsView
from sceniris_gym.layout.masks import row_of
from sceniris_gym.layout.write_columns import Array, memory_of, row_address
from sceniris_gym.program.device import copied
from sceniris_gym.program.plan import slot_names
from sceniris_gym.scene.draws import nominal_values
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.shared_parts import SharedPart
from sceniris_gym.scene.variants import places_of_geoms
from sceniris_gym.sim.write import Poses, poses_of

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_LANES = 512
"""Lanes that read or write a world together. They are many, because each lane waits for memory at every word."""
_BODY = ("mass", "inertia", "ipos", "iquat", "invweight0", "subtreemass", "gravcomp")
_DOF = ("invweight0", "armature", "damping", "dampingpoly", "frictionloss")
_GEOM = (
    *("dataid", "matid", "solmix", "solref", "solimp", "size", "aabb", "rbound", "pos", "quat", "friction"),
    *("margin", "gap", "surfacevel", "adhesion", "rgba"),
)
# Further fields, for variants with joints
_JOINTED = {
    "body": ("pos", "quat"),
    "dof": ("solref", "solimp"),
    "jnt": (
        *("pos", "axis", "range", "margin", "solref", "solimp"),
        *("stiffness", "stiffnesspoly", "springyield", "actfrcrange"),
    ),
    "qpos": ("0", "_spring"),
}
# Values of elements that a variant does not use. Without a mesh and with this margin [m], a geom cannot collide. Such a
# joint never moves. It has little armature, because the trace of the mass matrix scales the solver's tolerance.
_UNUSED = {
    **{"geom_dataid": -1, "geom_matid": -1, "geom_margin": -1.0e6, "geom_rgba": 0.0, "jnt_margin": -1.0e6},
    **{"body_mass": 0.0, "body_inertia": 0.0, "body_subtreemass": 0.0, "body_gravcomp": 0.0},
    **{"dof_armature": 1.0e-6, "dof_damping": 0.0, "dof_dampingpoly": 0.0, "dof_frictionloss": 0.0},
    **{"dof_invweight0": 1.0, "jnt_stiffness": 0.0, "jnt_stiffnesspoly": 0.0, "qpos0": 0.0, "qpos_spring": 0.0},
}
_FAR = 1.0e6  # coordinates of absent variants [m], beyond the origins of all worlds


def fields_of_variants(scene: SceneModel) -> tuple[str, ...]:
    """Return the names of the Model fields that may differ between a scene's variants, in this version of mujoco_warp.

    The result is empty if the scene has no variants.
    """
    if scene.shared is None:
        return ()
    kinds = {"body": _BODY, "dof": _DOF, "geom": _GEOM}
    names = [f"{kind}_{field}" for kind, fields in kinds.items() for field in fields]
    if any(len(scene.sim.subtree(name)) > 1 for name in scene.config.variants):
        names += [f"{kind}{'' if kind == 'qpos' else '_'}{field}" for kind, of in _JOINTED.items() for field in of]
    return tuple(name for name in names if name in mjw.Model.__dataclass_fields__)


@wp.struct
class Places:
    """The variant to which each slot, joint position and mocap body of a layout belongs, as a pair of indices.

    A slot is a column of `present` in layouts. The pair (index of the object among the objects with variants, index of
    the variant) is called a kind here. It is (-1, -1) for everything that does not belong to a variant. Joint positions
    and mocap bodies also have addresses in the simulated worlds.
    """

    slot_kind: wp.array[wp.vec2i]
    qpos_kind: wp.array[wp.vec2i]
    mocap_kind: wp.array[wp.vec2i]
    qpos_adr: wp.array[int]  # addresses of joint positions in the simulation
    shared_adr: wp.array[int]  # addresses in the simulation of joints below the roots, which only some variants have
    mocap_adr: wp.array[int]  # numbers of mocap bodies in the simulation


@wp.struct
class Word:
    """The place of a 32-bit word in the Model's arrays. The present variant of the object `owner` sets the word."""

    owner: int  # the object with variants that determines the word
    array: int
    offset: int  # index in a row of the array


@wp.func
def _is_absent(kind: wp.vec2i, variant: wp.array[int]) -> bool:
    """Return whether `kind` (see Places) is a variant that is absent. `variant` has the world's present variants."""
    if kind[0] < 0:
        return False
    return variant[kind[0]] != kind[1]


@wp.func
def _is_written(kind: wp.vec2i, variant: wp.array[int]) -> bool:
    """Return whether the simulated world takes the pose of a body of `kind`: an absent object takes its first one."""
    if kind[0] < 0:
        return True
    return wp.max(variant[kind[0]], 0) == kind[1]


@wp.kernel
def _write_variants(
    places: Places,
    # Words of the model, and their values in each variant:
    table: wp.array2d[int],
    words: wp.array[Word],
    arrays: wp.array[Array],
    # Bodies with variants, and the mass of all other bodies:
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
        for i in range(lane, variant.shape[1], wp.block_dim()):
            variant[worldid, i] = -1
        block_sync()
        for i in range(lane, places.slot_kind.shape[0], wp.block_dim()):
            kind = places.slot_kind[i]
            if kind[0] >= 0 and present[row, i] != 0:
                variant[worldid, kind[0]] = kind[1]
        block_sync()
        for i in range(lane, words.shape[0], wp.block_dim()):
            word = words[i]
            memory = wp.array(ptr=row_address(arrays[word.array], worldid), shape=(word.offset + 1,), dtype=int)
            memory[word.offset] = table[wp.max(variant[worldid, word.owner], 0), i]
        for i in range(lane, places.shared_adr.shape[0], wp.block_dim()):
            poses_out.qpos[worldid, places.shared_adr[i]] = 0.0
        block_sync()
        if lane == 0:
            total = mass
            for i in range(bodies.shape[0]):
                total += subtreemass_out[worldid, bodies[i]]
            subtreemass_out[worldid, 0] = total
    for i in range(lane, places.qpos_adr.shape[0], wp.block_dim()):
        if _is_written(places.qpos_kind[i], variant[worldid]):
            poses_out.qpos[worldid, places.qpos_adr[i]] = poses_in.qpos[row, i]
    for i in range(lane, places.mocap_adr.shape[0], wp.block_dim()):
        if _is_written(places.mocap_kind[i], variant[worldid]):
            poses_out.mocap_pos[worldid, places.mocap_adr[i]] = poses_in.mocap_pos[row, i]
            poses_out.mocap_quat[worldid, places.mocap_adr[i]] = poses_in.mocap_quat[row, i]


class VariantWriter:
    """Writes the variants of layouts into the masked worlds: fields of the Model, and poses for the StateWriter.

    Args:
        scene: A scene with variants.
        m: Model of the simulated scene. Fields in which variants differ have a row for each world, see `make_worlds`.
        nworld: Number of worlds.
        varied: `ModelFields.varied`, the nominal values of these fields. Launches write the same values into both `m`
            and `varied`, except for colours: `varied` gets the visible colours, which may come from materials.

    Attributes:
        places: The variants of slots, joint positions and mocap bodies, see Places.
        variant: For each object with variants, the index of its present variant in the scene file's list, or -1 if
            the object is absent, shape (nworld, number of such objects), int32. Columns follow `SceneConfig.variants`.

    Raises:
        SceneMismatchError: A field that differs between variants has one row for all worlds.
    """

    def __init__(self, scene: SceneModel, m: mjw.Model, nworld: int, varied: Mapping[str, wp.array]) -> None:
        names = fields_of_variants(scene)
        for name in names:
            if getattr(m, name).size and getattr(m, name).shape[0] != nworld:
                raise SceneMismatchError(
                    f"ResetRandomizer: model.{name} has one row for all worlds, but should have {nworld}: objects "
                    "have variants. Make Model and Data by make_worlds(compiled, nworld)."
                )
        self._device = m.qpos0.device
        sim, variants = scene.sim.mjm, scene.config.variants
        bodies, mocap = [scene.sim.bodies[name] for name in variants], (nworld, max(sim.nmocap, 1))
        shared = [body for name in variants for body in scene.sim.subtree(name)]
        with wp.ScopedDevice(self._device):
            self.variant = wp.zeros((nworld, len(variants)), dtype=int)
            self._poses = Poses()  # pyrefly: ignore[missing-argument]
            self._poses.qpos = wp.zeros((nworld, sim.nq), dtype=float)
            self._poses.mocap_pos, self._poses.mocap_quat = (wp.zeros(mocap, dtype=each) for each in (wp.vec3, wp.quat))
            # kernels only have addresses, so this reference keeps the memory alive
            self._fields = [*(getattr(m, name) for name in names), *varied.values()]
            self.places, self._words = _places(scene), _words(scene, self._fields)
            self._masses = [wp.array(bodies, dtype=int), np.delete(sim.body_mass, shared).sum()]
        self._subtreemass = m.body_subtreemass

    def launch(
        self, poses: Poses, mask: wp.array, present: wp.array | None = None, rows: wp.array | None = None
    ) -> Poses:
        """Write the variants of layouts into the masked worlds, and return the poses of the simulated model.

        Args:
            poses: Poses of the scene with all variants.
            mask: Selected worlds, shape (nworld,), bool.
            present: 1 for each present slot, shape (nrow, nslot), int32. None keeps the worlds' current variants.
            rows: Row of `poses` for each masked world, shape (nworld,), int32. None gives world i row i.
        """
        inputs = [self.places, *self._words, *self._masses, mask, rows, present, poses]
        arrays = {"inputs": inputs, "outputs": [self.variant, self._poses, self._subtreemass]}
        wp.launch_tiled(_write_variants, dim=[self.variant.shape[0]], **arrays, block_dim=_LANES, device=self._device)
        return self._poses


def _places(scene: SceneModel) -> Places:
    """Return the `Places` of a scene, on the current device."""
    full, sim, kind = scene.mjm, scene.sim.mjm, np.full((scene.mjm.nbody, 2), -1)
    for i, members in enumerate(scene.config.variants.values()):
        for number, member in enumerate(members):
            kind[scene.subtree(member)] = i, number
    owners = np.repeat(full.jnt_bodyid, np.diff([*full.jnt_qposadr.tolist(), full.nq]))
    mocap = np.flatnonzero(full.body_mocapid >= 0)
    mocap = mocap[np.argsort(full.body_mocapid[mocap])]
    first = full.jnt_qposadr[full.body_jntadr[owners]], sim.jnt_qposadr[sim.body_jntadr[scene.sim_bodies[owners]]]
    kinds = (kind[bodies] for bodies in ([scene.bodies[name] for name in slot_names(scene.config)], owners, mocap))
    adr = np.arange(full.nq) - first[0] + first[1], sim.body_mocapid[scene.sim_bodies[mocap]]
    places = Places()  # pyrefly: ignore[missing-argument]
    places.slot_kind, places.qpos_kind, places.mocap_kind = (wp.array(each, dtype=wp.vec2i, ndim=1) for each in kinds)
    below = [body for name in scene.config.variants for body in scene.sim.subtree(name)[1:] if sim.body_jntnum[body]]
    adr = *adr, sim.jnt_qposadr[sim.body_jntadr[below]] if below else np.zeros(0)
    places.qpos_adr, places.mocap_adr, places.shared_adr = (wp.array(each, dtype=int, ndim=1) for each in adr)
    return places


def _words(scene: SceneModel, arrays: Sequence[wp.array]) -> list[wp.array]:
    """Return three arrays: a table of values, the `Word`s that receive them, and the memory of `arrays`.

    Each column of the table belongs to one word, and has the value of the word in each variant of the word's object.
    Zeros follow if another object has more variants. The shape is (most variants of an object, nword).
    `arrays` has the fields of the Model, followed by the nominal copies of these fields.
    """
    names, words, columns = fields_of_variants(scene), [], []
    for k, name in enumerate(scene.config.variants):
        parts = [_elements(scene, part, name) for part in scene.shared_parts(name)]
        for is_copy in (False, True):
            for field, first, values, held in _rows(scene, parts, seen=is_copy):
                number = names.index(field) + is_copy * len(names)
                # only this writer changes the copies, so words that are equal in all variants stay valid there
                differs = (values != held).any(axis=0) | (not is_copy or field == "geom_rgba")
                element, word = np.nonzero(differs)
                offsets = (first + element) * (arrays[number].strides[1] // 4) + word
                words += [(k, number, offset) for offset in offsets.tolist()]
                columns += [*values[:, differs].T]
    table = np.zeros((max(map(len, columns)), len(words)), np.int32)
    for column, values in zip(table.T, columns, strict=True):
        column[: len(values)] = values
    memory = [memory_of(array) for array in arrays]
    # pyrefly: ignore[missing-attribute]
    structs = (np.array(words, Word.numpy_dtype()), Word), (np.array(memory, Array.numpy_dtype()), Array)
    return [wp.array(table, dtype=int), *(wp.array(rows, dtype=dtype) for rows, dtype in structs)]


def _rows(
    scene: SceneModel, parts: Sequence[Mapping[str, tuple[int, np.ndarray]]], *, seen: bool
) -> Iterator[tuple[str, int, np.ndarray, np.ndarray]]:
    """Yield the values that each variant of an object writes into the elements of the simulated model.

    An entry has the name of a field, the id of the first of n elements (bodies, geoms or degrees of freedom), their
    values in each variant, as 32-bit words, shape (nvariant, n, width), and their initial values, shape (n, width). If
    `seen`, colours are the visible colours, which may come from materials. `parts` has the elements of shared bodies.
    """
    for field in fields_of_variants(scene):
        kind = "qpos" if field.startswith("qpos") else field.partition("_")[0]
        theirs, ours = getattr(scene.mjm, field), getattr(scene.sim.mjm, field)
        theirs = nominal_values(scene.mjm, field) if seen and field == "geom_rgba" else theirs
        words = np.int32 if theirs.dtype.kind == "i" else np.float32
        # not -1 as the width: in a scene without degrees of freedom, their fields have no rows
        theirs, ours = (values.reshape(len(values), values[:1].size).astype(words) for values in (theirs, ours))
        for first, sources in (elements[kind] for elements in parts if kind in elements):
            held = ours[first : first + sources.shape[1]]
            values = theirs[sources]
            values[sources < 0] = np.broadcast_to(_UNUSED.get(field, held), values.shape)[sources < 0]
            yield field, int(first), values.view(np.int32), held.view(np.int32)


def _elements(scene: SceneModel, part: SharedPart, name: str) -> dict[str, tuple[int, np.ndarray]]:
    """Return the elements of a shared body by kind: the first id, and the ids of each variant's elements.

    The latter have the shape (nvariant, number of elements), with -1 for an element that a variant lacks.
    """
    full, sim, sources = scene.mjm, scene.sim.mjm, np.array(part.bodies)
    body = sim.body(part.name_of(name)).id
    geoms = np.full((len(sources), sim.body_geomnum[body]), -1)
    for row, own, source in zip(geoms, places_of_geoms(full, part.bodies)[1], sources, strict=True):
        row[own] = full.body_geomadr[source] + np.arange(len(own))
    found = {"body": (body, sources[:, None]), "geom": (sim.body_geomadr[body], geoms)}
    there = (sources >= 0)[:, None]
    dofs = full.body_dofadr[sources][:, None] + np.arange(sim.body_dofnum[body])
    found["dof"] = sim.body_dofadr[body], np.where(there, dofs, -1)
    if part.parent >= 0 and sim.body_jntnum[body]:
        joint, joints = sim.body_jntadr[body], full.body_jntadr[sources][:, None]
        found["jnt"] = joint, np.where(there, joints, -1)
        found["qpos"] = sim.jnt_qposadr[joint], np.where(there, full.jnt_qposadr[joints], -1)
    return found


@wp.kernel
def _read_worlds(
    places: Places,
    # In:
    variant: wp.array2d[int],
    present_in: wp.array2d[int],
    # Poses in: qpos, mocap_pos, mocap_quat
    poses: Poses,
    mask: wp.array[wp.bool],
    # Layouts out: state*, present
    layouts_out: LayoutsView,
):
    worldid, lane = wp.tid()
    if not mask[worldid]:
        return
    for i in range(lane, places.slot_kind.shape[0], wp.block_dim()):
        layouts_out.present[worldid, i] = present_in[worldid, i]
        if places.slot_kind[i][0] >= 0:
            layouts_out.present[worldid, i] = wp.where(_is_absent(places.slot_kind[i], variant[worldid]), 0, 1)
    for i in range(lane, places.qpos_adr.shape[0], wp.block_dim()):
        layouts_out.qpos[worldid, i] = poses.qpos[worldid, places.qpos_adr[i]]
        if _is_absent(places.qpos_kind[i], variant[worldid]):
            layouts_out.qpos[worldid, i] = wp.static(_FAR)
    for i in range(lane, places.mocap_adr.shape[0], wp.block_dim()):
        layouts_out.mocap_pos[worldid, i] = poses.mocap_pos[worldid, places.mocap_adr[i]]
        layouts_out.mocap_quat[worldid, i] = poses.mocap_quat[worldid, places.mocap_adr[i]]
        if _is_absent(places.mocap_kind[i], variant[worldid]):
            layouts_out.mocap_pos[worldid, i] = wp.vec3(wp.static(_FAR))


class VariantReader:
    """Converts simulated worlds to rows of layouts, in which absent variants are far away.

    Args:
        d: Data of the worlds. Launches use its arrays in place.
        variants: The writer of the variants in these worlds.
        layouts: The latest layouts of the worlds. They determine the presence of objects without variants.

    Attributes:
        state: A copy of the struct `layouts`, but with new arrays for `present`, `qpos`, `mocap_pos` and `mocap_quat`.
    """

    def __init__(self, d: mjw.Data, variants: VariantWriter, layouts: LayoutsView) -> None:
        self._device, self._nworld, self.state = d.qpos.device, d.nworld, copied(LayoutsView, layouts)
        self._inputs = [variants.places, variants.variant, layouts.present, poses_of(d)]
        for name in ("present", "qpos", "mocap_pos", "mocap_quat"):
            setattr(self.state, name, wp.zeros_like(getattr(layouts, name)))

    def launch(self, mask: wp.array) -> None:
        """Read the masked worlds into `state`. The mask has shape (nworld,), bool."""
        arrays = {"inputs": [*self._inputs, mask], "outputs": [self.state]}
        wp.launch_tiled(_read_worlds, dim=[self._nworld], **arrays, block_dim=_LANES, device=self._device)
