"""Solids of a MuJoCo model and their poses.

The audit shares no code with the generator. It takes solids and poses from a `mujoco.MjModel`, in double precision.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import mujoco
import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from sceniris_gym.scene.layout_table import LayoutTable

Rows = Mapping[str, np.ndarray]
"""Object name -> a value in each row, shape (nrow,)."""
_BOX_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
_VISIBLE_GROUPS = (0, 1, 2)


class Form(Enum):
    """The form in which a `Solid` describes its geom."""

    POLYHEDRON = "polyhedron"  # closed triangle surface: boxes, hulls of meshes, meshes
    ROUNDED = "rounded"  # all points within `radius` of a point or a segment: spheres, capsules
    CYLINDER = "cylinder"
    ELLIPSOID = "ellipsoid"
    HALFSPACE = "halfspace"  # everything below the plane z = 0 of the geom


_WITHOUT_VERTICES = {
    mujoco.mjtGeom.mjGEOM_CYLINDER: Form.CYLINDER,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: Form.ELLIPSOID,
    mujoco.mjtGeom.mjGEOM_PLANE: Form.HALFSPACE,
}


@dataclass(frozen=True)
class Solid:
    """The solid of one geom, in the geom's frame [m].

    Attributes:
        geom: Geom id.
        form: How the solid is described.
        vertices: Surface vertices of a polyhedron, or the point or segment inside a rounded solid, shape (nvert, 3).
        faces: Triangles of a polyhedron, counter-clockwise seen from outside, shape (nface, 3).
        radius: Radius of a rounded solid, 0 for other forms.
        size: MuJoCo's sizes of the geom, shape (3,).
        center: Centre of the local bounding box, shape (3,).
        half: Half extents of the local bounding box, shape (3,), infinite for a half-space.
    """

    geom: int
    form: Form
    vertices: np.ndarray
    faces: np.ndarray
    radius: float
    size: np.ndarray
    center: np.ndarray = field(init=False)
    half: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        center, half = np.zeros(3), np.full(3, np.inf)
        if self.form is not Form.HALFSPACE:
            low, high = self.lowest(np.eye(3)), -self.lowest(-np.eye(3))
            center, half = (low + high) / 2, (high - low) / 2
        object.__setattr__(self, "center", center)
        object.__setattr__(self, "half", half)

    def lowest(self, up: np.ndarray) -> np.ndarray:
        """Return the solid's least coordinate [m] along each unit vector of `up` (n, 3), geom's frame, shape (n,)."""
        if self.form is Form.CYLINDER:
            return -self.size[0] * np.linalg.norm(up[:, :2], axis=1) - self.size[1] * np.abs(up[:, 2])
        if self.form is Form.ELLIPSOID:
            return -np.linalg.norm(up * self.size, axis=1)
        return (up @ self.vertices.T).min(1) - self.radius


@dataclass(frozen=True)
class Poses:
    """Poses of geoms and bodies in each layout, world frame: positions (nrow, n, 3) [m], rotations (nrow, n, 3, 3)."""

    geom_xpos: np.ndarray
    geom_xmat: np.ndarray
    xpos: np.ndarray
    xmat: np.ndarray

    def take(self, rows: np.ndarray) -> "Poses":
        """Return the poses of some rows."""
        return Poses(self.geom_xpos[rows], self.geom_xmat[rows], self.xpos[rows], self.xmat[rows])


def poses_of(mjm: mujoco.MjModel, table: LayoutTable) -> Poses:
    """Return the poses of all geoms and bodies in each row of a table, from MuJoCo C's forward kinematics."""
    data = mujoco.MjData(mjm)
    n = len(table)
    geom_xpos, geom_xmat = np.empty((n, mjm.ngeom, 3)), np.empty((n, mjm.ngeom, 9))
    xpos, xmat = np.empty((n, mjm.nbody, 3)), np.empty((n, mjm.nbody, 9))
    for i in range(n):
        table.put(data, i)
        mujoco.mj_kinematics(mjm, data)
        geom_xpos[i], geom_xmat[i], xpos[i], xmat[i] = data.geom_xpos, data.geom_xmat, data.xpos, data.xmat
    return Poses(geom_xpos, geom_xmat.reshape(n, -1, 3, 3), xpos, xmat.reshape(n, -1, 3, 3))


