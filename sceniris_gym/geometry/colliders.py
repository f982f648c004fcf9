"""Groups the pieces of each body into colliders with a tree of bounding boxes. Also finds a box inside each piece."""

import math
from typing import NamedTuple

import numpy as np
import warp as wp

from sceniris_gym.geometry.pieces import ROUND, Piece, PieceType, flat_faces
from sceniris_gym.geometry.ragged import addressed, columns
from sceniris_gym.geometry.rotations import matrix

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

# Boxes grow by this length [m], so that rounding to float32 cannot lose a leaf.
_GROW = 1.0e-6
_NO_POINTS, _NO_FACES = np.zeros((0, 3)), np.zeros((0, 3, 3))
PIECE_LEAF = 1 << 30
"""If the leaves of a tree are faces, a leaf that is a piece has this value added to its number."""

# Cells along the longest edge of a mesh's bounds in `most_depth`. Its result is too large by half a cell's diagonal.
_CELLS = 24
# An inner box is smaller than its piece by this length [m] on every side, so that rounding cannot push it out.
_INSIDE = 2.0e-5
# A box whose least half extent is below this [m] is dropped, because it proves little.
_LEAST_HALF = 3.0e-4
# An inner box grows in rounds. In each round, every side moves out by this fraction of the free space in front of it.
_SHARES = (0.3, 0.3, 0.5, 0.5, 1.0)

Box = tuple[np.ndarray, np.ndarray]
"""Centre and half extents [m], shape (3,) each. Half extents of 0 mark a missing inner box."""

NO_INNER_BOX = np.zeros(3), np.zeros(3)
"""Marks a piece that has no inner box."""


