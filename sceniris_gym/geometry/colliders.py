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
_NO_POINTS = np.zeros((0, 3))
PIECE_LEAF = 1 << 30
"""Added to the number of a piece that is a leaf where other leaves are faces."""


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
    """Return a collider for each body's solid pieces, and one for each plane; leaves are pieces, or faces if `visual`.

    Round pieces are leaves of their own in either case, as no faces describe them exactly. Their faces serve for
    containment and covers only, so the mesh of a collider has them.
    """
    c = Colliders()
    by_class: dict[tuple[int, bool, int], list[int]] = {}
    for i, p in enumerate(pieces):
        by_class.setdefault((p.body, p.type == PieceType.PLANE, p.contact_class), []).append(i)
    for (body, is_plane, contact_class), solid in by_class.items():
        c.contact_class += [contact_class] * (len(solid) if is_plane else 1)
        if is_plane:
            for i in solid:
                _add_tree(c, body, np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1, int), plane=i)
        elif visual:
            _add_faces(c, body, [(i, pieces[i]) for i in solid], device)
        else:
            lower, upper = np.stack([pieces[i].bounds() for i in solid], axis=1)
            _add_tree(c, body, lower, upper, np.array(solid))
    return c


def device_mesh(corners: np.ndarray, device: str) -> wp.Mesh:
    """Return a mesh on a device, with winding numbers, from the corners of its triangles in a row, shape (3n, 3)."""
    return wp.Mesh(
        points=wp.array(corners, dtype=wp.vec3, device=device),
        indices=wp.array(np.arange(len(corners)), dtype=int, device=device),
        support_winding_number=True,
    )


def _add_faces(c: Colliders, body: int, solid: list[tuple[int, Piece]], device: str) -> None:
    """Append the collider of a body's visible pieces, given with their numbers."""
    meshes = [p.mesh for _, p in solid if p.mesh is not None]
    all_faces = np.concatenate([m.triangles for m in meshes])
    all_faces = all_faces[~flat_faces(all_faces)]
    mesh = device_mesh(all_faces.reshape(-1, 3), device)
    c.keep.append(mesh)
    depth_inside = most_depth(mesh, all_faces.min((0, 1)), all_faces.max((0, 1)), device)
    parts = [part for m in meshes for part in m.split(only_watertight=False)]
    # the highest one: it is usually farthest from the support of the object, and nothing is asked about it then
    points = np.array([part.vertices[part.vertices[:, 2].argmax()] for part in parts])
    flat = [p.mesh.triangles for _, p in solid if p.mesh is not None and p.type not in ROUND]
    triangles = np.concatenate([*flat, np.zeros((0, 3, 3))])
    triangles = triangles[~flat_faces(triangles)]  # their edges are those of their neighbours
    round_pieces = [(i, p.bounds()) for i, p in solid if p.type in ROUND]
    lower = np.array([*triangles.min(axis=1), *(low for _, (low, _) in round_pieces)])
    upper = np.array([*triangles.max(axis=1), *(high for _, (_, high) in round_pieces)])
    leaves = [*range(c.leaves, c.leaves + len(triangles)), *(PIECE_LEAF + i for i, _ in round_pieces)]
    _add_tree(c, body, lower, upper, np.array(leaves), mesh=mesh.id, depth_inside=depth_inside, points=points)
    c.faces.append(triangles)
    c.leaves += len(triangles)


def _add_tree(
    c: Colliders,
    body: int,
    lower: np.ndarray,
    upper: np.ndarray,
    leaves: np.ndarray,
    *,
    plane: int = -1,
    mesh: int = 0,
    depth_inside: float = 0.0,
    points: np.ndarray = _NO_POINTS,
) -> None:
    """Append a collider whose leaves have these numbers."""
    tree = build_tree(lower - _GROW, upper + _GROW)
    c.body.append(body)
    c.root.append(c.nodes)
    c.plane.append(plane)
    c.mesh.append(mesh)
    c.depth_inside.append(depth_inside)
    c.points.append(points)
    c.center.append(tree.center)
    c.half.append(tree.half)
    number = leaves[np.where(tree.child < 0, ~tree.child, 0)]
    c.child.append(np.where(tree.child < 0, ~number, tree.child + c.nodes))
    c.depth.append(tree.depth)
    c.nodes += len(tree.child)


def collider_arrays(c: Colliders) -> dict[str, np.ndarray]:
    """Return the fields of `device.Program` that hold colliders, boxes and faces."""
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
