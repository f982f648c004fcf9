"""The simulated model of a scene: all variants of an object share one body, or one tree of bodies.

Geoms of one class have the same type, contact bits and other values that mujoco_warp stores once for all worlds. The
shared body has enough geoms of each class for the variant that needs most. All other values of the body, its joint and
its geoms have a row for each world. Fixtures may have joints: the shared tree has a body for each body of any variant,
see `shared_parts`. For each world, `sim/variants.py` writes the values of the present variant to the
row of this world. If a file of a folder cannot be a variant, the file is left out, with a warning.
"""

import warnings
from collections.abc import Mapping, Sequence
from itertools import chain

import mujoco
import numpy as np

from sceniris_gym.config.member_names import without_support
from sceniris_gym.config.scene import SceneConfig
from sceniris_gym.config.variants import owners_of
from sceniris_gym.errors import ModelWarning, NotSupportedError, SceneFileError, SceneKeyError, ScenirisError
from sceniris_gym.progress import tell
from sceniris_gym.scene.assemble import attach_variants, compile_spec
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.overview import HIDDEN_GROUP, VISIBLE_GROUPS, picture_groups
from sceniris_gym.scene.shared_parts import misfit
from sceniris_gym.scene.support import subtree

MESH = int(mujoco.mjtGeom.mjGEOM_MESH)
CLASS = ("type", "contype", "conaffinity", "condim", "priority", "group")
"""Fields of a geom that are the same in all worlds."""

# A body that names meshes but has no contacts. MuJoCo makes hulls only of meshes that a colliding geom names.
_HULLS = "hulls_of_variants"
_CONTACT_BITS = 31
# Fields that may name a variant's bodies or geoms, by kind of element.
_REFERENCES = {
    "excludes": ("bodyname1", "bodyname2"),
    "pairs": ("geomname1", "geomname2"),
    "equalities": ("name1", "name2"),
    "sensors": ("objname", "refname"),
    "actuators": ("target", "refsite", "slidersite"),
    "cameras": ("targetbody",),
    "lights": ("targetbody",),
}
# Fields with the body of each element that a tendon may pass, by the kind of the element.
_PASSED = {
    mujoco.mjtWrap.mjWRAP_JOINT: "jnt_bodyid",
    mujoco.mjtWrap.mjWRAP_SITE: "site_bodyid",
    **dict.fromkeys((mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER), "geom_bodyid"),
}
_TOLD = 5  # most files of an object that a warning names


def geom_classes(mjm: mujoco.MjModel) -> list[tuple[int, ...]]:
    """Return the class of each geom: its values in the fields of `CLASS`, which are the same in all worlds.

    Of a geom's `group`, only visibility counts: all groups that pictures show are one class.
    """
    groups = picture_groups(mjm)
    groups[np.isin(groups, VISIBLE_GROUPS)] = VISIBLE_GROUPS[0]
    fields = [*(getattr(mjm, f"geom_{field}") for field in CLASS[:-1]), groups]
    return list(zip(*(values.tolist() for values in fields), strict=True))


def places_of_geoms(mjm: mujoco.MjModel, bodies: Sequence[int]) -> tuple[list[tuple[int, ...]], list[list[int]]]:
    """Return the list of classes of a shared body's geoms, and for each variant, the indices of its geoms in this list.

    Args:
        mjm: The model with all variants.
        bodies: The body of each variant that they share, or -1 if the variant has none.
    """
    kinds = geom_classes(mjm)
    of_bodies = [[kinds[geom] for geom in _geoms(mjm, body)] for body in bodies]
    own = [[(kind, some[:i].count(kind)) for i, kind in enumerate(some)] for some in of_bodies]  # index in its class
    order = list(dict.fromkeys(kind for numbered in own for kind, _ in numbered))
    shared = sorted({*chain(*own)}, key=lambda each: (order.index(each[0]), each[1]))
    return [kind for kind, _ in shared], [[shared.index(each) for each in numbered] for numbered in own]


