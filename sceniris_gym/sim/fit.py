"""Model and Data for your own loop: `make_worlds` makes them, and `check_fit` checks that they belong to a scene."""

from collections.abc import Iterator, Sequence

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from sceniris_gym.errors import SceneMismatchError, as_names, check_type
from sceniris_gym.layout.layouts import Layouts
from sceniris_gym.layout.masks import as_count
from sceniris_gym.program.checks.simulation import array_bytes, check_worlds
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.adopt import instead_of_variants
from sceniris_gym.scene.draws import drawn_fields
from sceniris_gym.scene.field_table import check_field
from sceniris_gym.sim.batch import default_budget, put_simulated
from sceniris_gym.sim.model_fields import NAMED, widen, with_followers
from sceniris_gym.sim.variants import fields_of_variants

_SIZES = ("nq", "nv", "nu", "na", "nbody", "njnt", "ngeom", "nmocap", "nmeshvert", "npair", "nexclude")
_FIELDS = (
    *("body_parentid", "body_mocapid", "jnt_type", "jnt_bodyid", "jnt_qposadr", "jnt_dofadr"),
    *("geom_type", "geom_bodyid", "geom_dataid", "geom_contype", "geom_conaffinity"),
    *("pair_geom1", "pair_geom2", "exclude_signature", "body_pos", "body_quat", "jnt_pos", "jnt_axis", "qpos0"),
    *("geom_size", "geom_pos", "geom_quat", "mesh_vert"),
)
_KINDS = {"jnt": "joint", "qpos0": "joint", "mesh": "vertex"}
"""Kind of element by the prefix of a field, if the prefix is not the kind itself."""
_SIZES_OF = (0, 0, 1, 2, 3, 2, 3, 0)
"""Number of sizes that affect collisions, by geom type. Planes are infinite, and meshes collide by their vertices."""
_TOLERANCE = 1.0e-6
"""Largest difference that counts as rounding to single precision: metres, or components of axes and quaternions."""
_CURE_OF_VARIANTS = "Objects have variants, so make Model and Data by sceniris_gym.make_worlds(compiled, nworld)."
_CURE = "Make Model and Data by sceniris_gym.make_worlds(compiled, nworld)."


def check_fit(
    compiled: CompiledScene,
    m: mjw.Model,
    d: mjw.Data,
    layouts: Layouts,
    mjm: mujoco.MjModel | None = None,
    *,
    where: str = "ResetRandomizer",
    cure: str | None = None,
) -> None:
    """Check that a Model and Data fit a compiled scene, and that `layouts` has this scene, nworld and device.

    The check compares everything that layouts depend on: sizes, and the order, types, places and shapes of bodies,
    joints and geoms. If a field has a row for each world, the check covers all worlds. Masses, frictions, gains and
    options may differ. A mujoco_warp Model has no names. Pass its MjModel as `mjm` to also compare names.

    Raises:
        SceneMismatchError: A value differs. The message begins with `where`, names the value, and ends with the
            advice `cure`.
    """
    cure = cure or (_CURE_OF_VARIANTS if compiled.config.variants else _CURE)
    _check_facts(_facts_of_model(compiled, m, mjm), where, cure)
    _check_facts(_facts_of_data(compiled.sim_mjm, d), where, cure)
    _check_layouts(compiled, m, d, layouts, where)


def check_model(compiled: CompiledScene, mjm: mujoco.MjModel, where: str, cure: str) -> None:
    """Check that a MjModel matches a compiled scene in everything that layouts depend on. See `check_fit`.

    Raises:
        SceneMismatchError: As `check_fit`. Or the scene has variants, so that one model cannot describe all worlds.
    """
    for name, members in compiled.config.variants.items():
        raise SceneMismatchError(
            f"{where}: objects.{name} has variants or several supports, but all worlds share one model here. Use "
            f"SceneVectorEnv or ResetRandomizer for the scene. {instead_of_variants(name, members)}"
        )
    _check_facts(_facts_of_model(compiled, mjm, mjm), where, cure)


_Facts = Iterator[tuple[str, object, object]]
"""The name of each compared value, the value found, and the value in the compiled scene."""


def _check_facts(facts: _Facts, where: str, cure: str) -> None:
    for what, found, wanted in facts:
        if found != wanted:
            raise SceneMismatchError(
                f"{where}: {what} is {found}, but should be {wanted}, as in the compiled scene. {cure}"
            )


def _facts_of_model(compiled: CompiledScene, m: mjw.Model | mujoco.MjModel, mjm: mujoco.MjModel | None) -> _Facts:
    ours = compiled.sim_mjm
    for size in _SIZES:
        yield f"model.{size}", getattr(m, size), getattr(ours, size)
    shared = [compiled.scene.sim.bodies[name] for name in compiled.config.variants]
    for kind, size in () if mjm is None else (("body", "nbody"), ("joint", "njnt")):
        yield f"the number of its {kind} names", getattr(mjm, size), getattr(ours, size)
        for i in range(getattr(ours, size)):
            yield f"the name of {kind} {i}", repr(getattr(mjm, kind)(i).name), repr(getattr(ours, kind)(i).name)
    for field in _FIELDS:
        yield from _differences(m, ours, field, shared)


def _facts_of_data(ours: mujoco.MjModel, d: mjw.Data) -> _Facts:
    arrays = {"nq": d.qpos, "nv": d.qvel, "nmocap": d.mocap_pos, "nbody": d.xpos, "ngeom": d.geom_xpos}
    for size, array in arrays.items():
        yield f"data's {size}", array.shape[1], getattr(ours, size)


