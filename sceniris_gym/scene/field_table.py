"""Model fields with values per world: their names, and the rows of each element, object or robot."""

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
"""Fields that can have values per world. Poses and shapes that layouts depend on, and derived fields, are excluded."""

LEFT_OUT_AT_ZERO = (
    *("body_gravcomp", "tendon_stiffness", "tendon_damping", "actuator_armature"),
    *("wind", "density", "viscosity"),
)
"""Fields that mujoco_warp leaves out of its steps if all their values in the model are zero."""
_SELDOM_FULL = ("body_ipos", "body_iquat")
"""Fields that may not vary for bodies that MuJoCo marks as simple, because their mass matrix is sparser."""

JOINT_TRANSMISSIONS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_KINDS = {"jnt": "joint", "dof": "joint", "cam": "camera", "mat": "material", "tex": "texture", "eq": "equality"}


def check_field(name: str, mjm: mujoco.MjModel, where: str) -> None:
    """Raise an error if a field cannot have values per world.

    Raises:
        UnknownNameError: The field does not exist, or layouts depend on it.
        ArgumentError: The field is 0 in the whole model. Steps of this model skip the field.
    """
    if name not in FIELDS or not hasattr(mjm.opt if name in OPTIONS else mjm, name):
        raise UnknownNameError("model field", str(name), where, FIELDS)
    if name in LEFT_OUT_AT_ZERO and not np.any(getattr(mjm.opt if name in OPTIONS else mjm, name)):
        raise ArgumentError(
            f"{where}: '{name}' is 0 in the whole model, so simulation steps ignore it. Give it a value other than 0 "
            "in the model, however small."
        )


def field_rows(mjm: mujoco.MjModel, bodies: Mapping[str, int], field: str, name: str, where: str) -> int | slice:
    """Return the rows of a field for a name: the index of a single row, or a slice of consecutive rows.

    For an object or a robot, a body field has only the row of the root body. Fields of geoms, joints and actuators have
    the rows of all elements inside the object or robot.

    Args:
        mjm: The model.
        bodies: Root bodies of objects and robots by their names.
        field: The field.
        name: The element, object or robot.
        where: The text at the beginning of error messages.

    Raises:
        UnknownNameError: The field has no rows for that name.
        ArgumentError: The rows are not consecutive, or the field cannot vary for a simple body.
    """
    name = str(name)  # MuJoCo accepts only strings
    if field in OPTIONS:
        at = f"{where}: '{field}' belongs to the whole scene, so leave out the name of an element"
        raise UnknownNameError("element", name, at, ())
    prefix = field.partition("_")[0]
    kind = _KINDS.get(prefix, prefix)
    named = dict(elements(mjm, kind))
    alone = prefix == "body"
    if name in named and name not in bodies:
        ids = np.flatnonzero(mjm.dof_jntid == named[name]).tolist() if prefix == "dof" else [named[name]]
        alone = len(ids) == 1
    else:
        body = bodies.get(name, mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_BODY, name))
        ids = [] if body < 0 else [body] if alone else rows_inside(mjm, field, body)
    if not ids:
        known = {*named, *bodies, *(mjm.body(i).name for i in range(1, mjm.nbody))}
        raise UnknownNameError(kind, name, f"{where} of '{field}'", filter(None, known))
    if np.any(np.diff(ids) != 1):
        raise ArgumentError(
            f"{where} of '{field}': the {kind}s of '{name}' are not consecutive in the model. Name one "
            "of them, or set the whole field."
        )
    if field in _SELDOM_FULL and np.any(mjm.body_simple[ids]):
        raise ArgumentError(
            f"{where} of '{field}': the field cannot change, because MuJoCo simplifies the mass matrix of body "
            f"'{name}'. Set simple=\"false\" for this body in its MJCF file, with MuJoCo 4 or later."
        )
    return int(ids[0]) if alone else slice(int(ids[0]), int(ids[-1]) + 1)


def elements(mjm: mujoco.MjModel, kind: str) -> Iterator[tuple[str, int]]:
    """Yield the names and ids of the elements of a kind."""
    prefix = {of: prefix for prefix, of in _KINDS.items() if prefix != "dof"}.get(kind, kind)
    return ((getattr(mjm, kind)(i).name, i) for i in range(len(getattr(mjm, f"name_{prefix}adr"))))


def rows_inside(mjm: mujoco.MjModel, field: str, body: int) -> list[int]:
    """Return the rows of a field for all bodies, geoms, joints or actuators of a body's subtree."""
    prefix, inside = field.partition("_")[0], subtree(mjm, body)
    if prefix == "body":
        return inside
    if prefix == "actuator":
        bodies = [_actuator_body(mjm, i) for i in range(len(mjm.actuator_trntype))]
    else:
        bodies = getattr(mjm, f"{prefix}_bodyid", [])
    return np.flatnonzero(np.isin(bodies, inside)).tolist()


def _actuator_body(mjm: mujoco.MjModel, actuator: int) -> int:
    """Return the body that an actuator moves, or -1 if it moves no body. For a tendon, return its first body."""
    kind, target = mjm.actuator_trntype[actuator], mjm.actuator_trnid[actuator, 0]
    if kind == mujoco.mjtTrn.mjTRN_TENDON:
        first = mjm.tendon_adr[target]
        target, on_joint = mjm.wrap_objid[first], mjm.wrap_type[first] == mujoco.mjtWrap.mjWRAP_JOINT
        return int((mjm.jnt_bodyid if on_joint else mjm.site_bodyid)[target])
    if int(kind) in JOINT_TRANSMISSIONS:
        return int(mjm.jnt_bodyid[target])
    return int(mjm.site_bodyid[target]) if kind == mujoco.mjtTrn.mjTRN_SITE else -1