class SharedBodies:
    """The shared bodies of variants.

    A scene with variants is assembled twice: first with a body for each variant, then with one shared body for all
    variants of an object.

    Args:
        scene: The first assembly.

    Raises:
        SceneKeyError: All contact bits are in use.
    """

    def __init__(self, scene: SceneModel) -> None:
        self._scene, self._full, self._where = scene, scene.mjm, scene.config.where
        full = scene.mjm
        self._hulls = {
            full.mesh(int(full.geom_dataid[geom])).name
            for member in scene.config.owners
            for body in subtree(full, full.body(member).id)
            for geom in _geoms(full, body)
            if full.geom_type[geom] == MESH and full.geom_contype[geom] | full.geom_conaffinity[geom]
        }

    def add(self, spec: mujoco.MjSpec, name: str) -> None:
        """Add the bodies that an object's variants share."""
        mjm, made = self._full, []
        for part in self._scene.shared_parts(name):
            there = [body for body in part.bodies if body >= 0]
            parent = spec.worldbody if part.parent < 0 else made[part.parent]
            # With this inertia, the body is not simple: MuJoCo omits elements of a simple body's mass matrix.
            shared = parent.add_body(
                name=part.name_of(name),
                pos=mjm.body_pos[there[0]],
                quat=mjm.body_quat[there[0]],
                mocap=bool(mjm.body_mocapid[there[0]] >= 0),
                explicitinertial=True,
                mass=1.0,
                ipos=[0.01, 0.02, 0.03],
                fullinertia=[0.01, 0.011, 0.012, 0.001, 0.002, 0.003],
                gravcomp=float(mjm.body_gravcomp[there].max()),
            )
            made.append(shared)
            if part.parent < 0 and not shared.mocap:
                shared.add_freejoint(name=f"{name}/free")
            if part.parent >= 0 and mjm.body_jntnum[there[0]] > 0:
                self._add_joint(shared, mjm.body_jntadr[there])
            self._add_geoms(shared, part.bodies)

    def _add_joint(self, shared: mujoco.MjsBody, joints: np.ndarray) -> None:
        """Add a joint that stands for joints of one class."""
        mjm, first = self._full, joints[0]
        added = shared.add_joint(name=shared.name, type=mujoco.mjtJoint(int(mjm.jnt_type[first])))
        added.axis, added.range, added.limited = mjm.jnt_axis[first], mjm.jnt_range[first], bool(mjm.jnt_limited[first])
        added.actfrcrange, added.actfrclimited = mjm.jnt_actfrcrange[first], bool(mjm.jnt_actfrclimited[first])
        added.actgravcomp = bool(mjm.jnt_actgravcomp[first])
        # mujoco_warp counts the joints with friction to size its arrays, and draws skip values of 0
        dofs = mjm.jnt_dofadr[joints]
        added.frictionloss, added.damping[0] = float(mjm.dof_frictionloss[dofs].max()), mjm.dof_damping[dofs].max()
        added.stiffness[0] = mjm.jnt_stiffness[joints].max()

    def _add_geoms(self, shared: mujoco.MjsBody, bodies: Sequence[int]) -> None:
        """Add the geoms that the bodies of variants share."""
        mjm = self._full
        classes, places = places_of_geoms(mjm, bodies)
        for i, kind in enumerate(classes):
            body, own = next((b, p) for b, p in zip(bodies, places, strict=True) if i in p)
            geom = _geoms(mjm, body)[own.index(i)]
            added = shared.add_geom(name=f"{shared.name}/{i}", type=mujoco.mjtGeom(kind[0]), size=mjm.geom_size[geom])
            for field, value in zip(CLASS[1:], kind[1:], strict=True):
                setattr(added, field, value)
            if kind[0] == MESH:
                added.meshname = mjm.mesh(int(mjm.geom_dataid[geom])).name

    def compile(self, spec: mujoco.MjSpec, before: mujoco.MjModel) -> mujoco.MjModel:
        """Compile the scene again, if possible without the geoms that `name_meshes` added.

        These geoms stay if meshes would lose their hulls without them.

        Args:
            spec: The scene.
            before: The scene, compiled with these geoms.
        """
        if spec.body(_HULLS) is None or spec.compiler.discardvisual:  # discardvisual drops unnamed meshes
            return compile_spec(spec, self._where)
        spec.delete(spec.body(_HULLS))
        mjm = compile_spec(spec, self._where)
        if np.array_equal(mjm.mesh_graphadr, before.mesh_graphadr):
            return mjm
        self.name_meshes(spec)
        return compile_spec(spec, self._where)

    def name_meshes(self, spec: mujoco.MjSpec) -> None:
        """Make MuJoCo compute the hulls of all meshes of variants.

        Add a static body with a geom for each mesh that no other colliding geom uses. These geoms have no contacts, and
        do not appear in pictures.
        """
        spec.stat.center, spec.stat.extent = self._full.stat.center, self._full.stat.extent
        unnamed = sorted(self._hulls - {geom.meshname for geom in spec.geoms if geom.contype | geom.conaffinity})
        if not unnamed:
            return
        used = int(np.bitwise_or.reduce(self._full.geom_conaffinity.astype(np.int64)))
        bit = next((1 << i for i in range(_CONTACT_BITS) if not used >> i & 1), 0)
        if not bit:
            raise SceneKeyError(
                f"{self._where}: objects with variants need a contact bit, but the geoms of the model use all "
                f"{_CONTACT_BITS} bits of conaffinity. Clear the same bit in the conaffinity of all geoms."
            )
        body = spec.worldbody.add_body(name=_HULLS)
        for mesh in unnamed:
            geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh, contype=bit, conaffinity=0, mass=0.0)
            geom.group, geom.rgba = HIDDEN_GROUP, [0.0, 0.0, 0.0, 0.0]