def home_of(mjm: mujoco.MjModel, keyframe: str | None = None) -> mujoco.MjData:
    """Return the data at a keyframe, 'home' by default, with poses and the centres of mass of subtrees.

    If the model has no keyframe of this name, return the default state.
    """
    data = mujoco.MjData(mjm)
    home = mujoco.mj_name2id(mjm, mujoco.mjtObj.mjOBJ_KEY, keyframe or "home")
    if home >= 0:
        mujoco.mj_resetDataKeyframe(mjm, data, home)
    mujoco.mj_kinematics(mjm, data)
    mujoco.mj_comPos(mjm, data)
    return data


def subtree(mjm: mujoco.MjModel, root: int) -> set[int]:
    """Return a body and all bodies below it."""
    found = {root}
    for body in range(root + 1, mjm.nbody):  # parents come before their children
        if int(mjm.body_parentid[body]) in found:
            found.add(body)
    return found


def rotation(quat: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (..., 3, 3) of quaternions (wxyz) of any length."""
    rotations = Rotation.from_quat(quat.reshape(-1, 4)[:, [1, 2, 3, 0]])
    return rotations.as_matrix().reshape(*quat.shape[:-1], 3, 3)


def frame(pose: np.ndarray) -> np.ndarray:
    """Return a pose as a homogeneous matrix (4, 4). `pose` (7,) is a position [m] and a quaternion of any length."""
    return np.block([[rotation(pose[3:]), pose[:3, None]], [np.zeros((1, 3)), np.ones((1, 1))]])


def convex_hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and outward triangles of the convex hull of points (n, 3)."""
    hull = ConvexHull(points)
    used, faces = np.unique(hull.simplices, return_inverse=True)
    faces = faces.reshape(-1, 3)
    vertices = points[used]
    a, b, c = vertices[faces].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return vertices, faces


def _mesh(mjm: mujoco.MjModel, mesh: int, *, hull: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and triangles of a mesh, or, with `hull`, of the hull that MuJoCo uses for collisions.

    If the mesh sets `maxhullvert`, MuJoCo's hull has fewer vertices than the convex hull.
    """
    vertadr, faceadr = mjm.mesh_vertadr[mesh], mjm.mesh_faceadr[mesh]
    vertices = mjm.mesh_vert[vertadr : vertadr + mjm.mesh_vertnum[mesh]].astype(float)
    if not hull:
        return vertices, mjm.mesh_face[faceadr : faceadr + mjm.mesh_facenum[mesh]].astype(int)
    graphadr = mjm.mesh_graphadr[mesh]
    if graphadr >= 0:
        numvert = mjm.mesh_graph[graphadr]
        globalid = mjm.mesh_graph[graphadr + 2 + numvert : graphadr + 2 + 2 * numvert]
        vertices = vertices[globalid]
    return convex_hull(vertices)


def solid_of(mjm: mujoco.MjModel, geom: int, *, hull: bool) -> Solid:
    """Return the solid of a geom. A mesh becomes its convex hull if `hull` is true, else its rendered surface."""
    kind, size = mujoco.mjtGeom(mjm.geom_type[geom]), mjm.geom_size[geom].copy()
    none, no_faces = np.zeros((0, 3)), np.zeros((0, 3), int)
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return Solid(geom, Form.POLYHEDRON, *_mesh(mjm, mjm.geom_dataid[geom], hull=hull), 0.0, size)
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE):  # both ends of a sphere are its centre
        ends = np.array([[0, 0, -size[1]], [0, 0, size[1]]])
        return Solid(geom, Form.ROUNDED, ends, no_faces, float(size[0]), size)
    if kind in _WITHOUT_VERTICES:
        return Solid(geom, _WITHOUT_VERTICES[kind], none, no_faces, 0.0, size)
    # a box, or the box around a height field or signed distance field, which no placed object comes near
    box = mjm.geom_aabb[geom, :3] + _BOX_CORNERS * mjm.geom_aabb[geom, 3:]
    return Solid(geom, Form.POLYHEDRON, *convex_hull(box), 0.0, size)


def solids_of(mjm: mujoco.MjModel, geometry: str) -> list[Solid]:
    """Return the solids of a model: colliding geoms ("physics") or visible geoms ("visual")."""
    collides = (mjm.geom_contype != 0) | (mjm.geom_conaffinity != 0)
    if geometry == "physics":
        chosen = collides
    else:
        visible = np.isin(mjm.geom_group, _VISIBLE_GROUPS) & (mjm.geom_rgba[:, 3] > 0)
        # A colliding plane is ground, even if invisible. A visible plane without collisions is only a backdrop.
        chosen = np.where(mjm.geom_type == mujoco.mjtGeom.mjGEOM_PLANE, collides, visible)
    return [solid_of(mjm, int(g), hull=geometry == "physics") for g in np.flatnonzero(chosen)]
