"""Repairs the surfaces of a link into one closed mesh, and reports what was done."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import networkx
import numpy as np
import trimesh

from sceniris_gym.errors import MeshError
from sceniris_gym.geometry.pieces import convex_hull
from sceniris_gym.importers.things.fit import Measure, tolerance_of
from sceniris_gym.importers.things.thing import Surface

MOST_FACES = 500_000
"""The most triangles of a thing: more than any picture of it needs, and minutes of work."""
LARGEST_HOLE, MOST_OPEN = 0.1, 0.3
"""Share of a surface that may be missing in one hole, and in all of them; flat patches close them. A box without one of
its sides misses a fifth, and may be a solid or a container."""
_WELD = 1e-6  # of its size: vertices nearer to each other are merged
_FLAT = 1e-6  # of its size: anything thinner is flat
_EMPTY = 1e-9  # of the cube of its size: a surface that encloses less encloses nothing


@dataclass(frozen=True)
class Solid:
    """A surface as one mesh.

    Attributes:
        mesh: The mesh [m], vertices welded.
        closed: Whether it encloses a volume; a shell does not.
        report: The repairs, in words.
        patches: A visual surface of the triangles that closed its holes; empty if none of them can be seen.
    """

    mesh: trimesh.Trimesh
    closed: bool
    report: tuple[str, ...]
    patches: tuple[Surface, ...] = ()


def check_faces(surfaces: Sequence[Surface], where: str) -> None:
    """Refuse surfaces without faces, with too many of them, or with numbers that are not finite.

    Raises:
        MeshError: See above.
    """
    count = sum(len(surface.faces) for surface in surfaces)
    if count == 0:
        raise MeshError(f"{where}: it has no faces. Export the object as a mesh of triangles or polygons.", "empty")
    if count > MOST_FACES:
        raise MeshError(
            f"{where}: it has {count:,} faces, and should have {MOST_FACES:,} at most. Reduce it, e.g. with Blender's "
            "modifier Decimate: 10,000 are plenty.",
            "large",
        )
    if not all(np.isfinite(surface.vertices).all() for surface in surfaces):
        raise MeshError(f"{where}: it has vertices that are not finite. Export it again.", "not finite")


def repair(surfaces: Sequence[Surface], where: str, *, shell: bool = False) -> Solid:
    """Merge vertices, drop faces that have no area or are duplicates, close small holes, and turn all faces outwards.

    Args:
        surfaces: The surfaces of a link [m].
        where: The beginning of errors.
        shell: The surface is a sheet that encloses nothing: holes stay as they are.

    Raises:
        MeshError: It lies in a plane, or too much of it is missing.
    """
    mesh = _joined(surfaces)
    size = float(mesh.extents.max()) if len(mesh.faces) else 0.0
    report = []
    faces = len(mesh.faces)
    mesh.update_faces(mesh.nondegenerate_faces(height=1e-12 * size) & mesh.unique_faces())
    mesh.remove_unreferenced_vertices()
    if len(mesh.faces) < faces:
        report.append(f"{faces - len(mesh.faces)} faces without area or twice there were dropped")
    if not len(mesh.faces) or float(np.linalg.svd(mesh.vertices - mesh.vertices.mean(axis=0), compute_uv=False)[2]) <= (
        _FLAT * size * np.sqrt(len(mesh.vertices))
    ):
        raise MeshError(f"{where}: it is flat and has no volume. Give it a thickness, or leave it out.", "flat")
    if not mesh.is_winding_consistent:
        trimesh.repair.fix_winding(mesh)
        report.append("its faces were turned to agree with each other")
    if shell:
        return Solid(mesh, False, (*report, "taken as a shell without inside"))
    loops, patches = _holes(mesh), ()
    if loops:
        shares = [float(np.linalg.norm(_vector_area(mesh.vertices, edges)) / mesh.area) for edges in loops]
        missing = sum(shares)
        if max(shares) > LARGEST_HOLE or missing > MOST_OPEN:
            hull, allowed = convex_hull(mesh.vertices), tolerance_of(mesh)
            if Measure(mesh, allowed).fit([hull]).error <= allowed:  # then solid and sheet are the same
                told = f"{missing:.0%} of its surface is missing: taken as its convex hull"
                return Solid(hull, True, (*report, f"{told}, which is as near to the surface as parts have to be"))
            raise MeshError(
                f"{where}: it is open along {sum(map(len, loops))} edges. What is missing is {missing:.0%} of "
                f"what is there, {max(shares):.0%} in the largest hole. Close it (in Blender: Mesh, Clean Up, Fill "
                "Holes), or import it with --shell if it is a sheet without inside.",
                "open",
            )
        mesh, patches = _capped(mesh, loops, surfaces[0].rgba)
        report.append(f"{len(loops)} holes, {missing:.2%} of its surface, were closed")
    if mesh.volume < 0.0:
        mesh.invert()
        report.append("it was inside out")
    if mesh.volume < _EMPTY * size**3:
        raise MeshError(f"{where}: it encloses no volume. Give it a thickness, or import it with --shell.", "flat")
    return Solid(mesh, True, tuple(report), patches)


def _joined(surfaces: Sequence[Surface]) -> trimesh.Trimesh:
    """Return all surfaces as one mesh in which near vertices are merged."""
    vertices, faces = trimesh.util.append_faces([s.vertices for s in surfaces], [s.faces for s in surfaces])
    used = vertices[np.unique(faces)]
    grid = _WELD * max(float(np.ptp(used, axis=0).max()), 1e-12)
    _, first, same = np.unique(
        np.round((vertices - used.min(axis=0)) / grid), axis=0, return_index=True, return_inverse=True
    )
    mesh = trimesh.Trimesh(vertices[first], same.ravel()[faces], process=False)
    mesh.remove_unreferenced_vertices()
    return mesh


def _holes(mesh: trimesh.Trimesh) -> list[np.ndarray]:
    """Return the edges that only one face has, each in that face's direction, by hole: arrays of shape (n, 2)."""
    edges = mesh.edges
    _, which, count = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    single = edges[(count[which.ravel()] % 2) == 1]
    if not len(single):
        return []
    label = trimesh.graph.connected_component_labels(single, len(mesh.vertices))[single[:, 0]]
    return [loop for i in np.unique(label) for loop in _loops(single[label == i])]