class Collider(NamedTuple):
    """One plane, or all other pieces of one body and one contact class, with a tree of bounding boxes over them.

    Attributes:
        body: Id of the body.
        contact_class: Contact class of the pieces in `ContactRules`.
        plane: If the collider is a plane, the number of its piece, else -1.
        root: Number of the tree's root. Nodes are numbered over all colliders.
        center, half: Centres and half extents [m] of the boxes of the tree's nodes, shape (n, 3).
        child: For each node, the number of its left child, shape (n,). The right child has the next number. A leaf
            stores ~number of its piece or face instead.
        mesh: Closed surface of the pieces on the device. None if the pieces collide as convex forms.
        depth_inside: Upper bound [m] of the distance from any point inside the mesh to the mesh's surface.
        points: One point on each closed component of the mesh [m], shape (m, 3).
        faces: The triangles that are leaves of the tree [m], shape (k, 3, 3).
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
    points: np.ndarray = _NO_POINTS
    faces: np.ndarray = _NO_FACES


def collect_colliders(pieces: list[Piece], visual: bool, device: str) -> list[Collider]:
    """Return a collider for the solid pieces of each body and contact class, and one for each plane.

    The leaves of a tree are pieces, or if `visual`, faces and round pieces, which faces cannot describe exactly. The
    tree of a plane is one leaf, and collision tests do not use its box.
    `Collider.mesh` also has faces of round pieces, but only to test whether a point is inside the body or below it.
    """
    found: list[Collider] = []
    nodes = faces = 0
    by_class: dict[tuple[int, int, int], list[int]] = {}
    for i, p in enumerate(pieces):
        plane = i if p.type == PieceType.PLANE else -1
        by_class.setdefault((p.body, p.contact_class, plane), []).append(i)
    for key, own in by_class.items():
        if visual and key[-1] < 0:
            made = _of_faces(key, nodes, faces, {i: pieces[i] for i in own}, device)
        else:
            lower, upper = np.stack([pieces[i].bounds for i in own], axis=1)
            made = _collider(key, nodes, lower, upper, np.array(own))
        found.append(made)
        nodes, faces = nodes + len(made.child), faces + len(made.faces)
    return found


def device_mesh(corners: np.ndarray, device: str) -> wp.Mesh:
    """Return a mesh on a device, with winding numbers. `corners` (3n, 3) [m] has three corners of each triangle."""
    return wp.Mesh(
        points=wp.array(corners, dtype=wp.vec3, device=device),
        indices=wp.array(np.arange(len(corners)), dtype=int, device=device),
        support_winding_number=True,
    )


def _of_faces(key: tuple[int, int, int], nodes: int, faces: int, solid: dict[int, Piece], device: str) -> Collider:
    """Return the collider of a body's visible pieces, with faces as leaves.

    Args:
        key: The first fields of `Collider`: body, contact class and plane.
        nodes: Number of tree nodes in all previous colliders.
        faces: Number of faces in all previous colliders.
        solid: The pieces, by their numbers among all pieces.
        device: Warp's name of the device that holds the mesh.
    """
    meshes = [p.mesh for p in solid.values() if p.mesh is not None]
    all_faces = np.concatenate([m.triangles for m in meshes])
    all_faces = all_faces[~flat_faces(all_faces)]
    mesh = device_mesh(all_faces.reshape(-1, 3), device)
    parts = [part for m in meshes for part in m.split(only_watertight=False)]
    flat = [p.mesh.triangles for p in solid.values() if p.mesh is not None and p.type not in ROUND]
    triangles = np.concatenate([*flat, _NO_FACES])
    triangles = triangles[~flat_faces(triangles)]  # the neighbours of a flat face cover its edges
    round_pieces = {i: p.bounds for i, p in solid.items() if p.type in ROUND}
    lower = np.array([*triangles.min(axis=1), *(low for low, _ in round_pieces.values())])
    upper = np.array([*triangles.max(axis=1), *(high for _, high in round_pieces.values())])
    leaves = [*range(faces, faces + len(triangles)), *(PIECE_LEAF + i for i in round_pieces)]
    return _collider(key, nodes, lower, upper, np.array(leaves))._replace(
        mesh=mesh,
        depth_inside=most_depth(mesh, all_faces.min((0, 1)), all_faces.max((0, 1)), device),
        # the highest vertex is usually outside the bounds of other meshes, so the test of containment ends early
        points=np.array([part.vertices[part.vertices[:, 2].argmax()] for part in parts]),
        faces=triangles,
    )


def _collider(
    key: tuple[int, int, int], nodes: int, lower: np.ndarray, upper: np.ndarray, leaves: np.ndarray
) -> Collider:
    """Build the tree over the leaves of a collider, and return the collider.

    Args:
        key: The first fields of `Collider`: body, contact class and plane.
        nodes: Number of tree nodes in all previous colliders.
        lower: Lower corners of the leaves' boxes [m], shape (n, 3).
        upper: Upper corners of the leaves' boxes [m], shape (n, 3).
        leaves: Numbers of the leaves, which are pieces or faces, shape (n,).
    """
    center, half, child = build_tree(lower - _GROW, upper + _GROW)
    number = leaves[np.where(child < 0, ~child, 0)]
    return Collider(*key, nodes, center, half, np.where(child < 0, ~number, child + nodes))


def collider_arrays(colliders: list[Collider]) -> dict[str, np.ndarray]:
    """Return the fields of `device.Program` for colliders, tree nodes and faces."""
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


def build_tree(lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Build a tree over the boxes of leaves. Each node is split at the median along its longest axis.

    Args:
        lower: Lower corners of the boxes [m], shape (n, 3).
        upper: Upper corners of the boxes [m], shape (n, 3).

    Returns:
        Centres and half extents [m] of the nodes' boxes, shape (m, 3) each, and the number of each node's left child,
        or ~leaf, shape (m,). The root is first. A right child directly follows its left sibling.
    """
    middle = 0.5 * (lower + upper)
    order = np.arange(len(lower))
    start, stop = np.array([0]), np.array([len(lower)])
    lows, highs, children = [], [], []
    nodes = 1  # ids given out so far
    while len(start):
        gather = np.concatenate([order[a:b] for a, b in zip(start, stop, strict=True)])
        size = stop - start
        first = np.concatenate([[0], np.cumsum(size)[:-1]])
        lows.append(np.minimum.reduceat(lower[gather], first))
        highs.append(np.maximum.reduceat(upper[gather], first))
        leaf = size == 1
        inner = np.flatnonzero(~leaf)
        child = np.where(leaf, ~order[start], 0)
        child[inner] = nodes + 2 * np.arange(len(inner))
        children.append(child)
        nodes += 2 * len(inner)

        spread = np.maximum.reduceat(middle[gather], first) - np.minimum.reduceat(middle[gather], first)
        owner = np.repeat(np.arange(len(size)), size)
        along = middle[gather, spread.argmax(axis=1)[owner]]
        gather = gather[np.lexsort((gather, along, owner))]
        for i in inner:
            order[start[i] : stop[i]] = gather[first[i] : first[i] + size[i]]
        half = start[inner] + size[inner] // 2
        start, stop = np.stack([start[inner], half], axis=1).ravel(), np.stack([half, stop[inner]], axis=1).ravel()
    low, high = np.concatenate(lows), np.concatenate(highs)
    return 0.5 * (low + high), 0.5 * (high - low), np.concatenate(children)


