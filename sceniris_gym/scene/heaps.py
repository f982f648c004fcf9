"""Settled heaps: the rows of a file, and the hash of the shapes that they were settled with."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from sceniris_gym.config.heaps import HeapConfig
from sceniris_gym.config.stored_arrays import UNREADABLE, read_arrays
from sceniris_gym.errors import HeapError, NotSupportedError
from sceniris_gym.files import no_file
from sceniris_gym.geometry.pieces import mesh_vertices
from sceniris_gym.scene.model import SceneModel

DEEPEST = 1e-3
"""The greatest depth [m] to which things of a heap may sink into each other and into the container."""
STILL = 1e-2
"""A heap is at rest if nothing in it moves faster than this [m/s]."""

# The fields of a geom that decide how it comes to rest.
_GEOM = ("geom_type", "geom_size", "geom_pos", "geom_quat", "geom_contype", "geom_conaffinity", "geom_friction")


@dataclass(frozen=True)
class HeapRows:
    """Settled heaps, poses relative to the body that is filled.

    Attributes:
        names: The things.
        pos: Positions of their roots [m], shape (nrow, nthing, 3).
        quat: Their orientations, wxyz, shape (nrow, nthing, 4).
        settled_with: Identifies the shapes that they were settled with: 16 hexadecimal digits.
    """

    names: tuple[str, ...]
    pos: np.ndarray
    quat: np.ndarray
    settled_with: str

    def write(self, path: Path) -> None:
        """Write them as a .npz file, the same bytes for the same rows."""
        rows = replace(self, pos=self.pos.astype(np.float32), quat=self.quat.astype(np.float32))
        with path.open("wb") as file:
            np.savez(file, **vars(rows))


def read_rows(path: Path, heap: HeapConfig, where: str) -> HeapRows:
    """Read settled heaps.

    Args:
        path: The file.
        heap: The heap that they are for.
        where: The beginning of errors.

    Raises:
        HeapError: The file is missing, is not one of `sceniris-gym settle`, or is of other things.
    """
    mend = "Make it with `sceniris-gym settle SCENE`."
    if not path.is_file():
        raise HeapError(f"{where}.rows: '{path}': {no_file(path)}. {mend}")
    try:
        found = read_arrays(path)
        names = tuple(str(name) for name in found["names"])
        rows = HeapRows(names, found["pos"], found["quat"], str(found["settled_with"]))
        whole = rows.pos.shape[1:] == (len(names), 3) and rows.quat.shape == (*rows.pos.shape[:2], 4)
        sound = whole and len(rows.pos) > 0 and np.isfinite(rows.pos).all()
        if not sound or not np.abs(np.linalg.norm(rows.quat, axis=-1) - 1.0).max(initial=0.0) < 1e-3:
            raise ValueError(path)
    except UNREADABLE:
        raise HeapError(f"{where}.rows: '{path}' holds no settled heaps. {mend}") from None
    if rows.names != heap.of:
        listed = ", ".join(rows.names)
        raise HeapError(
            f"{where}.rows: '{path}' has heaps of {listed}, and the heap is of {', '.join(heap.of)}. {mend}"
        )
    return rows


def rigid_part(mjm: mujoco.MjModel, body: int) -> list[int]:
    """Return the bodies below one child of the world that never move relative to a body, ascending."""
    same = (mjm.body_weldid == mjm.body_weldid[body]) & (mjm.body_rootid == mjm.body_rootid[body])
    return np.flatnonzero(same).tolist()


def filled_body(scene: SceneModel, heap: HeapConfig, where: str) -> int:
    """Return the body that a heap fills.

    Raises:
        UnknownNameError: There is nothing of that name.
        NotSupportedError: It is the world.
    """
    body = scene.support(heap.fill, f"{where}.fill").body
    if body == 0:
        raise NotSupportedError(f"{where}.fill: '{heap.fill}' is part of the world. Name a body with walls around it.")
    return body


def settled_with(scene: SceneModel, heap: HeapConfig, where: str) -> str:
    """Return the hash of the shapes and masses of a heap's things and of its container.

    Raises:
        NotSupportedError: A thing with joints of its own.
    """
    mjm, digest = scene.mjm, hashlib.sha256()
    container = rigid_part(mjm, filled_body(scene, heap, where))
    for bodies in (container, *(rigid_thing(scene, name, where) for name in heap.of)):
        for body in bodies:
            pose = np.hstack([mjm.body_pos[body], mjm.body_quat[body]]) if body != bodies[0] else np.zeros(0)
            arrays = [pose, mjm.body_mass[body : body + 1], mjm.body_inertia[body], mjm.body_ipos[body]]
            for geom in np.flatnonzero(mjm.geom_bodyid == body):
                arrays += [getattr(mjm, field)[geom].reshape(-1) for field in _GEOM]
                mesh = int(mjm.geom_dataid[geom])
                if mesh >= 0 and mjm.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
                    arrays.append(mesh_vertices(mjm, mesh))
            for array in arrays:
                digest.update((np.round(np.asarray(array, np.float64), 6) + 0.0).tobytes())
    return digest.hexdigest()[:16]


def rigid_thing(scene: SceneModel, name: str, where: str) -> list[int]:
    """Return the bodies of a thing of a heap.

    Raises:
        NotSupportedError: It has joints of its own, or is not free.
    """
    bodies = scene.subtree(name)
    if scene.config.objects[name].kind != "free" or scene.mjm.body_jntnum[bodies[1:]].any():
        raise NotSupportedError(
            f"{where}.of: '{name}' should be 'free' and have no joints of its own: heaps are of rigid things."
        )
    return bodies
