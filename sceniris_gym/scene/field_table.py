"""Model fields that worlds can differ in: their names, and the rows that belong to a name of the scene."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterator, Mapping

import mujoco
import numpy as np

from sceniris_gym.errors import ArgumentError, UnknownNameError
from sceniris_gym.scene.support import subtree

_FIELDS = {
    "body": "mass inertia ipos iquat gravcomp",
    "jnt": "solref solimp stiffness stiffnesspoly springyield actfrcrange",
    "dof": "solref solimp frictionloss armature damping dampingpoly",
    "geom": "solmix solref solimp friction surfacevel adhesion rgba matid",
    "cam": "pos quat fovy intrinsic",
    "light": "type castshadow active pos dir attenuation cutoff exponent ambient diffuse specular",
    "mat": "texid texrepeat texuniform emission specular shininess rgba",
    "pair": "solref solreffriction solimp friction adhesion",
    "eq": "solref solimp",
    "tendon": "solref_lim solimp_lim solref_fri solimp_fri stiffness stiffnesspoly damping dampingpoly armature "
    "frictionloss springyield actfrcrange",
    "actuator": "dynprm gainprm biasprm delay damping dampingpoly armature forcerange gear",
}
OPTIONS = ("gravity", "wind", "magnetic", "density", "viscosity")
"""Fields of the model's options."""
FIELDS = (*(f"{kind}_{word}" for kind, words in _FIELDS.items() for word in words.split()), *OPTIONS)
"""Fields that worlds can differ in: neither places nor shapes, which layouts depend on, nor what follows from these."""

LEFT_OUT_AT_ZERO = (
    *("body_gravcomp", "tendon_stiffness", "tendon_damping", "actuator_armature"),
    *("wind", "density", "viscosity"),
)
"""Fields that mujoco_warp leaves out of its steps if the model has zeros alone."""
_SELDOM_FULL = ("body_ipos", "body_iquat")
"""Fields that shape the mass matrix of a body which MuJoCo took for a simple one."""

_ON_JOINTS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_KINDS = {"jnt": "joint", "dof": "joint", "cam": "camera", "mat": "material", "eq": "equality"}


def fields_of(mjm: mujoco.MjModel) -> list[str]:
    """Return the fields that a model has, without those of its options."""
    return [name for name in FIELDS if name not in OPTIONS and hasattr(mjm, name)]


def check_field(name: str, mjm: mujoco.MjModel, where: str) -> None:
    """Refuse a field that worlds cannot differ in.

    Raises:
        UnknownNameError: There is no such field, or layouts depend on it.
        ArgumentError: Steps of this model leave the field out.
    """
    if name not in FIELDS or not hasattr(mjm.opt if name in OPTIONS else mjm, name):
        raise UnknownNameError("model field", name, where, FIELDS)
    if name in LEFT_OUT_AT_ZERO and not np.any(getattr(mjm.opt if name in OPTIONS else mjm, name)):
        raise ArgumentError(
            f"{where}: '{name}' is 0 in the whole model, so steps leave it out. It should have a value other than 0 in "
            "the model, however small."
        )