@wp.kernel
def _measure_depth(
    mesh: wp.uint64,
    lower: wp.vec3,
    cell: float,
    most: float,
    # Out:
    depth: wp.array[float],
):
    i, j, k = wp.tid()
    at = lower + cell * wp.vec3(float(i) + 0.5, float(j) + 0.5, float(k) + 0.5)
    query = wp.mesh_query_point_sign_winding_number(mesh, at, most)
    if query.result:
        if query.sign < 0.0:
            nearest = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
            wp.atomic_max(depth, 0, wp.length(nearest - at))


def most_depth(mesh: wp.Mesh, lower: np.ndarray, upper: np.ndarray, device: str) -> float:
    """Return an upper bound [m] of the distance from any point inside a closed mesh to the mesh's surface.

    Args:
        mesh: The mesh, with winding numbers.
        lower: Lower corner of the mesh's bounds [m], shape (3,).
        upper: Upper corner of the mesh's bounds [m], shape (3,).
        device: Warp's name of the device that holds the mesh.
    """
    cell = max(float((upper - lower).max()) / _CELLS, 1e-6)
    dim = np.maximum(np.ceil((upper - lower) / cell), 1).astype(int)
    depth = wp.zeros(1, dtype=float, device=device)
    most = float(np.linalg.norm(upper - lower))
    wp.launch(
        _measure_depth, dim=dim.tolist(), inputs=[mesh.id, wp.vec3(*lower), cell, most], outputs=[depth], device=device
    )
    # The depth is measured at the centres of cells. A point inside the mesh is at most half a diagonal from the centre
    # of its cell. If this centre is outside the mesh, the point is also at most half a diagonal from the surface.
    return float(depth.numpy()[0]) + 0.5 * np.sqrt(3.0) * cell


def inner_box(piece: Piece) -> Box:
    """Return a large box inside a piece's convex form, in the piece's frame."""
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
    """Return the inner box of a hull: start with a scaled copy of its bounding box, and move each side outwards."""
    if piece.mesh is None:
        return NO_INNER_BOX
    triangles = (piece.mesh.triangles - piece.pos) @ matrix(piece.quat)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    solid = lengths > 0.0
    normals = normals[solid] / lengths[solid, None]
    limits = np.einsum("nij,nj->ni", triangles[solid], normals).max(axis=1)
    lower, upper = piece.vertices.min(axis=0), piece.vertices.max(axis=0)
    # the bounds also limit the box, because faces with almost no area may be missing from the surface
    normals, limits = np.vstack([normals, np.eye(3), -np.eye(3)]), np.concatenate([limits, upper, -lower])
    middles = [0.5 * (lower + upper), np.zeros(3)]
    sizes = [((limits - normals @ m) / (np.abs(normals) @ (upper - lower))).min() for m in middles]
    best = int(np.argmax(sizes))
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
