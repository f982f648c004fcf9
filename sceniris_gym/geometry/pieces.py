"""Pieces: a piece is a geom of the model, in the shape that collides or that is rendered.

`geometry: physics` uses the geoms that MuJoCo collides, with convex hulls of meshes. `geometry: visual` uses the
visible geoms (groups 0 to 2): meshes and boxes as closed triangle meshes, and round primitives. In both cases, a piece
also has a convex form, which determines the bounds of the piece and its outline from above.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from sceniris_gym.errors import MeshError
from sceniris_gym.geometry.contacts import ContactRules
from sceniris_gym.geometry.rotations import matrix, pose_matrix

if TYPE_CHECKING:
    import trimesh  # takes most of a second to import, and a cached scene does not need it


class PieceType(IntEnum):
    """Kinds of convex forms, centred at the piece's frame. No piece is a SEGMENT: distance tests use it for lines."""

    SPHERE = 0
    CAPSULE = 1
    BOX = 2
    CYLINDER = 3
    ELLIPSOID = 4
    HULL = 5
    PLANE = 6
    SEGMENT = 7


ROUND = (PieceType.SPHERE, PieceType.CAPSULE, PieceType.CYLINDER, PieceType.ELLIPSOID)
"""Kinds of pieces that triangles cannot describe exactly."""

_TYPES = {
    mujoco.mjtGeom.mjGEOM_PLANE: PieceType.PLANE,
    mujoco.mjtGeom.mjGEOM_SPHERE: PieceType.SPHERE,
    mujoco.mjtGeom.mjGEOM_CAPSULE: PieceType.CAPSULE,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: PieceType.ELLIPSOID,
    mujoco.mjtGeom.mjGEOM_CYLINDER: PieceType.CYLINDER,
    mujoco.mjtGeom.mjGEOM_BOX: PieceType.BOX,
    mujoco.mjtGeom.mjGEOM_MESH: PieceType.HULL,
}
ROUGH = (int(mujoco.mjtGeom.mjGEOM_HFIELD), int(mujoco.mjtGeom.mjGEOM_SDF))
"""Types of geoms whose pieces are boxes around them."""
_HALF_EXTENTS: dict[PieceType, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    PieceType.SPHERE: lambda axes, size: np.full(len(axes), size[0]),
    PieceType.CAPSULE: lambda axes, size: size[0] + size[1] * np.abs(axes[:, 2]),
    PieceType.CYLINDER: lambda axes, size: size[0] * np.hypot(axes[:, 0], axes[:, 1]) + size[1] * np.abs(axes[:, 2]),
    PieceType.ELLIPSOID: lambda axes, size: np.linalg.norm(axes * size, axis=1),
    PieceType.BOX: lambda axes, size: np.abs(axes) @ size,
    PieceType.PLANE: lambda axes, size: np.abs(axes) @ size,
}
"""Half of a primitive's extent [m] along unit axes (n, 3) in its frame, from MuJoCo's sizes (3,)."""
_VISIBLE_GROUPS = range(3)
# A triangle is flat if its height is less than this fraction of its longest edge. The fraction allows for float32.
_FLAT = 4.0e-7
# Primitives smaller than the first number [m] are enlarged by the second number for tessellation. It is a power of two,
# so that scaling back is exact.
_SMALL, _ENLARGED = 0.01, 1024.0


