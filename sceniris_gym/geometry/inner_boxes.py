"""Inner boxes: boxes inside of things. Where two of them overlap, the things collide whatever their surfaces are."""

from __future__ import annotations

import math

import numpy as np

from sceniris_gym.geometry.pieces import Piece, PieceType
from sceniris_gym.geometry.rotations import matrix

# An inner box is smaller than its piece by this much [m] on every side, so that rounding cannot push it out.
_INSIDE = 2.0e-5
# Thinner boxes [m] prove little.
_LEAST_HALF = 3.0e-4
# Each side of a box moves out once for each share, by that share of the room that it has.
_SHARES = (0.3, 0.3, 0.5, 0.5, 1.0)

Box = tuple[np.ndarray, np.ndarray]
"""Centre and half extents [m], shape (3,) each; half extents of 0 mean that there is no inner box."""


NO_INNER_BOX = np.zeros(3), np.zeros(3)
"""The box of a piece that has no room for one."""


def inner_box(piece: Piece) -> Box:
    """Return a large box inside of a piece's convex form, in the piece's frame."""
    sx, sy, _ = piece.size
    corner = 1.0 / math.sqrt(3.0)
    if piece.type == PieceType.HULL:
        return _hull_inner_box(piece)
    half = {
        PieceType.BOX: piece.size,
        PieceType.SPHERE: np.full(3, corner * sx),
        PieceType.ELLIPSOID: corner * piece.size,
        PieceType.CYLINDER: np.array([math.sqrt(0.5) * sx, math.sqrt(0.5) * sx, sy]),
        PieceType.CAPSULE: np.array([corner * sx, corner * sx, sy + corner * sx]),
    }.get(piece.type)
    return NO_INNER_BOX if half is None else _box(-half, half)


def _hull_inner_box(piece: Piece) -> Box:
    """Return the box of a hull: it begins in the middle with the bounds' proportions; its sides move out in turn."""
    if piece.mesh is None:
        return NO_INNER_BOX
    triangles = (piece.mesh.triangles - piece.pos) @ matrix(piece.quat)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    solid = lengths > 0.0
    normals = normals[solid] / lengths[solid, None]
    limits = np.einsum("nij,nj->ni", triangles[solid], normals).max(axis=1)
    lower, upper = piece.vertices.min(axis=0), piece.vertices.max(axis=0)
    # the bounds too: faces with almost no area may be missing from the surface
    normals, limits = np.vstack([normals, np.eye(3), -np.eye(3)]), np.concatenate([limits, upper, -lower])
    middles = [0.5 * (lower + upper), np.zeros(3)]
    sizes = [((limits - normals @ m) / (np.abs(normals) @ (upper - lower))).min() for m in middles]
    best = int(np.argmax(sizes))
    if sizes[best] <= 0.0:
        return NO_INNER_BOX
    room = sizes[best] * (upper - lower)
    low, high = middles[best] - room, middles[best] + room
    for share in _SHARES:
        for axis in range(3):
            for side, sign in ((low, -1.0), (high, 1.0)):
                along = sign * normals[:, axis]
                facing = along > 1e-9
                reach = np.maximum(normals[facing] * low, normals[facing] * high).sum(axis=1)
                side[axis] += sign * share * max(((limits[facing] - reach) / along[facing]).min(), 0.0)
    return _box(low, high)


def _box(low: np.ndarray, high: np.ndarray) -> Box:
    half = 0.5 * (high - low) - _INSIDE
    return (0.5 * (low + high), half) if half.min() >= _LEAST_HALF else NO_INNER_BOX
