"""Closed meshes from profiles and rounded boxes, convex hulls, and OBJ files. Units are metres."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import manifold3d
import numpy as np
import trimesh
from scipy.interpolate import PchipInterpolator

from sceniris_gym.files import replacing

from .paths import mesh_file

# One micrometre, so that neighbours at the pole of a 16,000-face mesh remain different in the text file.
DECIMALS = 6


@dataclass(frozen=True)
class Mesh:
    """Triangles: ``vertices`` (n, 3) [m], ``faces`` (m, 3), and optional texture coordinates with separate faces."""

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray | None = None
    uv_faces: np.ndarray | None = None

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner, shape (2, 3)."""
        return np.array([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    def moved(self, offset: Sequence[float] | np.ndarray) -> Mesh:
        """Return the mesh shifted by ``offset`` [m]."""
        return replace(self, vertices=self.vertices + np.asarray(offset))


def smooth_profile(points: Sequence[tuple[float, float, float]], rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Sample a curve through control points ``(r [mm], z [mm], weight)`` at ``rows`` + 2 stations.

    The ``weight`` of a point is the density of stations on the span that ends in this point, relative to spacing by arc
    length. Returns the stations (rows + 2, 2) [m], including both ends, and their parameters in [0, 1].
    """
    control = np.asarray(points, dtype=float)
    spans = np.linalg.norm(np.diff(control[:, :2], axis=0), axis=1) * control[1:, 2]
    knots = np.concatenate([[0.0], np.cumsum(spans)]) / spans.sum()
    t = np.linspace(0.0, 1.0, rows + 2)
    return PchipInterpolator(knots, control[:, :2])(t) / 1000.0, t


def skin(rings: np.ndarray, start: np.ndarray, end: np.ndarray, t: np.ndarray) -> Mesh:
    """Connect a stack of ``rings`` (row, segment, 3), and close it with fans to the points ``start`` and ``end``.

    Rings run counter-clockwise as seen from ``start``, so that faces point outward. The texture's u goes once around,
    and its v is ``t`` (row + 2,). The mesh has 2 x rows x segments faces.
    """
    rows, segments = rings.shape[:2]
    vertices = np.concatenate([start[None], rings.reshape(-1, 3), end[None]])
    around = np.arange(segments)
    following = (around + 1) % segments

    def face_rows(index, follow, last):
        faces = [np.stack([np.zeros_like(around), index(0, around), index(0, follow)], axis=1)]
        for row in range(rows - 1):
            a, b = index(row, around), index(row, follow)
            c, d = index(row + 1, around), index(row + 1, follow)
            faces += [np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)]
        faces.append(np.stack([index(rows - 1, around), np.full_like(around, last), index(rows - 1, follow)], axis=1))
        return np.concatenate(faces)

    faces = face_rows(lambda row, s: 1 + row * segments + s, following, len(vertices) - 1)
    u = np.arange(segments + 1) / segments
    inner = np.stack(np.broadcast_arrays(u[None, :], t[1:-1, None]), axis=-1).reshape(-1, 2)
    uv = np.concatenate([[[0.5, t[0]]], inner, [[0.5, t[-1]]]])
    uv_faces = face_rows(lambda row, s: 1 + row * (segments + 1) + s, around + 1, len(uv) - 1)
    return Mesh(vertices, faces, uv, uv_faces)


def lathe(profile: np.ndarray, segments: int, t: np.ndarray | None = None) -> Mesh:
    """Turn a profile (n, 2) of (r, z) [m] about the z axis. The profile starts and ends on the axis, top end first."""
    angle = 2.0 * np.pi * np.arange(segments) / segments
    r, z = profile[1:-1, :1], profile[1:-1, 1:]
    rings = np.stack(np.broadcast_arrays(r * np.cos(angle), r * np.sin(angle), z), axis=-1)
    ends = np.array([[0.0, 0.0, profile[0, 1]], [0.0, 0.0, profile[-1, 1]]])
    return skin(rings, ends[0], ends[1], np.linspace(0.0, 1.0, len(profile)) if t is None else t)


def solid(mesh: Mesh) -> manifold3d.Manifold:
    """Convert a mesh to a solid for Boolean operations."""
    data = manifold3d.Mesh64(np.ascontiguousarray(mesh.vertices, float), np.ascontiguousarray(mesh.faces, np.uint64))
    body = manifold3d.Manifold(data)
    if body.status() != manifold3d.Error.NoError:
        raise ValueError(f"the mesh of {len(mesh.faces)} faces should be closed: {body.status()}")
    return body


def surface(body: manifold3d.Manifold) -> Mesh:
    """The surface of a solid."""
    data = body.to_mesh64()
    return Mesh(np.array(data.vert_properties[:, :3], dtype=float), np.array(data.tri_verts, dtype=np.int64))


def hull(points: np.ndarray) -> manifold3d.Manifold:
    """The convex hull of points (n, 3)."""
    return manifold3d.Manifold.hull_points(np.ascontiguousarray(points, dtype=float))


def box(low: Sequence[float], high: Sequence[float], radius: float = 0.0, steps: int = 4) -> manifold3d.Manifold:
    """A box between two corners [m] with edges rounded by ``radius`` in ``steps`` steps."""
    lowest, highest = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    signs = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    if radius == 0.0:
        return hull(lowest + signs * (highest - lowest))
    lift = 0.5 * np.pi * np.arange(steps + 1) / steps
    turn, rise = np.meshgrid(lift, lift)
    octant = np.stack([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)], axis=-1).reshape(-1, 3)
    # Poles repeat at every step around the axis, up to rounding: unequal copies would leave slivers in the hull.
    octant = np.unique(octant.round(12), axis=0)
    corners = np.where(signs == 0, lowest + radius, highest - radius)
    points = [corner + radius * octant * (2 * sign - 1) for corner, sign in zip(corners, signs, strict=True)]
    return hull(np.concatenate(points))


def write_obj(name: str, mesh: Mesh) -> None:
    """Write ``meshes/<name>.obj``. Raise ValueError unless the written mesh is closed and faces outward."""
    lines = [f"v {x:.{DECIMALS}f} {y:.{DECIMALS}f} {z:.{DECIMALS}f}" for x, y, z in mesh.vertices + 0.0]
    if mesh.uv is None or mesh.uv_faces is None:
        lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]
    else:
        lines += [f"vt {u:.4f} {v:.4f}" for u, v in mesh.uv]
        corners = np.stack([mesh.faces, mesh.uv_faces], axis=-1).reshape(-1, 6) + 1
        lines += ["f {}/{} {}/{} {}/{}".format(*row) for row in corners]
    read = trimesh.Trimesh(np.round(mesh.vertices, DECIMALS), mesh.faces, process=True)
    if not (read.is_watertight and read.is_winding_consistent and read.volume > 0):
        raise ValueError(f"{name}.obj should be a closed mesh that faces outward")
    with replacing(mesh_file(f"{name}.obj")) as file:
        file.write_text("\n".join(lines).replace("-0.000000", "0.000000") + "\n")
