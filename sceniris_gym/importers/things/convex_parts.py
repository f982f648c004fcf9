"""Convex parts of a mesh: of each connected piece the hull if it fits, or what CoACD cuts it into.

Those of a solid that do not fit yet are split along planes; at last parts are merged.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sceniris_gym.errors import MissingExtraError, PartsError
from sceniris_gym.importers.things.fit import Distances, Fit, Measure, tolerance_of
from sceniris_gym.importers.things.merging import Beyond, merge
from sceniris_gym.importers.things.repair import Solid
from sceniris_gym.importers.things.splitting import Excess, hull_of, manifold_of, mesh_of, solid_of, split, union_of

if TYPE_CHECKING:
    import manifold3d
    import trimesh

MOST_PARTS = 160
_TOO_MANY = 2 * MOST_PARTS  # of one piece: merging does not bring back so few, and finer cuts take minutes
_MOST_SPLIT = 4 * MOST_PARTS  # of all pieces: merging takes minutes with more
_MOST_PIECES = 200
_MOST_VERTICES = 96  # of a part: MuJoCo-Warp's collisions take longer with more
_DIRECTIONS = 192
# CoACD's threshold of concavity: what is tried first, in halves of a piece's size and as a multiple of what is allowed;
# and how often a finer one is tried, as fine as the error asks for. Finer ones take steeply longer: for a camera of
# 42 mm 0.12 takes 6 s of a core, and fits, where 0.09 takes more than two minutes.
_COARSE, _MULTIPLE, _TRIES = 0.05, 4.0, 6
# Its search is made short: with its defaults a mug takes four times as long, and merging finds what that would save.
_SEARCH = {"mcts_iterations": 10, "mcts_nodes": 8, "mcts_max_depth": 2, "resolution": 500}
_GRID = 40  # cells along its size, of the surface that CoACD closes first
# Of what is allowed, by which faces may be simplified before: a link of 12,716 faces has 1,000 then, and takes a fifth
# of the time, and a third of the parts.
_SIMPLER = 0.2
_LOST = 2.0  # times that: what is farther from the simplified mesh was lost by it
# Of what is allowed: for each piece, while parts are merged, and by a close look at them. Samples miss a little.
_REST, _MERGED, _SURE = 0.9, 0.9, 0.95
# Of the error before: after a cut that brings less than that the next one is twice as fine, and the third such in a row
# is the last.
_BETTER, _WORSE = 0.95, 2
# Points that the parts are judged by in the end. Fewer miss the small places that other parts leave bare of one: for a
# motor's mount 10,000 found 2.5 mm, and these 4.1 mm. Where that is too much, less is merged, and less again.
_EXACT, _MERGES = 50_000, 3


@dataclass(frozen=True)
class Parts:
    """Convex parts of a mesh.

    Attributes:
        meshes: The parts [m].
        fit: How they fit.
        tolerance: How they had to fit [m].
        method: How they were found, in words.
    """

    meshes: tuple[trimesh.Trimesh, ...]
    fit: Fit
    tolerance: float
    method: str


def convex_parts(solid: Solid, where: str, tolerance: float | None = None) -> Parts:
    """Find few convex parts that stay within a tolerance of a mesh.

    Args:
        solid: The mesh.
        where: How errors begin.
        tolerance: In metres; by default 2 mm or 2% of its longest edge, whichever is larger.

    Raises:
        PartsError: Not even the finest parts stay within it.
        MissingExtraError: It is not convex, and CoACD is not installed.
    """
    allowed = tolerance_of(solid.mesh) if tolerance is None else tolerance
    cuts = [_of_piece(piece, solid.closed, _REST * allowed) for piece in _pieces(solid.mesh)]
    found, methods = [part for cut in cuts for part in cut.parts], [cut.method for cut in cuts]
    method = ", ".join(f"{methods.count(word)} x {word}" for word in sorted(set(methods)))
    if solid.closed:
        excess = Excess(union_of([cut.solid for cut in cuts]), solid.mesh, _REST * allowed)
        whole, found = found, split(found, excess, _hull_or_none, _MOST_SPLIT)
        method += ", split" if len(found) > len(whole) else ""
        beyond = excess.beyond
    else:
        beyond = Measure(solid.mesh, allowed).beyond
    parts, fit = _merged(found, beyond, Measure(solid.mesh, allowed, _EXACT), allowed)
    if fit.error > allowed or len(parts) > MOST_PARTS:
        raise PartsError(
            f"{where}: its best convex parts, {len(parts)} by {method}, are {1000.0 * fit.error:.2g} mm off its "
            f"surface; at most {1000.0 * allowed:.2g} mm and {MOST_PARTS} parts are allowed. Allow more with "
            "--tolerance, or model thin and fine structures thicker."
        )
    return Parts(tuple(parts), fit, allowed, method)


def _merged(
    found: list[trimesh.Trimesh], beyond: Beyond, exact: Measure, allowed: float
) -> tuple[list[trimesh.Trimesh], Fit]:
    """Merge parts as far as a close look in the end lets them fit, and how they do.

    Where no merging leaves enough in hand, those that fit best are taken; too many only if there are no others.
    """
    aimed, tried = _MERGED * allowed, []
    for _ in range(_MERGES):
        parts = merge(found, beyond, aimed, small_hull)
        fit = exact.fit(parts)
        if fit.error <= _SURE * allowed:
            return parts, fit
        tried.append((parts, fit))
        aimed *= _MERGED * allowed / fit.error
    tried.append((found, exact.fit(found)))
    return min(tried, key=lambda each: (len(each[0]) > MOST_PARTS, each[1].error))


@dataclass(frozen=True)
class _Cut:
    """Parts of a connected piece, how they were found, and a solid near it."""

    parts: list[trimesh.Trimesh]
    method: str
    solid: manifold3d.Manifold


def _of_piece(piece: trimesh.Trimesh, closed: bool, allowed: float) -> _Cut:
    """Cut a connected piece; where no solid can be made of it, so that nothing is split later, until the parts fit."""
    hull = [small_hull(piece.vertices)]
    measure = Measure(piece, allowed)
    error = 0.0 if float(piece.extents.max()) < allowed else measure.fit(hull).error
    if error <= allowed:
        return _Cut(hull, "hull", solid_of(hull[0]))
    simple = _simpler(piece, _SIMPLER * allowed)
    solid = manifold_of(simple)
    threshold = float(np.clip(_MULTIPLE * allowed / float(piece.extents.max()), _COARSE, 1.0))  # CoACD takes no more
    if closed and not solid.is_empty():
        parts = _cut(simple, threshold, closed)
        return _Cut(parts or hull, "CoACD" if parts else "hull", solid)
    best, worse = hull, 0
    for _ in range(_TRIES):
        parts = _cut(simple, threshold, closed)
        if len(parts) > _TOO_MANY:
            break
        off = measure.fit(parts).error if parts else np.inf
        worse = worse + 1 if off > _BETTER * error else 0
        if off < error:
            best, error = parts, off
        if error <= allowed or worse > _WORSE:
            break
        threshold *= 0.5 if worse else max(0.9 * min(allowed / off, 1.0), 0.5)
    return _Cut(best, "hull" if best is hull else "CoACD", union_of([solid_of(part) for part in best]))


def _simpler(mesh: trimesh.Trimesh, off: float) -> trimesh.Trimesh:
    """The mesh with fewer faces, hardly farther from it than `off` [m]; itself where that cannot be had."""
    solid = manifold_of(mesh)
    simple = mesh_of(solid.simplify(off))
    if solid.is_empty() or not len(simple.faces):
        return mesh
    # A mesh that cuts through itself is a manifold too, and can lose a piece.
    return mesh if Distances(simple.vertices, simple.faces).farthest(mesh.vertices)[1] > _LOST * off else simple


def _cut(mesh: trimesh.Trimesh, threshold: float, closed: bool) -> list[trimesh.Trimesh]:
    """The parts that CoACD cuts a mesh into; it closes what is open by a surface around it."""
    # One thread finds the same parts on every machine; several wait for each other where cores are busy.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    try:
        import coacd
    except ImportError:
        raise MissingExtraError("coacd", "import") from None
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
    hulls = [_hull_or_none(np.asarray(vertices, float)) for vertices, _ in found]
    return [hull for hull in hulls if hull is not None]


def small_hull(points: np.ndarray) -> trimesh.Trimesh:
    """The convex hull of points (n, 3), of few vertices: where there are many, those farthest in even directions."""
    from sceniris_gym.geometry.pieces import convex_hull

    hull = convex_hull(points)
    if len(hull.vertices) <= _MOST_VERTICES:
        return hull
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(_DIRECTIONS)
    height = 1.0 - 2.0 * (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    level = np.sqrt(1.0 - height**2)
    directions = np.stack([level * np.cos(turn), level * np.sin(turn), height], axis=1)
    directions = np.concatenate([directions, np.eye(3), -np.eye(3)])
    farthest = np.unique(np.argmax(hull.vertices @ directions.T, axis=0))
    return convex_hull(hull.vertices[farthest])


def _hull_or_none(points: np.ndarray) -> trimesh.Trimesh | None:
    """The same; None if the points lie in a plane."""
    flat = hull_of(points).volume() <= 1e-9 * float(np.ptp(points, axis=0).max()) ** 3
    return None if flat else small_hull(points)


def _pieces(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """The connected pieces of a mesh that have a volume; all of it as one if some are hollows inside of others."""
    pieces = [piece for piece in mesh.split(only_watertight=False) if _hull_or_none(piece.vertices) is not None]
    if len(pieces) > _MOST_PIECES or any(piece.is_watertight and piece.volume < 0.0 for piece in pieces):
        return [mesh]
    return pieces
