"""Decomposes a mesh into few convex parts within a tolerance.

If the hull of a connected piece is within the tolerance, the hull is the part. Otherwise, CoACD cuts the piece into
parts. If the mesh is a solid, parts that are not within the tolerance are then split along planes. Finally, parts are
merged as far as the tolerance allows.
"""

from __future__ import annotations

import heapq
import itertools
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from sceniris_gym.errors import MeshError, import_extra
from sceniris_gym.importers.things import splitting
from sceniris_gym.importers.things.fit import Distances, Measure, are_near, tolerance_of
from sceniris_gym.importers.things.repair import Solid
from sceniris_gym.importers.things.thing import LEAST_MOMENT, Inertia
from sceniris_gym.progress import tell

if TYPE_CHECKING:
    import manifold3d

MOST_PARTS, USUAL_PARTS = 160, 32
"""Greatest number of parts of a mesh with a given tolerance, and by default."""
_LOOSER = 1.4  # factor of the allowed distance, while too many parts are left
_COARSER = 2.0  # multiple of the spacing of sample points, for merging with this distance
_TOO_MANY = 2 * MOST_PARTS  # parts of one piece: merging more does not reach `MOST_PARTS`, and finer cuts take minutes
_MOST_SPLIT = 4 * MOST_PARTS  # parts of all pieces: merging more parts takes minutes
_MOST_PIECES = 200
# CoACD's concavity threshold, in units of half a piece's size: the smallest first threshold, the first threshold as a
# multiple of the tolerance, and the number of thresholds to try. The error sets each next threshold, because fine ones
# are slow: for a camera of 42 mm, 0.12 takes 6 s of one core and fits, whereas 0.09 takes more than two minutes.
_COARSE, _MULTIPLE, _TRIES = 0.05, 4.0, 6
# A short search: with CoACD's defaults a mug takes four times as long, and merging removes the surplus parts anyway.
_SEARCH = {"mcts_iterations": 10, "mcts_nodes": 8, "mcts_max_depth": 2, "resolution": 500}
_GRID = 40  # cells along a piece's size, when CoACD encloses an open piece in a surface
# Fraction of the tolerance for simplifying faces before CoACD. A link of 12,716 faces then has 1,000 faces, and takes a
# fifth of the time and a third of the parts.
_SIMPLER = 0.2
_LOST = 2.0  # multiple of that distance: a vertex farther from the simplified mesh was lost
# Fractions of the tolerance for each piece, for merging, and for the final check. The margins cover sampling errors.
_REST, _MERGED, _SURE = 0.9, 0.9, 0.95
_SPLITS = (_REST, 0.45, 0.2)  # how far parts of a solid may stick out: the next fraction follows a failed final check
# A cut with an error above this fraction of the smallest error so far halves the threshold, at most this many times in
# succession.
_BETTER, _WORSE = 0.95, 2
# Number of points in the final check. Fewer points miss small areas that other parts leave uncovered: on a motor mount,
# 10,000 points found an error of 2.5 mm, and 50,000 found 4.1 mm. If the error is too large, merging is repeated with a
# smaller tolerance, up to this number of attempts.
_EXACT, _MERGES = 50_000, 3
Beyond = Callable[[trimesh.Trimesh, list[trimesh.Trimesh]], float]


@dataclass(frozen=True)
class Parts:
    """Convex parts of a mesh.

    Attributes:
        meshes: The parts [m].
        error: Distance between the parts and the mesh [m], as `Measure.error` measures it.
        tolerance: Largest allowed distance [m].
        method: Text for the manifest: the methods that found the parts, such as "2 x CoACD, 1 x hull, split".
    """

    meshes: tuple[trimesh.Trimesh, ...]
    error: float
    tolerance: float
    method: str