@dataclass(frozen=True)
class Piece:
    """One geom of the model as an obstacle. The convex form is a primitive, a plane, or the convex hull of a mesh.

    Attributes:
        geom: Id of the geom in the MjModel.
        body: Id of the geom's body.
        type: Kind of the convex form.
        pos: Centre of the convex form [m] in the body's frame, shape (3,).
        quat: Orientation of the convex form in the body's frame, wxyz.
        size: MuJoCo's sizes [m] of a primitive, shape (3,).
        vertices: Vertices [m] of a hull in the piece's frame, shape (n, 3), empty for primitives.
        mesh: Closed surface of the geom in the body's frame, None for a plane. Round primitives are tessellated. With
            `geometry: physics`, collision tests do not use the mesh. It gives the flat faces and outline of the geom,
            and shows whether the geom is above a point.
        contact_class: Class of the geom in `ContactRules`.
    """

    geom: int
    body: int
    type: PieceType
    pos: np.ndarray
    quat: np.ndarray
    size: np.ndarray
    vertices: np.ndarray
    mesh: trimesh.Trimesh | None
    contact_class: int

    @functools.cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The lower and the upper corner [m] of the bounding box of the convex form, in the body's frame.

        The corners are cached, because a scene of 1,000 objects reads them two million times.
        """
        return self.extents(np.eye(3))

    @property
    def radius(self) -> float:
        """Radius [m] of a sphere that encloses the convex form, around the piece's origin. 1e30 for a plane."""
        if self.type == PieceType.HULL:
            return float(np.linalg.norm(self.vertices, axis=1).max())
        sx, sy, _ = self.size
        return {
            PieceType.PLANE: 1.0e30,
            PieceType.SPHERE: sx,
            PieceType.CAPSULE: sx + sy,
            PieceType.CYLINDER: math.hypot(sx, sy),
            PieceType.ELLIPSOID: float(max(self.size)),
        }.get(self.type, float(np.linalg.norm(self.size)))

    def extents(self, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and the greatest coordinate [m] of the convex form along each axis, shape (n,) each.

        The rows of `axes`, shape (n, 3), are the axes in the body's frame.
        """
        local = axes @ matrix(self.quat)
        middle = axes @ self.pos
        if self.type == PieceType.HULL:
            heights = self.vertices @ local.T
            return middle + heights.min(axis=0), middle + heights.max(axis=0)
        half = _HALF_EXTENTS[self.type](local, self.size)
        return middle - half, middle + half


def extract_pieces(
    mjm: mujoco.MjModel, geometry: str, bodies: set[int] | None = None, where: Mapping[int, str] | None = None
) -> list[Piece]:
    """Return the pieces of a model, in the order of the model's geoms.

    Height fields and signed distance fields are boxes around them. Flexes have no pieces.

    Args:
        mjm: The model.
        geometry: "physics" or "visual".
        bodies: Bodies whose pieces are returned. If None, the pieces of all bodies are returned.
        where: Id of a body -> beginning of error messages about this body.

    Raises:
        MeshError: A mesh is open, flat, or has no faces.
    """
    pieces = []
    rules = ContactRules(mjm, geometry)
    for geom in range(mjm.ngeom):
        if bodies is not None and int(mjm.geom_bodyid[geom]) not in bodies:
            continue
        visible = mjm.geom_group[geom] in _VISIBLE_GROUPS and mjm.geom_rgba[geom][3] > 0.0
        plane = mjm.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
        if rules.collides(geom) if geometry == "physics" or plane else visible:
            named = (where or {}).get(int(mjm.geom_bodyid[geom]))
            pieces.append(_piece(mjm, geom, geometry, int(rules.classes[geom]), f"{named}: " if named else ""))
    return pieces


def obstacle_flexes(mjm: mujoco.MjModel, geometry: str) -> list[tuple[int, set[int]]]:
    """Return the id of each flex that collides or, with visual geometry, is visible, and the bodies that move it."""
    found = []
    for flex in range(mjm.nflex):
        vert, node = mjm.flex_vertadr[flex], mjm.flex_nodeadr[flex]
        nodes = mjm.flex_nodebodyid[node : node + mjm.flex_nodenum[flex]] if mjm.flex_nodenum[flex] else []
        verts = mjm.flex_vertbodyid[vert : vert + mjm.flex_vertnum[flex]]
        collides = mjm.flex_contype[flex] | mjm.flex_conaffinity[flex]
        visible = mjm.flex_group[flex] in _VISIBLE_GROUPS and mjm.flex_rgba[flex][3] > 0.0
        if collides or (geometry == "visual" and visible):
            found.append((flex, {int(body) for body in (*verts, *nodes) if body >= 0}))
    return found


def _piece(mjm: mujoco.MjModel, geom: int, geometry: str, contact_class: int, prefix: str = "") -> Piece:
    """Return a geom as a piece.

    Args:
        mjm: The model.
        geom: Id of the geom.
        geometry: The scene's `geometry`, "physics" or "visual".
        contact_class: The geom's class in `ContactRules`.
        prefix: Beginning of error messages.
    """
    kind = mujoco.mjtGeom(int(mjm.geom_type[geom]))
    pos, quat, size = mjm.geom_pos[geom].copy(), mjm.geom_quat[geom].copy(), mjm.geom_size[geom].copy()
    if int(kind) in ROUGH:
        kind, center, size = mujoco.mjtGeom.mjGEOM_BOX, mjm.geom_aabb[geom, :3], mjm.geom_aabb[geom, 3:].copy()
        pos += matrix(quat) @ center
    vertices = np.zeros((0, 3))
    mesh = None
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        data, what = int(mjm.geom_dataid[geom]), f"{prefix}mesh of geom '{geom_name(mjm, geom)}'"
        mesh = _surface(mjm, data, what) if geometry == "visual" else None
        vertices = hull_vertices(mjm, data, what)
        middle = vertices.mean(axis=0)
        pos = pos + matrix(quat) @ middle
        vertices = vertices - middle
        if mesh is None:
            mesh = _known_hull((vertices + middle).tobytes()).copy(include_cache=True)
        mesh.apply_transform(pose_matrix(mjm.geom_pos[geom], quat))
    elif kind != mujoco.mjtGeom.mjGEOM_PLANE:
        mesh = _primitive(kind, size)
        mesh.apply_transform(pose_matrix(pos, quat))
    return Piece(
        geom=geom,
        body=int(mjm.geom_bodyid[geom]),
        type=_TYPES[kind],
        pos=pos,
        quat=quat,
        size=size,
        vertices=vertices,
        mesh=mesh,
        contact_class=contact_class,
    )


def convex_hull(points: np.ndarray) -> trimesh.Trimesh:
    """Return the convex hull of points, shape (n, 3).

    Raises:
        ValueError: The points are in one plane.
    """
    import trimesh

    return trimesh.convex.convex_hull(points)


@functools.lru_cache(maxsize=512)
def _known_hull(points: bytes) -> trimesh.Trimesh:
    """Return the convex hull of float64 points, given as bytes.

    The hull is cached: a caller that changes it must copy it.
    """
    return convex_hull(np.frombuffer(points).reshape(-1, 3))


def mesh_vertices(mjm: mujoco.MjModel, mesh: int) -> np.ndarray:
    """Return the vertices [m] of a mesh of the model, in the frame of a geom with this mesh, shape (n, 3)."""
    first = mjm.mesh_vertadr[mesh]
    return mjm.mesh_vert[first : first + mjm.mesh_vertnum[mesh]].astype(float)


def mesh_surface(mjm: mujoco.MjModel, mesh: int) -> trimesh.Trimesh:
    """Return the triangles of a mesh as MuJoCo stores them, in the frame of a geom with this mesh."""
    import trimesh

    first = mjm.mesh_faceadr[mesh]
    faces = mjm.mesh_face[first : first + mjm.mesh_facenum[mesh]]
    return trimesh.Trimesh(mesh_vertices(mjm, mesh), faces, process=False)


def hull_vertices(mjm: mujoco.MjModel, mesh: int, what: str) -> np.ndarray:
    """Return the vertices [m] of a mesh's convex hull, in the frame of a geom with this mesh, shape (n, 3).

    If a collision geom uses the mesh, MuJoCo stores the ids of the hull's vertices in `mesh_graph`. This array
    holds numvert, numface, numvert edge addresses, numvert ids, ... For other meshes, the hull is computed. Error
    messages begin with `what`.
    """
    vertices = mesh_vertices(mjm, mesh)
    graph = mjm.mesh_graphadr[mesh]
    if graph >= 0:
        count = mjm.mesh_graph[graph]
        return vertices[mjm.mesh_graph[graph + 2 + count : graph + 2 + 2 * count]]
    try:
        return np.asarray(convex_hull(vertices).vertices)
    except ValueError as error:  # qhull rejects flat input
        raise MeshError(f"{what} has no volume. Its vertices should not all lie in one plane.", "flat") from error


def flat_faces(triangles: np.ndarray) -> np.ndarray:
    """Return a mask (n,) of the triangles (n, 3, 3) whose area is zero up to rounding."""
    edges = np.roll(triangles, -1, axis=1) - triangles
    longest = np.einsum("ijk,ijk->ij", edges, edges).max(axis=1)
    return np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) <= _FLAT * longest


def _surface(mjm: mujoco.MjModel, mesh: int, what: str) -> trimesh.Trimesh:
    """Return the triangles of a mesh, in the geom's frame. Raise MeshError if they do not form a closed surface."""
    if mjm.mesh_facenum[mesh] == 0:
        raise MeshError(f"{what} has no faces. Give it a closed surface, or set `geometry: physics`.", "empty")
    surface = mesh_surface(mjm, mesh)
    surface.merge_vertices(merge_tex=True, merge_norm=True)
    if not surface.is_watertight:  # only now remove flat faces, because some surfaces are not closed without them
        flat = flat_faces(surface.triangles)
        surface.update_faces(~flat)
        surface.metadata["left_out"] = int(flat.sum())
    if not surface.is_watertight:
        raise MeshError(
            f"{what} is open, so it has no inside. Close it, or set `geometry: physics`, which uses convex hulls.",
            "open",
        )
    if surface.volume < 0.0:
        surface.invert()
    return surface


def _primitive(kind: mujoco.mjtGeom, size: np.ndarray) -> trimesh.Trimesh:
    import trimesh

    if size.max() < _SMALL:  # trimesh drops faces of less than a few hundredths of a millimetre
        mesh = _primitive(kind, size * _ENLARGED)
        mesh.apply_scale(1.0 / _ENLARGED)
        return mesh
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return trimesh.creation.box(2.0 * size)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(size[0], 2.0 * size[1], sections=64)
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        capsule = trimesh.creation.capsule(2.0 * size[1], size[0], count=[32, 32])
        capsule.apply_translation(-capsule.bounds.mean(axis=0))
        return capsule
    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.apply_scale(size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else np.full(3, size[0]))
    return ball


def geom_name(mjm: mujoco.MjModel, geom: int, written: Callable[[str], str] = str) -> str:
    """Return the name of a geom for messages, or its number and body if it has no name.

    `written` translates names of the model.
    """
    body = mjm.body(int(mjm.geom_bodyid[geom])).name
    return written(mjm.geom(geom).name) or f"{geom} of body {written(body)}"