def _differences(m: mjw.Model | mujoco.MjModel, mjm: mujoco.MjModel, field: str, shared: list[int]) -> _Facts:
    """Yield the first difference of two models in a field. If the field has a row for each world, compare all rows.

    In `qpos0`, only hinge and slide joints are compared. If variants share a body, the geoms of this body are not
    compared, because they depend on the present variant.
    """
    prefix = field.partition("_")[0]
    kind, wanted, found = _KINDS.get(prefix, prefix), np.asarray(getattr(mjm, field), float), getattr(m, field)
    found = (found.numpy() if isinstance(found, wp.array) else np.asarray(found)).astype(float)
    if not wanted.size:
        return
    if field == "qpos0":
        wanted, found = wanted[mjm.jnt_qposadr], found.reshape(-1, mjm.nq)[:, mjm.jnt_qposadr]
    wanted = wanted.reshape(len(wanted), -1)
    found = found.reshape(-1, *wanted.shape)
    apart = np.abs(found - wanted) > _TOLERANCE
    if field == "geom_size":
        apart &= np.arange(3) < np.take(_SIZES_OF, mjm.geom_type, mode="clip")[:, None]
    differs = apart.any(axis=2)
    if field in ("body_pos", "body_quat"):
        differs &= mjm.body_mocapid < 0
        if len(found) > 1:
            differs[:, mjm.jnt_bodyid[mjm.jnt_type == mujoco.mjtJoint.mjJNT_FREE]] = False
    if field == "qpos0":  # the reference of a free or ball joint has no effect
        differs &= np.isin(mjm.jnt_type, (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE))
    if kind == "geom":
        differs &= ~np.isin(mjm.geom_bodyid, shared)
    if not differs.any():
        return
    world, i = np.argwhere(differs)[0]
    name = "" if kind == "vertex" else getattr(mjm, kind)(int(i)).name
    place = f" in world {world}" if len(found) > 1 else ""
    yield f"model.{field} of {kind} {repr(name) if name else i}{place}", _short(found[world, i]), _short(wanted[i])


def _short(values: np.ndarray) -> str:
    text = ", ".join(f"{value:.6g}" for value in values)
    return text if len(values) == 1 else f"[{text}]"


def _check_layouts(compiled: CompiledScene, m: mjw.Model, d: mjw.Data, layouts: Layouts, where: str) -> None:
    source, device = "layout_source makes layouts", d.qpos.device
    for what, found, should, wanted, why in (
        (f"{source} of scene", layouts.compiled.hash, "make them of", compiled.hash, "the compiled scene"),
        (f"{source} for", f"{layouts.nworld} worlds", "make them for", f"{d.nworld} worlds", "the number in data"),
        ("the compiled scene is on", wp.get_device(compiled.device), "be on", device, "where data is"),
        ("layout_source is on", layouts.view.qpos.device, "be on", device, "where data is"),
        ("model is on", m.qpos0.device, "be on", device, "where data is"),
    ):
        if found != wanted:
            raise SceneMismatchError(f"{where}: {what} {found}, but should {should} {wanted}, {why}.")


def make_worlds(
    compiled: CompiledScene,
    nworld: int,
    *,
    fields: str | Sequence[str] = (),
    nconmax: int | None = None,
    njmax: int | None = None,
) -> tuple[mjw.Model, mjw.Data]:
    """Return Model and Data of `compiled.sim_mjm`, on the device of the scene.

    A field of the Model has a row for each world if `fields` names it, if the scene randomizes it, if variants differ
    in it, or if it is derived from such a field.

    Args:
        compiled: The compiled scene.
        nworld: Number of worlds.
        fields: Names of fields that you will write per world, such as "body_mass". See `ResetRandomizer.model_field`.
        nconmax: Contacts per world. None leaves room for a busy scene. The number grows with the geoms at the
            bottom of each object. For an object with `orientation: stable`, or one that may fall, the bottom is the
            side with the most geoms. Of an object with variants, the variant with the most bottom geoms counts.
        njmax: Constraint rows per world. None leaves room for a busy scene.

    Raises:
        ArgumentTypeError: `compiled` is not a CompiledScene.
        ArgumentError: `nworld`, `nconmax` or `njmax` is not a positive integer, or steps do not read one of the fields.
        UnknownNameError: A field does not exist, or layouts depend on it.
        NotSupportedError: MuJoCo-Warp cannot simulate the model.
        MemoryLimitError: The worlds do not fit into free memory.
    """
    check_type(compiled, CompiledScene, "make_worlds: compiled")
    nworld, fields = as_count(nworld, "make_worlds: nworld"), as_names(fields, "make_worlds: fields")
    for name in fields:
        check_field(name, compiled.sim_mjm, "make_worlds")
    contacts, rows = default_budget(compiled.sim_mjm, compiled.scene)
    nconmax = contacts if nconmax is None else as_count(nconmax, "make_worlds: nconmax")
    njmax = rows if njmax is None else as_count(njmax, "make_worlds: njmax")
    drawn, shared = drawn_fields(compiled.scene.sim.draws), fields_of_variants(compiled.scene)
    with wp.ScopedDevice(compiled.device):
        model = put_simulated(compiled.sim_mjm, compiled.config.where)
        one = mjw.make_data(compiled.sim_mjm, 1, nconmax=nconmax, njmax=njmax)
        check_worlds("make_worlds", nworld, str(compiled.device), (0, array_bytes(one, one.efc)))
        for name in (*shared, *(each for source in (*drawn, *fields) for each in with_followers(source))):
            widen(model, name, nworld)
        data = mjw.make_data(compiled.sim_mjm, nworld, nconmax=nconmax, njmax=njmax)
    setattr(model, NAMED, tuple(fields))
    return model, data
