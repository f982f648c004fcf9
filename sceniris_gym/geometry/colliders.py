"""Colliders: the pieces of each body under one tree of boxes, as numpy arrays and (for meshes) on the device."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import warp as wp

from sceniris_gym.geometry.box_tree import build_tree
from sceniris_gym.geometry.depth import most_depth
from sceniris_gym.geometry.pieces import ROUND, Piece, PieceType, flat_faces
from sceniris_gym.geometry.ragged import addressed, columns

# Boxes are grown by this much [m] so that rounding to float32 cannot lose a leaf.
_GROW = 1.0e-6
_NO_POINTS, _NO_FACES = np.zeros((0, 3)), np.zeros((0, 3, 3))
PIECE_LEAF = 1 << 30
"""Added to the number of a piece that is a leaf where other leaves are faces."""


@dataclass(frozen=True)
class Collider:
    """The solid pieces of one body below one tree of boxes, or one plane.

    Attributes:
        body: Id of the body.
        contact_class: Its class in `ContactRules`.
        plane: Number of the piece that is a plane, -1 for all others.
        root: Number of the root of its tree; nodes are numbered over all colliders.
        center, half: Boxes of the nodes of its tree [m], shape (n, 3).
        child: Number of the left child of each node, which the right one follows, or ~leaf, shape (n,).
        mesh: Its closed surface on the device; None for pieces that collide as convex forms.
        depth_inside: The distance from the surface [m] that no point inside the mesh exceeds.
        points: A point of each closed component of the mesh [m], shape (m, 3).
        faces: The triangles that are leaves [m], shape (k, 3, 3).
    """

    body: int
    contact_class: int
    plane: int
    root: int
    center: np.ndarray
    half: np.ndarray
    child: np.ndarray
    mesh: wp.Mesh | None = None
    depth_inside: float = 0.0
    points: np.ndarray = field(default_factory=_NO_POINTS.copy)
    faces: np.ndarray = field(default_factory=_NO_FACES.copy)


def collect_colliders(pieces: list[Piece], visual: bool, device: str) -> list[Collider]:
    """Return a collider for each body's solid pieces, and one for each plane; leaves are pieces, or faces if `visual`.

    Round pieces are leaves of their own in either case, as no faces describe them exactly. Their faces serve for
    containment and covers only, so the mesh of a collider has them.
    """
    found: list[Collider] = []
    nodes = faces = 0
    by_class: dict[tuple[int, int, int], list[int]] = {}
    for i, p in enumerate(pieces):
        plane = i if p.type == PieceType.PLANE else -1
        by_class.setdefault((p.body, p.contact_class, plane), []).append(i)
    for key, own in by_class.items():
        if key[-1] >= 0:
            made = _collider(key, nodes, np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1, int))
        elif visual:
            made = _of_faces(key, nodes, faces, {i: pieces[i] for i in own}, device)
        else:
            lower, upper = np.stack([pieces[i].bounds() for i in own], axis=1)
            made = _collider(key, nodes, lower, upper, np.array(own))
        found.append(made)
        nodes, faces = nodes + len(made.child), faces + len(made.faces)
    return found


def device_mesh(corners: np.ndarray, device: str) -> wp.Mesh:
    """Return a mesh on a device, with winding numbers, from the corners of its triangles in a row, shape (3n, 3)."""
    return wp.Mesh(
        points=wp.array(corners, dtype=wp.vec3, device=device),
        indices=wp.array(np.arange(len(corners)), dtype=int, device=device),
        support_winding_number=True,
    )


def _of_faces(key: tuple[int, int, int], nodes: int, faces: int, solid: dict[int, Piece], device: str) -> Collider:
    """Return the collider of a body's visible pieces, by their numbers, after so many nodes and faces of others."""
    meshes = [p.mesh for p in solid.values() if p.mesh is not None]
    all_faces = np.concatenate([m.triangles for m in meshes])
    all_faces = all_faces[~flat_faces(all_faces)]
    mesh = device_mesh(all_faces.reshape(-1, 3), device)
    parts = [part for m in meshes for part in m.split(only_watertight=False)]
    flat = [p.mesh.triangles for p in solid.values() if p.mesh is not None and p.type not in ROUND]
    triangles = np.concatenate([*flat, _NO_FACES])
    triangles = triangles[~flat_faces(triangles)]  # their edges are those of their neighbours
    round_pieces = {i: p.bounds() for i, p in solid.items() if p.type in ROUND}
    lower = np.array([*triangles.min(axis=1), *(low for low, _ in round_pieces.values())])
    upper = np.array([*triangles.max(axis=1), *(high for _, high in round_pieces.values())])
    leaves = [*range(faces, faces + len(triangles)), *(PIECE_LEAF + i for i in round_pieces)]
    return replace(
        _collider(key, nodes, lower, upper, np.array(leaves)),
        mesh=mesh,
        depth_inside=most_depth(mesh, all_faces.min((0, 1)), all_faces.max((0, 1)), device),
        # the highest vertex: usually it is outside of the bounds of other meshes, where the test of containment ends
        points=np.array([part.vertices[part.vertices[:, 2].argmax()] for part in parts]),
        faces=triangles,
    )


def _collider(
    key: tuple[int, int, int], nodes: int, lower: np.ndarray, upper: np.ndarray, leaves: np.ndarray
) -> Collider:
    """Return the collider of a body, class and plane, whose leaves have these boxes [m], shape (n, 3), and numbers."""
    center, half, child = build_tree(lower - _GROW, upper + _GROW)
    number = leaves[np.where(child < 0, ~child, 0)]
    return Collider(*key, nodes, center, half, np.where(child < 0, ~number, child + nodes))


def collider_arrays(colliders: list[Collider]) -> dict[str, np.ndarray]:
    """Return the fields of `device.Program` that hold colliders, boxes and faces."""
    faces = np.concatenate([*(c.faces for c in colliders), _NO_FACES])
    points, addresses = addressed("collider_point", (c.points for c in colliders))
    return {
        **columns("collider", colliders, body=1, root=1, plane=1),
        "collider_mesh": np.array([0 if c.mesh is None else c.mesh.id for c in colliders], np.uint64),
        "collider_depth": np.array([c.depth_inside for c in colliders]),
        **addresses,
        "node_center": np.concatenate([*(c.center for c in colliders), _NO_POINTS]),
        "node_half": np.concatenate([*(c.half for c in colliders), _NO_POINTS]),
        "node_child": np.concatenate([*(c.child for c in colliders), np.zeros(0, int)]),
        "face_a": faces[:, 0],
        "face_b": faces[:, 1],
        "face_c": faces[:, 2],
        "point": np.reshape(points, (-1, 3)),
    }