def convex_parts(solid: Solid, where: str, tolerance: float | None = None, max_parts: int | None = None) -> Parts:
    """Find few convex parts whose distance from a mesh is at most a tolerance, as `Measure` measures it.

    Args:
        solid: The mesh.
        where: Prefix of error messages.
        tolerance: Largest distance between parts and mesh [m]. By default 2 mm or 2% of the mesh's longest edge,
            whichever is larger. The default grows until `max_parts` parts suffice.
        max_parts: Greatest number of parts. None means 32, or 160 if a `tolerance` is given.

    Raises:
        MeshError: The best parts exceed the tolerance. Or they are more than 160, or with a `tolerance`, more than
            `max_parts`.
        MissingExtraError: The mesh is not convex, and CoACD is not installed.
    """
    most = max_parts or (USUAL_PARTS if tolerance is None else MOST_PARTS)
    allowed = tolerance_of(solid.mesh) if tolerance is None else tolerance
    pieces, cuts = _pieces(solid.mesh), []
    for i, piece in enumerate(pieces):
        tell("pieces cut", i, len(pieces))
        cuts.append(_of_piece(piece, solid.closed, _REST * allowed))
    found, methods = [part for cut in cuts for part in cut.parts], [cut.method for cut in cuts]
    method = ", ".join(f"{methods.count(word)} x {word}" for word in sorted(set(methods)))
    exact = Measure(solid.mesh, allowed, _EXACT)
    if solid.closed:
        whole, near, tried = found, splitting.union_of([cut.solid for cut in cuts]), []
        for share in _SPLITS:
            excess = splitting.Excess(near, solid.mesh, share * allowed)
            found = splitting.split(whole, excess, _MOST_SPLIT)
            tried.append(_merged(found, excess.beyond, exact, allowed))
            if tried[-1][1] <= allowed or len(tried[-1][0]) > MOST_PARTS:
                break
        parts, error = min(tried, key=_rank)
        beyond = splitting.Excess(near, solid.mesh, _COARSER * allowed).beyond
        method += ", split" if len(found) > len(whole) else ""
    else:
        beyond = Measure(solid.mesh, allowed).beyond
        parts, error = _merged(found, beyond, exact, allowed)
    limit = MOST_PARTS if tolerance is None else min(most, MOST_PARTS)
    if error > allowed or len(parts) > limit:
        raise MeshError(
            f"{where}: at most {limit} convex parts should fit the surface within {1000.0 * allowed:.2g} mm, but "
            f"the best fit has {len(parts)} parts and is off by {1000.0 * error:.2g} mm ({method}). Increase "
            "--tolerance, or model thin and fine structures thicker.",
            "parts",
        )
    loose = allowed
    while len(parts) > most:
        loose *= _LOOSER
        parts = merge(parts, beyond, loose, most)
        error = exact.error(parts)
        allowed = max(allowed, error)
    return Parts(tuple(parts), error, allowed, method)


def inertia_of(solid: Solid, parts: Parts, density: float, where: str) -> Inertia:
    """Return the inertia of a link with the same density everywhere.

    If the surface is a single closed piece, the link's volume is the volume inside it. Otherwise, the volume is the
    union of the convex parts. This counts overlapping pieces once, and gives a shell a volume.

    Args:
        solid: Surface of the link [m].
        parts: Convex parts of the link.
        density: Density [kg/m^3].
        where: Prefix of error messages.

    Raises:
        MeshError: The moments of inertia are too small for MuJoCo.
    """
    mesh = solid.mesh
    alone = solid.closed and mesh.is_watertight and mesh.body_count == 1
    if not alone or mesh.volume <= 0.0 or np.linalg.eigvalsh(mesh.moment_inertia)[0] <= 0.0:
        mesh = splitting.mesh_of(splitting.union_of_parts(parts.meshes))
    full = density * np.asarray(mesh.moment_inertia)
    found = Inertia(density * float(mesh.volume), np.asarray(mesh.center_mass), full)
    if (least := float(np.linalg.eigvalsh(full)[0])) <= LEAST_MOMENT:
        raise MeshError(
            f"{where}: its smallest moment of inertia should be at least {LEAST_MOMENT:g} kg m^2 for MuJoCo, got "
            f"{least:.1g} kg m^2: it is a sliver of {1e6 * found.mass:.2g} mg. Leave it out, or give it a thickness. "
            "If the object should be larger, correct --scale.",
            "sliver",
        )
    return found


def _merged(
    found: list[trimesh.Trimesh], beyond: Beyond, exact: Measure, allowed: float
) -> tuple[list[trimesh.Trimesh], float]:
    """Merge parts as long as they stay within the tolerance, and return the merged parts with their error [m].

    The merge uses the fast measure `beyond`. After each attempt, `exact` measures the error. If the error is too
    large, the parts are merged again with a smaller tolerance. If no attempt is within the tolerance, return the
    attempt with the smallest error. Attempts with at most `MOST_PARTS` parts take precedence.
    """
    aimed, tried = _MERGED * allowed, []
    for _ in range(_MERGES):
        parts = merge(found, beyond, aimed)
        error = exact.error(parts)
        if error <= _SURE * allowed:
            return parts, error
        tried.append((parts, error))
        aimed *= _MERGED * allowed / error
    tried.append((found, exact.error(found)))
    return min(tried, key=_rank)


