"""Settled heaps: the rows of a file, the hash of the settled shapes, and the poses of objects."""

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from sceniris_gym.config.groups import HeapConfig
from sceniris_gym.errors import NotSupportedError, SceneKeyError
from sceniris_gym.files import UNREADABLE, no_file, read_arrays
from sceniris_gym.geometry.pieces import mesh_vertices
from sceniris_gym.geometry.supports import SupportSurface, rectangle
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import Support

DEEPEST = 1e-3
"""The greatest penetration [m] between objects of a heap, and between an object and the container."""
STILL = 1e-2
"""A heap is at rest if all of its objects move slower than this [m/s]."""

# Geom fields that affect how an object comes to rest.
_GEOM = ("geom_type", "geom_size", "geom_pos", "geom_quat", "geom_contype", "geom_conaffinity", "geom_friction")
_AROUND = 1e-3  # m, by which the surface of a heap extends beyond the roots of its objects


class HeapRows(NamedTuple):
    """Settled heaps, with poses relative to the body that the heap fills.

    Attributes:
        names: The objects.
        pos: Positions of the objects' root bodies [m], shape (nrow, nthing, 3).
        quat: Orientations of the root bodies, wxyz, shape (nrow, nthing, 4).
        settled_with: Identifies the shapes and masses of the settled bodies: 16 hexadecimal digits.
    """

    names: tuple[str, ...]
    pos: np.ndarray
    quat: np.ndarray
    settled_with: str

    def write(self, path: Path) -> None:
        """Write the heaps as a .npz file. The same rows give the same bytes."""
        rows = self._replace(pos=self.pos.astype(np.float32), quat=self.quat.astype(np.float32))
        with path.open("wb") as file:
            np.savez(file, **rows._asdict())


def read_rows(path: Path, heap: HeapConfig, where: str) -> HeapRows:
    """Read settled heaps.

    Args:
        path: The file.
        heap: The heap of the scene.
        where: The text at the beginning of error messages.

    Raises:
        SceneKeyError: The file is missing, was not written by `sceniris-gym settle`, or has other objects.
    """
    mend = "Make it with `sceniris-gym settle SCENE`."
    if not path.is_file():
        raise SceneKeyError(f"{where}.rows: '{path}': {no_file(path)}. {mend}")
    try:
        found = read_arrays(path)
        names = tuple(str(name) for name in found["names"])
        rows = HeapRows(names, found["pos"], found["quat"], str(found["settled_with"]))
        whole = rows.pos.shape[1:] == (len(names), 3) and rows.quat.shape == (*rows.pos.shape[:2], 4)
        sound = whole and len(rows.pos) > 0 and np.isfinite(rows.pos).all()
        if not sound or not np.abs(np.linalg.norm(rows.quat, axis=-1) - 1.0).max(initial=0.0) < 1e-3:
            raise ValueError(path)
    except UNREADABLE:
        raise SceneKeyError(f"{where}.rows: '{path}' holds no settled heaps. {mend}") from None
    if rows.names != heap.of:
        listed = ", ".join(rows.names)
        raise SceneKeyError(
            f"{where}.rows: '{path}' has heaps of {listed}, but the heap in the scene has {', '.join(heap.of)}. {mend}"
        )
    return rows


def rigid_part(mjm: mujoco.MjModel, body: int) -> list[int]:
    """Return a body and all bodies of its kinematic tree that are fixed to this body, in ascending order."""
    same = (mjm.body_weldid == mjm.body_weldid[body]) & (mjm.body_rootid == mjm.body_rootid[body])
    return np.flatnonzero(same).tolist()


def filled_body(scene: SceneModel, heap: HeapConfig, where: str) -> int:
    """Return the body that a heap fills.

    Raises:
        UnknownNameError: The scene has no support of that name.
        NotSupportedError: The body is the world.
    """
    body = scene.support(heap.fill, f"{where}.fill").body
    if body == 0:
        raise NotSupportedError(f"{where}.fill: '{heap.fill}' is part of the world. Name a separate body with walls.")
    return body


def settled_with(scene: SceneModel, heap: HeapConfig, where: str) -> str:
    """Return the hash of the shapes and masses of a heap's objects and container.

    Raises:
        NotSupportedError: An object has inner joints.
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
            # Rounding, and -0.0 as 0.0, make the hash independent of the last digits.
            for array in arrays:
                digest.update((np.round(np.asarray(array, np.float64), 6) + 0.0).tobytes())
    return digest.hexdigest()[:16]


def rigid_thing(scene: SceneModel, name: str, where: str) -> list[int]:
    """Return the bodies of an object of a heap, after a check that the object is free and rigid.

    Raises:
        NotSupportedError: The object has inner joints, or is not free.
    """
    bodies = scene.subtree(name)
    if scene.config.objects[name].kind != "free" or scene.mjm.body_jntnum[bodies[1:]].any():
        raise NotSupportedError(
            f"{where}.of: object '{name}' should have 'kind: free' and no inner joints, as heaps need rigid objects."
        )
    return bodies


class HeapPoses(NamedTuple):
    """The settled poses of one object of a heap, relative to the body that the heap fills.

    Attributes:
        pos: Position of the object's root [m], shape (nrow, 3).
        quat: Orientation of the object, wxyz, shape (nrow, 4).
        stream: The random stream that draws the row. All objects of a heap share it.
        together: All bodies that settled together: the bodies of the heap's objects, the body that the heap fills, and
            all bodies fixed to it.
        support: The support that the heap fills.
        surface: A rectangle around the roots in all rows, seen from above, at the height of the highest root.
    """

    pos: np.ndarray
    quat: np.ndarray
    stream: int
    together: frozenset[int]
    support: Support
    surface: SupportSurface


def heap_poses(scene: SceneModel) -> dict[str, HeapPoses]:
    """Read the settled poses of all objects of heaps, by name.

    Raises:
        SceneKeyError: A heap has no rows, or its rows are for other objects, shapes or masses.
        NotSupportedError: An object has inner joints, or a heap fills the world.
    """
    found: dict[str, HeapPoses] = {}
    for key, heap in scene.config.heaps.items():
        where = f"{scene.config.where}: heaps.{key}"
        if heap.rows is None:
            raise SceneKeyError(
                f"{where}.rows: is missing. Run `sceniris-gym settle SCENE -o ROWS.npz`, and write 'rows: ROWS.npz'."
            )
        rows = read_rows(Path(heap.rows), heap, where)
        if rows.settled_with != settled_with(scene, heap, where):
            raise SceneKeyError(
                f"{where}.rows: '{heap.rows}' was settled with other shapes or masses than in this scene. Run "
                "`sceniris-gym settle SCENE` again."
            )
        body = filled_body(scene, heap, where)
        low, high = rows.pos.min(axis=(0, 1)) - _AROUND, rows.pos.max(axis=(0, 1)) + _AROUND
        things = [thing for name in heap.of for thing in rigid_thing(scene, name, where)]
        shared = {
            "stream": 1 + list(scene.config.objects).index(heap.of[0]),
            "together": frozenset([*things, *rigid_part(scene.mjm, body)]),
            "support": scene.support(heap.fill, f"{where}.fill"),
            "surface": replace(rectangle(low, high), body=body, height=float(high[2])),
        }
        found |= {name: HeapPoses(rows.pos[:, i], rows.quat[:, i], **shared) for i, name in enumerate(heap.of)}
    return found
