"""Finds numbers in a model that MuJoCo accepts, but a simulation cannot use."""

import mujoco
import numpy as np

from sceniris_gym.config.bounds import BOUNDS
from sceniris_gym.errors import SceneKeyError

_BOUNDED = {
    **dict.fromkeys(("body_pos", "geom_pos", "geom_size", "jnt_pos", "site_pos", "mesh_vert"), "model length"),
    **dict.fromkeys(("geom_friction", "pair_friction"), "friction"),
    "body_mass": "mass",
}
"""Fields of MjModel with lengths [m], masses [kg] or coefficients, and their kinds in `BOUNDS`."""
_OPTIONS = {
    "timestep": "timestep",
    "gravity": "acceleration",
    "impratio": "impedance ratio",
    **dict.fromkeys(("tolerance", "ls_tolerance", "noslip_tolerance", "ccd_tolerance"), "tolerance"),
    **dict.fromkeys(("iterations", "ls_iterations", "noslip_iterations", "ccd_iterations"), "iterations"),
}
"""Fields of MjOption and their kinds in `BOUNDS`. All other fields only have to be finite."""
_KINDS = ("body", "geom", "jnt", "site", "mesh", "pair", "key", "actuator", "sensor", "tendon", "eq", "dof")


def check_numbers(mjm: mujoco.MjModel, where: str) -> None:
    """Check that a model has no nan, and no length, mass, coefficient or option beyond realistic bounds.

    Infinity is accepted where MuJoCo uses it for the absence of a limit, such as in `range`.

    Raises:
        SceneKeyError: A number is wrong. The message names the first wrong field and its element.
    """
    for name in (name for name in dir(mjm.opt) if not name.startswith("_")):
        bound, values = BOUNDS.get(_OPTIONS.get(name, "")), np.atleast_1d(getattr(mjm.opt, name))
        if not np.isfinite(values).all() or (bound is not None and not all(map(bound.holds, values))):
            advice = "should be a finite number" if bound is None else bound.advice
            found = ", ".join(f"{x:g}" for x in values)
            raise SceneKeyError(f"{where}: model: option {name}: {found} {advice}. Correct it in the MJCF file.")
    for name in (name for name in dir(mjm) if not name.startswith("_")):
        values = getattr(mjm, name)
        if not isinstance(values, np.ndarray) or values.dtype.kind != "f":
            continue
        wrong, advice = np.isnan(values), "should be a number"
        if (bound := BOUNDS.get(_BOUNDED.get(name, ""))) is not None and not wrong.any():
            wrong, advice = (values < bound.low) | (values > bound.high), bound.advice
        if wrong.any():
            at, spot = tuple(np.argwhere(wrong)[0]), ""
            if name == "key_qpos":
                joint = int(np.searchsorted(mjm.jnt_qposadr, at[1], side="right")) - 1
                spot = f" (qpos[{at[1]}], joint '{mjm.joint(joint).name or joint}')"
            raise SceneKeyError(
                f"{where}: model: {name} of {_element(mjm, name, int(at[0]))}: {values[at]:g} {advice}{spot}. "
                "Correct it in the MJCF file."
            )


def _element(mjm: mujoco.MjModel, field: str, index: int) -> str:
    """Return the element of a field's row, such as "geom 'top'", or its number if it has no name."""
    kind = field.split("_", maxsplit=1)[0]
    if kind not in _KINDS:
        return f"element {index}"
    if field == "mesh_vert":  # its rows are vertices of all meshes
        index = int(np.searchsorted(mjm.mesh_vertadr, index, side="right")) - 1
    elif kind == "dof":
        kind, index = "jnt", int(mjm.dof_jntid[index])
    of = mujoco.mju_str2Type({"jnt": "joint", "eq": "equality"}.get(kind, kind))
    name = mujoco.mj_id2name(mjm, of, index)  # None if the rows of the field are no elements of this kind
    return f"{kind} '{name}'" if name else f"{kind} {index}"
