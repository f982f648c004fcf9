"""Joins the surfaces of a link into one mesh, closes and orients it, and reports each repair."""

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
"""Largest number of triangles of an object. With more triangles, images look the same, but an import takes minutes."""
LARGEST_HOLE, MOST_OPEN = 0.1, 0.3
"""Largest area of one hole, and of all holes together, as a fraction of the surface's area. Flat patches close them.
Larger holes are not closed: a box without one side has a hole of a fifth, and may be a solid or a container."""
_WELD = 1e-6  # fraction of the size: closer vertices are merged
_FLAT = 1e-6  # fraction of the size: a thinner mesh is flat
_EMPTY = 1e-9  # fraction of the cubed size: the smallest enclosed volume


@dataclass(frozen=True)
class Solid:
    """The surfaces of a link as one repaired mesh.

    Attributes:
        mesh: The mesh [m], with merged vertices.
        closed: Whether the mesh encloses a volume. A shell does not.
        report: A sentence for each repair.
        patches: One visual surface of the triangles that close holes. Empty if no hole was closed, or if these
            triangles all have zero area.
    """

    mesh: trimesh.Trimesh
    closed: bool
    report: tuple[str, ...]
    patches: tuple[Surface, ...] = ()


def check_faces(surfaces: Sequence[Surface], where: str) -> None:
    """Check that surfaces have faces, not too many of them, and only finite vertices.

    Raises:
        MeshError: The surfaces have no faces, more than `MOST_FACES` faces, or non-finite vertices.
    """
    count = sum(len(surface.faces) for surface in surfaces)
    if count == 0:
        raise MeshError(f"{where}: it has no faces. Export the object as triangles or polygons.", "empty")
    if count > MOST_FACES:
        raise MeshError(
            f"{where}: it should have at most {MOST_FACES:,} faces, got {count:,} faces. Reduce them, e.g. with "
            "Blender's modifier Decimate. 10,000 are enough.",
            "large",
        )
    if not all(np.isfinite(surface.vertices).all() for surface in surfaces):
        raise MeshError(f"{where}: it has non-finite vertices. Export it again.", "not finite")


def repair(surfaces: Sequence[Surface], where: str, *, shell: bool = False) -> Solid:
    """Merge vertices, drop degenerate and duplicate faces, close small holes, and orient all faces outwards.

    If holes are too large to close, but the convex hull is within the default tolerance of the surface, the hull
    replaces the surface.

    Args:
        surfaces: The surfaces of a link [m].
        where: Prefix of error messages.
        shell: Whether the surface is a sheet without volume. If so, holes are not closed.

    Raises:
        MeshError: The mesh is flat, encloses no volume, or has holes that are too large.
    """
    mesh = _joined(surfaces)
    size = float(mesh.extents.max()) if len(mesh.faces) else 0.0
    report = []
    faces = len(mesh.faces)
    mesh.update_faces(mesh.nondegenerate_faces(height=1e-12 * size) & mesh.unique_faces())
    mesh.remove_unreferenced_vertices()
    if len(mesh.faces) < faces:
        report.append(f"{faces - len(mesh.faces)} degenerate or duplicate faces were dropped")
    thin = _FLAT * size * np.sqrt(len(mesh.vertices))
    if not len(mesh.faces) or np.linalg.svd(mesh.vertices - mesh.vertices.mean(axis=0), compute_uv=False)[2] <= thin:
        raise MeshError(f"{where}: it is flat and has no volume. Give it a thickness, or leave it out.", "flat")
    if not mesh.is_winding_consistent:
        trimesh.repair.fix_winding(mesh)
        report.append("the orientation of its faces was made consistent")
    if shell:
        return Solid(mesh, False, (*report, "imported as a shell without volume"))
    loops, patches = _holes(mesh), ()
    if loops:
        shares = [float(np.linalg.norm(_vector_area(mesh.vertices, edges)) / mesh.area) for edges in loops]
        missing = sum(shares)
        if max(shares) > LARGEST_HOLE or missing > MOST_OPEN:
            hull, allowed = convex_hull(mesh.vertices), tolerance_of(mesh)
            if Measure(mesh, allowed).error([hull]) <= allowed:  # then solid and sheet are equivalent
                told = f"{missing:.0%} of its surface is missing: replaced by its convex hull"
                return Solid(hull, True, (*report, f"{told}, which is within the tolerance of the surface"))
            raise MeshError(
                f"{where}: it is open along {sum(map(len, loops))} edges. Its holes have {missing:.0%} of the area of "
                f"its surface, the largest hole has {max(shares):.0%}. Close them (in Blender: Mesh, Clean Up, Fill "
                "Holes), or import it with --shell if it is a sheet without volume.",
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
    """Join all surfaces into one mesh, and merge close vertices."""
    vertices, faces = trimesh.util.append_faces([s.vertices for s in surfaces], [s.faces for s in surfaces])
    used = vertices[np.unique(faces)]
    grid = _WELD * max(float(np.ptp(used, axis=0).max()), 1e-12)
    cells = np.round((vertices - used.min(axis=0)) / grid)
    _, first, same = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    mesh = trimesh.Trimesh(vertices[first], same.ravel()[faces], process=False)
    mesh.remove_unreferenced_vertices()
    return mesh


def _holes(mesh: trimesh.Trimesh) -> list[np.ndarray]:
    """Return the boundary edges of each hole as pairs of vertices, shape (n, 2) per hole.

    The vertices of an edge are in the same order as in the face that has the edge.
    """
    edges = mesh.edges
    _, which, count = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    single = edges[(count[which.ravel()] % 2) == 1]
    if not len(single):
        return []
    label = trimesh.graph.connected_component_labels(single, len(mesh.vertices))[single[:, 0]]
    return [loop for i in np.unique(label) for loop in _loops(single[label == i])]


def _loops(edges: np.ndarray) -> list[np.ndarray]:
    """Split connected edges (n, 2) into simple loops. If the edges do not form loops, return them as one array."""
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
    """Return the area vector [m^2] of a loop of edges, shape (3,): the normal times the area of a patch in the loop."""
    a, b = vertices[edges[:, 0]], vertices[edges[:, 1]]
    middle = 0.5 * (a + b).mean(axis=0)
    return 0.5 * np.cross(a - middle, b - middle).sum(axis=0)


def _capped(
    mesh: trimesh.Trimesh, loops: list[np.ndarray], rgba: tuple[float, ...]
) -> tuple[trimesh.Trimesh, tuple[Surface, ...]]:
    """Close each hole with triangles that meet in the middle of the hole.

    Args:
        mesh: The mesh.
        loops: For each hole, the edges around it as pairs of vertices, shape (n, 2).
        rgba: Colour of the new triangles.

    Returns:
        The closed mesh, and one surface of the new triangles with nonzero area. No surface if all areas are zero.
    """
    middles = np.array([mesh.vertices[np.unique(edges)].mean(axis=0) for edges in loops])
    fans = [np.insert(edges[:, ::-1], 2, middle, axis=1) for middle, edges in enumerate(loops, len(mesh.vertices))]
    faces = np.concatenate(fans)
    vertices = np.concatenate([mesh.vertices, middles])
    seen = faces[2.0 * trimesh.triangles.area(vertices[faces]) > 1e-9 * float(mesh.extents.max()) ** 2]
    used, inverse = np.unique(seen, return_inverse=True)
    patches = (Surface(vertices[used], inverse.reshape(-1, 3), rgba),) if len(seen) else ()
    return trimesh.Trimesh(vertices, np.concatenate([mesh.faces, faces]), process=False), patches
