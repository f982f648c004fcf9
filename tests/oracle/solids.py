"""The geoms of a posed MuJoCo model as FCL sees them: their distances, with containment by winding numbers."""

from functools import cache

import fcl
import mujoco
import numpy as np
from scipy.spatial import ConvexHull

_MESHED = (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_MESH)


class Solids:
    """Geoms of a model, meshes as hulls (`physics`) or as they are drawn (`visual`)."""

    def __init__(self, mjm: mujoco.MjModel, geometry: str) -> None:
        self.mjm, self.visual = mjm, geometry == "visual"
        self._surface, self._shape = cache(self._make_surface), cache(self._make_shape)

    def geoms(self, root: str) -> list[int]:
        """Return the geoms of a body and of all bodies below it that count."""
        bodies = {self.mjm.body(root).id}
        for i in range(self.mjm.nbody):
            if self.mjm.body_parentid[i] in bodies:
                bodies.add(i)
        return [g for g in range(self.mjm.ngeom) if self.mjm.geom_bodyid[g] in bodies and self._counts(g)]

    def distance(self, data: mujoco.MjData, first: list[int], second: list[int]) -> float:
        """Return the least distance [m] of two groups of geoms, posed in `data`; 0 if they touch or one is inside."""
        pairs = [(a, b) for a in first for b in second]
        apart = np.array([np.linalg.norm(data.geom_xpos[a] - data.geom_xpos[b]) for a, b in pairs])
        bound = apart - np.array([self.mjm.geom_rbound[a] + self.mjm.geom_rbound[b] for a, b in pairs])
        least = np.inf
        for k in np.argsort(bound):
            if bound[k] < least:  # else their bounding spheres are further apart
                least = min(least, self._pair(data, *pairs[k]))
        return least

    def lowest(self, data: mujoco.MjData, geoms: list[int]) -> float:
        """Return the height [m] of the lowest point of meshes, boxes and cylinders."""
        return min(float(self.points(data, g)[:, 2].min()) for g in geoms)

    def points(self, data: mujoco.MjData, geom: int) -> np.ndarray:
        """Return the vertices of a geom in the world, shape (n, 3)."""
        return self._surface(geom)[0] @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]

    def _counts(self, geom: int) -> bool:
        if self.visual:
            return bool(self.mjm.geom_group[geom] < 3 and self.mjm.geom_rgba[geom, 3] > 0)
        return bool(self.mjm.geom_contype[geom] or self.mjm.geom_conaffinity[geom])

    def _make_surface(self, geom: int) -> tuple[np.ndarray, np.ndarray]:
        size = self.mjm.geom_size[geom]
        if self.mjm.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
            vertices = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size
            return _hull(vertices)
        mesh = self.mjm.mesh(self.mjm.geom_dataid[geom])
        vertices = self.mjm.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]].astype(float)
        if self.visual:
            return vertices, self.mjm.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]].astype(int)
        return _hull(vertices)

    def _make_shape(self, geom: int) -> fcl.CollisionGeometry:
        kind, (x, y, z) = self.mjm.geom_type[geom], self.mjm.geom_size[geom]
        if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            return fcl.Sphere(x)
        if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            return fcl.Capsule(x, 2 * y)
        if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            return fcl.Cylinder(x, 2 * y)
        if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return fcl.Ellipsoid(x, y, z)
        vertices, faces = self._surface(geom)
        mesh = fcl.BVHModel()
        mesh.beginModel(len(vertices), len(faces))
        mesh.addSubModel(vertices, faces)
        mesh.endModel()
        return mesh

    def _pair(self, data: mujoco.MjData, a: int, b: int) -> float:
        kinds = {int(self.mjm.geom_type[a]), int(self.mjm.geom_type[b])}
        if not kinds <= set(map(int, _MESHED)) and kinds & set(map(int, _MESHED)) and not self.visual:
            # FCL's distances of a primitive and a mesh are unreliable: MuJoCo C decides, in double precision
            fromto = np.zeros(6)
            return max(0.0, mujoco.mj_geomDistance(self.mjm, data, a, b, 1.0, fromto))
        objects = [
            fcl.CollisionObject(
                self._shape(g), fcl.Transform(data.geom_xmat[g].reshape(3, 3).copy(), data.geom_xpos[g].copy())
            )
            for g in (a, b)
        ]
        if fcl.collide(*objects, fcl.CollisionRequest(), fcl.CollisionResult()):
            return 0.0
        if kinds <= set(map(int, _MESHED)) and (self._inside(data, a, b) or self._inside(data, b, a)):
            return 0.0
        return fcl.distance(*objects, fcl.DistanceRequest(), fcl.DistanceResult())

    def _inside(self, data: mujoco.MjData, a: int, b: int) -> bool:
        """Is a point of a inside of b? Their surfaces do not meet, so one point speaks for all (of one component)."""
        point = self.points(data, a)[0]
        return abs(winding_number(self.points(data, b)[self._surface(b)[1]], point)) > 0.5


def winding_number(triangles: np.ndarray, point: np.ndarray) -> float:
    """Return how often a closed surface (n, 3, 3) winds around a point.

    The formula is that of Van Oosterom and Strackee, IEEE TBME 30(2), 1983.
    """
    a, b, c = (triangles - point).transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    top = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return float(np.arctan2(top, below).sum() / (2 * np.pi))


def _hull(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    hull = ConvexHull(vertices)
    middle = vertices.mean(axis=0)
    corners = vertices[hull.simplices]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flip = (outward * (corners[:, 0] - middle)).sum(1) < 0
    faces = hull.simplices.copy()
    faces[flip] = faces[flip][:, ::-1]
    return vertices, faces