def _loops(edges: np.ndarray) -> list[np.ndarray]:
    """Split connected edges (n, 2) into loops that pass no vertex twice; edges that form no loop stay together."""
    graph = networkx.MultiDiGraph(edges.tolist())
    if not networkx.is_eulerian(graph):
        return [edges]
    found, path = [], []
    for start, end in networkx.eulerian_circuit(graph):
        path.append(start)
        if end in path:
            first = path.index(end)
            found.append(np.column_stack([path[first:], [*path[first + 1 :], end]]))
            del path[first:]
    return found


def _vector_area(vertices: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the area of a flat patch within a loop of edges, as a vector along its normal."""
    a, b = vertices[edges[:, 0]], vertices[edges[:, 1]]
    middle = 0.5 * (a + b).mean(axis=0)
    return 0.5 * np.cross(a - middle, b - middle).sum(axis=0)


def _capped(
    mesh: trimesh.Trimesh, loops: list[np.ndarray], rgba: tuple[float, ...]
) -> tuple[trimesh.Trimesh, tuple[Surface, ...]]:
    """Close each hole by triangles around its middle; return the mesh, and a surface of those that have an area."""
    middles = np.array([mesh.vertices[np.unique(edges)].mean(axis=0) for edges in loops])
    faces = np.concatenate(
        [
            np.column_stack([edges[:, 1], edges[:, 0], np.full(len(edges), len(mesh.vertices) + i)])
            for i, edges in enumerate(loops)
        ]
    )
    vertices = np.concatenate([mesh.vertices, middles])
    seen = faces[2.0 * trimesh.triangles.area(vertices[faces]) > 1e-9 * float(mesh.extents.max()) ** 2]
    used, inverse = np.unique(seen, return_inverse=True)
    patches = (Surface(vertices[used], inverse.reshape(-1, 3), rgba),) if len(seen) else ()
    return trimesh.Trimesh(vertices, np.concatenate([mesh.faces, faces]), process=False), patches
