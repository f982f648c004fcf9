"""Formats in which a part of a data set is also written, next to its `.npy` file: npz, JSON, MJCF and USD.

The bytes of a file depend only on the rows of the part, so every process writes the same bytes.
"""

import io
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from sceniris_gym.errors import check_names, import_extra
from sceniris_gym.files import as_json as strict_json
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.scene.poses import body_poses

Encoder = Callable[[CompiledScene, np.ndarray], bytes]
"""Takes a compiled scene and the rows of a part, and returns the bytes of a file."""


def parse_formats(text: str) -> tuple[str, ...]:
    """Read names of formats, separated by commas, and return them in alphabetical order.

    Raises:
        UnknownNameError: A format is unknown.
        MissingExtraError: A format needs a library that is not installed.
    """
    names = [word.strip() for word in text.split(",")]
    check_names("format", names, "generate: --format", FORMATS)
    check_formats(names)
    return tuple(sorted(set(names)))


def check_formats(formats: Sequence[str]) -> None:
    """Check that the libraries of formats are installed.

    Raises:
        MissingExtraError: usd-core is not installed.
    """
    if "usd" in formats:
        import_extra("pxr", "import", "usd-core")


def poses_by_name(compiled: CompiledScene, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Return the poses of all objects and robots in the world frame, by name. A single robot is 'robot'.

    Args:
        compiled: The compiled scene.
        rows: Rows of one part (file) of a data set, shape (n,).

    Returns:
        Position [m] and orientation (wxyz) of each root body, shape (n, 7), float32. An absent object has
        the pose of its parking place.
    """
    states = (rows["qpos"], rows["mocap_pos"], rows["mocap_quat"])
    return {
        name: np.hstack(body_poses(compiled.mjm, compiled.scene.bodies[name], *states)).astype(np.float32)
        for name in compiled.slots
    }


def joints_by_name(compiled: CompiledScene, rows: np.ndarray) -> dict[str, np.ndarray]:
    """Return the positions of all named joints except free joints, and of all `parts` of objects, by name.

    They are NaN in rows without the variant that has the joint.

    Args:
        compiled: The compiled scene.
        rows: Rows of a part, shape (n,).

    Returns:
        Positions [rad or m], shape (n,). For a ball joint, quaternions (wxyz), shape (n, 4).
    """
    mjm, owners, found, parts = compiled.mjm, compiled.config.owners, {}, {}
    for joint in range(mjm.njnt):
        name, kind, adr = mjm.joint(joint).name, mjm.jnt_type[joint], mjm.jnt_qposadr[joint]
        if kind == mujoco.mjtJoint.mjJNT_BALL:
            found[name] = rows["qpos"][:, adr : adr + 4]
        elif kind != mujoco.mjtJoint.mjJNT_FREE:
            found[name] = rows["qpos"][:, adr]
    for name, config in compiled.config.objects.items():
        there = rows["present"][:, compiled.slots.index(name)]
        for local, joint in compiled.scene.joints(name).items():
            values = np.where(there, rows["qpos"][:, mjm.jnt_qposadr[joint]], np.float32(np.nan))
            if local in config.parts:
                full = f"{owners.get(name, name)}/{local}"
                parts[full] = np.fmax(values, parts.get(full, values))
            elif name in owners:
                found[mjm.joint(joint).name] = values
    found |= parts
    found.pop("", None)
    return found


def as_npz(compiled: CompiledScene, rows: np.ndarray) -> bytes:
    """Return the bytes of a .npz file with all columns, `pose/OBJECT`, shape (n, 7), and `joint/JOINT`, shape (n,)."""
    arrays: dict[str, Any] = {name: np.ascontiguousarray(rows[name]) for name in rows.dtype.names or ()}
    arrays |= {f"pose/{name}": values for name, values in poses_by_name(compiled, rows).items()}
    arrays |= {f"joint/{name}": np.ascontiguousarray(v) for name, v in joints_by_name(compiled, rows).items()}
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def as_json(compiled: CompiledScene, rows: np.ndarray) -> bytes:
    """Return the bytes of a JSON file: a list of layouts, one per line.

    A layout has all columns, and mappings by name: `poses`, `joints` and `present`. Numbers have enough digits to read
    the same float32 back. Non-finite numbers are null.
    """
    columns = {name: rows[name].tolist() for name in rows.dtype.names or () if name != "present"}
    poses = {name: values.tolist() for name, values in poses_by_name(compiled, rows).items()}
    joints = {name: values.tolist() for name, values in joints_by_name(compiled, rows).items()}
    lines = []
    for i in range(len(rows)):
        layout = {
            **{name: values[i] for name, values in columns.items()},
            "present": dict(zip(compiled.slots, rows["present"][i].tolist(), strict=True)),
            "poses": {name: values[i] for name, values in poses.items()},
            "joints": {name: values[i] for name, values in joints.items()},
        }
        lines.append(strict_json(layout, digits=9))
    return ("[\n" + ",\n".join(lines) + "\n]\n").encode()


def as_usd(compiled: CompiledScene, rows: np.ndarray) -> bytes:
    """Return the bytes of a USD stage that refers to the stage of the scene, see `usd_stage.part_bytes`."""
    from sceniris_gym.dataset import usd_stage

    return usd_stage.part_bytes(compiled, rows)


def as_mjcf(compiled: CompiledScene, rows: np.ndarray) -> bytes:
    """Return the bytes of a zip file with a model of each row for stock MuJoCo, see `own_models.part_bytes`."""
    from sceniris_gym.dataset import own_models

    return own_models.part_bytes(compiled, rows)


FORMATS: dict[str, tuple[str, Encoder]] = {
    "json": (".json", as_json),
    "mjcf": (".zip", as_mjcf),
    "npz": (".npz", as_npz),
    "usd": (".usdc", as_usd),
}
"""The file suffix and the encoder of each format."""
