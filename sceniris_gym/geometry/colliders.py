"""Colliders: the pieces of each body under one tree of boxes, as numpy arrays and (for meshes) on the device."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import warp as wp

from sceniris_gym.geometry.box_tree import build_tree
from sceniris_gym.geometry.depth import most_depth
from sceniris_gym.geometry.pieces import ROUND, Piece, PieceType, flat_faces
from sceniris_gym.geometry.ragged import ranges

# Boxes are grown by this much [m] so that rounding to float32 cannot lose a leaf.
_GROW = 1.0e-6
PIECE_LEAF = 1 << 30
"""Where some leaves are faces, this is added to the number of a piece that is one."""


@dataclass
class Colliders:
    """Colliders and their box trees, one entry per collider in most lists; `keep` holds the device meshes in use."""

    body: list[int] = field(default_factory=list)
    contact_class: list[int] = field(default_factory=list)
    root: list[int] = field(default_factory=list)
    depth_inside: list[float] = field(default_factory=list)
    plane: list[int] = field(default_factory=list)
    mesh: list[int] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)
    center: list[np.ndarray] = field(default_factory=list)
    half: list[np.ndarray] = field(default_factory=list)
    child: list[np.ndarray] = field(default_factory=list)
    faces: list[np.ndarray] = field(default_factory=list)
    depth: list[int] = field(default_factory=list)
    keep: list = field(default_factory=list)
    nodes: int = 0
    leaves: int = 0


def collect_colliders(pieces: list[Piece], visual: bool, device: str) -> Colliders:
    """One collider for each body's solid pieces, and one for each plane; leaves are pieces, or faces if `visual`.

    Round pieces are leaves of their own in either case: no faces describe them exactly. What their faces are good for
    is containment and roofs, so the mesh of a collider has them.
    """
    c = Colliders()
    by_class: dict[tuple[int, bool, int], list[int]] = {}
    for i, p in enumerate(pieces):
        by_class.setdefault((p.body, p.type == PieceType.PLANE, p.contact_class), []).append(i)
    for (body, is_plane, contact_class), solid in by_class.items():
        c.contact_class += [contact_class] * (len(solid) if is_plane else 1)
        if is_plane:
            for i in solid:
                _add_tree(c, body, np.zeros((1, 3)), np.zeros((1, 3)), plane=i, mesh=0, leaves=np.zeros(1, int))
                c.points.append(np.zeros((0, 3)))
                c.depth_inside.append(0.0)
            continue
        if visual:
            meshes = [pieces[i].mesh for i in solid]
            triangles = np.concatenate([m.triangles for m in meshes if m is not None])
            triangles = triangles[~flat_faces(triangles)]
            mesh = device_mesh(triangles.reshape(-1, 3), device)
            c.keep.append(mesh)
            c.depth_inside.append(most_depth(mesh, triangles.min((0, 1)), triangles.max((0, 1)), device))
            _add_faces(c, body, [(i, pieces[i]) for i in solid], mesh.id)
            parts = [part for m in meshes if m is not None for part in m.split(only_watertight=False)]
            # the highest one: it is usually farthest from what carries the object, and nothing is asked about it then
            c.points.append(np.array([part.vertices[part.vertices[:, 2].argmax()] for part in parts]))
        else:
            bounds = [pieces[i].bounds() for i in solid]
            lower, upper = np.array([b[0] for b in bounds]), np.array([b[1] for b in bounds])
            _add_tree(c, body, lower, upper, plane=-1, mesh=0, leaves=np.array(solid))
            c.points.append(np.zeros((0, 3)))
            c.depth_inside.append(0.0)
    return c


def device_mesh(corners: np.ndarray, device: str) -> wp.Mesh:
    """A mesh on a device, with winding numbers, from the corners of its triangles in a row, shape (3n, 3)."""
    return wp.Mesh(
        points=wp.array(corners, dtype=wp.vec3, device=device),
        indices=wp.array(np.arange(len(corners)), dtype=int, device=device),
        support_winding_number=True,
    )


def _add_faces(c: Colliders, body: int, solid: list[tuple[int, Piece]], mesh: int) -> None:
    """Append the collider of a body's visible pieces, given with their numbers."""
    flat = [p.mesh.triangles for _, p in solid if p.mesh is not None and p.type not in ROUND]
    triangles = np.concatenate([*flat, np.zeros((0, 3, 3))])
    triangles = triangles[~flat_faces(triangles)]  # their edges are those of their neighbours
    round_pieces = [(i, p.bounds()) for i, p in solid if p.type in ROUND]
    lower = np.array([*triangles.min(axis=1), *(low for _, (low, _) in round_pieces)])
    upper = np.array([*triangles.max(axis=1), *(high for _, (_, high) in round_pieces)])
    leaves = [*range(c.leaves, c.leaves + len(triangles)), *(PIECE_LEAF + i for i, _ in round_pieces)]
    _add_tree(c, body, lower, upper, plane=-1, mesh=mesh, leaves=np.array(leaves))
    c.faces.append(triangles)
    c.leaves += len(triangles)


def _add_tree(
    c: Colliders, body: int, lower: np.ndarray, upper: np.ndarray, *, plane: int, mesh: int, leaves: np.ndarray
) -> None:
    """Append a collider with leaves of these numbers."""
    tree = build_tree(lower - _GROW, upper + _GROW)
    c.body.append(body)
    c.root.append(c.nodes)
    c.plane.append(plane)
    c.mesh.append(mesh)
    c.center.append(tree.center)
    c.half.append(tree.half)
    number = leaves[np.where(tree.child < 0, ~tree.child, 0)]
    c.child.append(np.where(tree.child < 0, ~number, tree.child + c.nodes))
    c.depth.append(tree.depth)
    c.nodes += len(tree.child)


def collider_arrays(c: Colliders) -> dict[str, np.ndarray]:
    """The fields of `device.Program` that hold colliders, boxes and faces."""
    faces = np.concatenate([*c.faces, np.zeros((0, 3, 3))])
    points, adr, num = ranges(c.points)
    return {
        "collider_body": np.array(c.body, int),
        "collider_root": np.array(c.root, int),
        "collider_plane": np.array(c.plane, int),
        "collider_mesh": np.array(c.mesh, np.uint64),
        "collider_depth": np.array(c.depth_inside),
        "collider_pointadr": adr,
        "collider_pointnum": num,
        "node_center": np.concatenate([*c.center, np.zeros((0, 3))]),
        "node_half": np.concatenate([*c.half, np.zeros((0, 3))]),
        "node_child": np.concatenate([*c.child, np.zeros(0, int)]),
        "face_a": faces[:, 0],
        "face_b": faces[:, 1],
        "face_c": faces[:, 2],
        "point": np.reshape(points, (-1, 3)),
    }