def merge(parts: list[trimesh.Trimesh], beyond: Beyond, allowed: float, fewest: int = 1) -> list[trimesh.Trimesh]:
    """Replace pairs of parts by their common hull while the hull stays near the mesh, least added volume first.

    Args:
        parts: Convex parts.
        beyond: Takes a part and the other parts. Returns the largest distance [m] from the outside of the part to the
            mesh.
        allowed: Largest distance [m] that `beyond` may return for a hull.
        fewest: Number of parts that ends the merging.
    """
    alive = dict(enumerate(parts))
    fresh = itertools.count(len(parts))
    heap: list[tuple[float, int, int]] = []

    def push(i: int, others: Iterable[int]) -> None:
        for j in others:
            if are_near(alive[i], alive[j], allowed):
                both = ConvexHull(np.concatenate([alive[i].vertices, alive[j].vertices]))
                heapq.heappush(heap, (float(both.volume - alive[i].volume - alive[j].volume), j, i))

    for i in range(len(parts)):
        push(i, range(i))
    while heap and len(alive) > fewest:
        tell("parts merged", len(parts) - len(alive), len(parts))
        _, j, i = heapq.heappop(heap)
        if i not in alive or j not in alive:
            continue
        both = splitting.small_hull(np.concatenate([alive[i].vertices, alive[j].vertices]), allowed)
        others = {k: part for k, part in alive.items() if k not in (i, j)}
        if beyond(both, list(others.values())) <= allowed:
            new = next(fresh)
            alive = {**others, new: both}
            push(new, others)
    return list(alive.values())


def _rank(found: tuple[list[trimesh.Trimesh], float]) -> tuple[bool, float]:
    """Return a sort key: results with at most `MOST_PARTS` parts come first, and among these the smallest error."""
    return len(found[0]) > MOST_PARTS, found[1]


@dataclass(frozen=True)
class _Cut:
    """Convex parts of a connected piece, the method that found them, and the piece as a solid, slightly simplified."""

    parts: list[trimesh.Trimesh]
    method: str
    solid: manifold3d.Manifold


def _of_piece(piece: trimesh.Trimesh, closed: bool, allowed: float) -> _Cut:
    """Cut a connected piece into convex parts.

    A shell is cut with finer and finer thresholds until its parts are within `allowed` [m]. A solid is cut only once,
    because `splitting.split` refines its parts later.
    """
    hull = [splitting.small_hull(piece.vertices, allowed)]
    measure = Measure(piece, allowed)
    error = 0.0 if float(piece.extents.max()) < allowed else measure.error(hull)
    if error <= allowed:
        return _Cut(hull, "hull", splitting.hull_of(hull[0].vertices))
    simple = _simpler(piece, _SIMPLER * allowed)
    solid = splitting.manifold_of(simple)
    threshold = float(np.clip(_MULTIPLE * allowed / float(piece.extents.max()), _COARSE, 1.0))  # CoACD's maximum
    if closed and not solid.is_empty():
        parts = _cut(simple, threshold, closed, allowed)
        return _Cut(parts or hull, "CoACD" if parts else "hull", solid)
    best, worse = hull, 0
    for _ in range(_TRIES):
        parts = _cut(simple, threshold, closed, allowed)
        if len(parts) > _TOO_MANY:
            break
        off = measure.error(parts) if parts else np.inf
        worse = worse + 1 if off > _BETTER * error else 0
        if off < error:
            best, error = parts, off
        if error <= allowed or worse > _WORSE:
            break
        threshold *= 0.5 if worse else max(0.9 * min(allowed / off, 1.0), 0.5)
    return _Cut(best, "hull" if best is hull else "CoACD", splitting.union_of_parts(best))


def _simpler(mesh: trimesh.Trimesh, off: float) -> trimesh.Trimesh:
    """Simplify a mesh to within about `off` [m]. Return the mesh itself if that is not possible."""
    solid = splitting.manifold_of(mesh)
    simple = splitting.mesh_of(solid.simplify(off))
    if solid.is_empty() or not len(simple.faces):
        return mesh
    # A self-intersecting mesh is also a manifold, and simplification can lose a piece of it.
    return mesh if Distances(simple.vertices, simple.faces).farthest(mesh.vertices)[1] > _LOST * off else simple


def _cut(mesh: trimesh.Trimesh, threshold: float, closed: bool, allowed: float) -> list[trimesh.Trimesh]:
    """Cut a mesh with CoACD, and reduce the vertices of each part. If the mesh is open, CoACD first closes it."""
    # One thread finds the same parts on every machine. Several threads wait for each other on busy cores.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    coacd = import_extra("coacd", "import")
    coacd.set_log_level("error")
    found = coacd.run_coacd(
        coacd.Mesh(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, int)),
        threshold=threshold,
        preprocess_mode="auto" if closed else "on",
        preprocess_resolution=_GRID,
        merge=False,
        seed=0,
        **_SEARCH,
    )
    hulls = (splitting.hull_or_none(np.asarray(vertices, float), allowed) for vertices, _ in found)
    return [hull for hull in hulls if hull is not None]


def _pieces(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """Return the connected pieces of a mesh, without flat pieces.

    If a piece is a cavity, or if there are more than `_MOST_PIECES` pieces, return the whole mesh.
    """
    found = mesh.split(only_watertight=False)
    pieces = [piece for piece in found if splitting.hull_or_none(piece.vertices) is not None]
    if len(pieces) > _MOST_PIECES or any(piece.is_watertight and piece.volume < 0.0 for piece in pieces):
        return [mesh]
    return pieces