def field_rows(mjm: mujoco.MjModel, bodies: Mapping[str, int], field: str, name: str, where: str) -> int | slice:
    """Return the rows of a field that belong to a name: one by its number, several that follow each other as a slice.

    An object or a robot has the row of its root body in fields of bodies; of geoms, joints and actuators, it has all
    that are inside of it.

    Args:
        mjm: The model.
        bodies: Root bodies of objects and robots by their names.
        field: The field.
        name: The element, object or robot.
        where: Begins errors.

    Raises:
        UnknownNameError: Nothing of that name has rows in this field.
        ArgumentError: The rows do not follow each other.
    """
    if field in OPTIONS:
        raise UnknownNameError("part of a field of the whole scene", name, f"{where} of '{field}'", ())
    prefix = field.partition("_")[0]
    kind = _KINDS.get(prefix, prefix)
    names = [element for element, _ in elements(mjm, kind)]
    ids = [i for element, i in elements(mjm, kind) if element == name] if name not in bodies else []
    alone = bool(ids)
    if not ids:
        body = bodies[name] if name in bodies else mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_BODY, name)
        if body >= 0:
            ids, alone = _inside(mjm, kind, body)
    if prefix == "dof":
        ids = [d for d, joint in enumerate(mjm.dof_jntid) if joint in ids]
        alone = alone and len(ids) == 1
    if not ids:
        known = {*names, *bodies, *(mjm.body(i).name for i in range(1, mjm.nbody))}
        raise UnknownNameError(kind, name, f"{where} of '{field}'", filter(None, known))
    if np.any(np.diff(ids) != 1):
        raise ArgumentError(
            f"{where} of '{field}': the {kind}s of '{name}' do not follow each other in the model. It should name one "
            "of them, or take the field of all."
        )
    if field in _SELDOM_FULL and np.any(mjm.body_simple[ids]):
        raise ArgumentError(
            f"{where} of '{field}': '{name}' is a simple body, whose mass matrix has no room for another centre of "
            'mass. It should have simple="false" in its file, which MuJoCo 4 knows.'
        )
    return int(ids[0]) if alone else slice(int(ids[0]), int(ids[-1]) + 1)


def elements(mjm: mujoco.MjModel, kind: str) -> Iterator[tuple[str, int]]:
    """Yield the names and the numbers of the elements of a kind."""
    counts = {"camera": mjm.ncam, "material": mjm.nmat, "texture": mjm.ntex, "equality": mjm.neq, "joint": mjm.njnt}
    count = counts.get(kind)
    if count is None:
        count = len(mjm.actuator_trntype) if kind == "actuator" else getattr(mjm, f"n{kind}")
    return ((getattr(mjm, kind)(i).name, i) for i in range(count))


def rows_inside(mjm: mujoco.MjModel, field: str, body: int) -> list[int]:
    """Return the rows of a field that belong to a body or to what is below it: all of its bodies, geoms or joints."""
    prefix = field.partition("_")[0]
    if prefix == "body":
        return subtree(mjm, body)
    inside, _ = _inside(mjm, _KINDS.get(prefix, prefix), body)
    return np.flatnonzero(np.isin(mjm.dof_jntid, inside)).tolist() if prefix == "dof" else inside


def rows_named(mjm: mujoco.MjModel, kind: str, pattern: str) -> list[int]:
    """Return the numbers of the lights, cameras or materials whose names a pattern matches."""
    return [i for name, i in elements(mjm, kind) if fnmatch.fnmatchcase(name, pattern)]


def _inside(mjm: mujoco.MjModel, kind: str, body: int) -> tuple[list[int], bool]:
    """Return the numbers of the elements of a kind inside of a body, and whether it is the body alone."""
    if kind == "body":
        return [body], True
    if kind == "actuator":
        bodies = [_actuator_body(mjm, i) for i in range(len(mjm.actuator_trntype))]
    else:
        of = {"joint": mjm.jnt_bodyid, "geom": mjm.geom_bodyid, "camera": mjm.cam_bodyid, "light": mjm.light_bodyid}
        bodies = of.get(kind, [])
    return np.flatnonzero(np.isin(bodies, subtree(mjm, body))).tolist(), False


def _actuator_body(mjm: mujoco.MjModel, actuator: int) -> int:
    """Return the body that an actuator moves, the first one of those that it moves by a tendon; -1 for none."""
    kind, target = mjm.actuator_trntype[actuator], mjm.actuator_trnid[actuator, 0]
    if kind == mujoco.mjtTrn.mjTRN_TENDON:
        first = mjm.tendon_adr[target]
        target, on_joint = mjm.wrap_objid[first], mjm.wrap_type[first] == mujoco.mjtWrap.mjWRAP_JOINT
        return int((mjm.jnt_bodyid if on_joint else mjm.site_bodyid)[target])
    if int(kind) in _ON_JOINTS:
        return int(mjm.jnt_bodyid[target])
    return int(mjm.site_bodyid[target]) if kind == mujoco.mjtTrn.mjTRN_SITE else -1