def check_variants(
    spec: mujoco.MjSpec,
    mjm: mujoco.MjModel,
    variants: Mapping[str, tuple[str, ...]],
    where: str,
    *,
    jointed: bool = True,
) -> None:
    """Check that each variant is one rigid body, or a fixture with joints, and that no other element refers to it.

    Args:
        spec: The scene with all variants.
        mjm: The scene, compiled.
        variants: Object -> names of its variants, which are bodies.
        where: The text at the beginning of error messages.
        jointed: Whether a fixture may have several bodies, with joints.

    Raises:
        SceneKeyError: The model already has a body of a name that the simulation needs.
        NotSupportedError: A variant has bodies or joints that cannot be shared, or an element refers to it.
    """
    if mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_BODY, _HULLS) >= 0:
        raise SceneKeyError(
            f"{where}: model: '{_HULLS}': the model has a body of this name already, which is reserved for scenes with "
            "variants. Rename this body in the model."
        )
    for name in variants:
        if mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_BODY, name) >= 0:
            raise SceneKeyError(
                f"{where}: objects.{name}: the model has a body of this name already. Give the object another name."
            )
    rigid = "one rigid body, or a 'kind: fixture' with joints," if jointed else "one rigid body"
    named = [
        (kind, str(getattr(element, field, "") or ""))
        for kind, fields in _REFERENCES.items()
        for element in getattr(spec, kind)
        for field in fields
    ]
    passed = [(_PASSED.get(mujoco.mjtWrap(kind)), i) for kind, i in zip(mjm.wrap_type, mjm.wrap_objid, strict=True)]
    named += [("tendons", mjm.body(getattr(mjm, field)[i]).name) for field, i in passed if field is not None]
    for name in owners_of(variants):
        at, body = f"{where}: objects.{without_support(name)}", mjm.body(name).id
        cure = (
            f"an object with variants or several supports should be {rigid} of plain geoms that no element refers to. "
            "Use objects in a group"
        )
        bodies = subtree(mjm, body)
        if len(bodies) > 1 and not (jointed and mjm.body_mocapid[body] >= 0):
            raise NotSupportedError(f"{at}: has several bodies, but {cure}.")
        if wrong := misfit(mjm, body):
            raise NotSupportedError(f"{at}: {wrong}, because the variants of a fixture share their joints.")
        geoms = np.flatnonzero(np.isin(mjm.geom_bodyid, bodies))
        height_fields = mjm.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_HFIELD
        plugins = np.any(mjm.geom_plugin[geoms] >= 0) or np.any(mjm.body_plugin[bodies] >= 0)
        if plugins or np.any(mjm.geom_fluid[geoms]) or np.any(height_fields):
            raise NotSupportedError(
                f"{at}: has bodies or geoms with plugins, height fields or fluid forces, but {cure}."
            )
        for kind, other in named:
            if other == name or other.startswith(f"{name}/"):
                raise NotSupportedError(f"{at}: is named as '{other}' by one of the model's {kind}, but {cure}.")


def _geoms(mjm: mujoco.MjModel, body: int) -> list[int]:
    return np.flatnonzero(mjm.geom_bodyid == body).tolist()


def without_broken(config: SceneConfig) -> SceneConfig:
    """Return the scene without unsuitable files of folders: MuJoCo cannot load the file, or it is no single rigid body.

    A warning names the files that are left out. If all files are suitable, `config` is returned unchanged.

    Raises:
        SceneFileError: A folder has no suitable file.
    """
    left_out: list[str] = []
    for name, members in config.folders.items():
        broken = {}
        for i, member in enumerate(members):
            tell("files of a folder", i + 1, len(members))
            alone = mujoco.MjSpec()
            try:
                attach_variants(alone, name, {member: config.objects[member]}, config.where, {}, bodies=True)
                mjm = compile_spec(alone, f"{config.where}: objects.{member}.asset")
                check_variants(alone, mjm, {name: (member,)}, config.where)
            except ScenirisError as error:
                broken[member] = str(error)
        where = f"{config.where}: objects.{name}.asset"
        if len(broken) == len(members):
            raise SceneFileError(f"{where}: no file of the folder can be a variant. First error: {broken[members[0]]}")
        if broken:
            told = "\n".join(["", *list(broken.values())[:_TOLD]])
            more = f"\n{len(broken) - _TOLD} more" if len(broken) > _TOLD else ""
            message = f"{where}: {len(broken)} of {len(members)} files of the folder are left out:{told}{more}"
            warnings.warn(ModelWarning(message), stacklevel=3)
            left_out += broken
    return config.without(left_out) if left_out else config
