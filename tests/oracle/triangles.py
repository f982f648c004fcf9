"""Distances of triangles in double precision: an oracle for the test in float32 that knows no special cases."""

from __future__ import annotations

from itertools import product

import numpy as np


def triangle_distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distances [m] of triangles, shape (N, 3, 3) each; 0 where they meet. Triangles without area are segments.

    The nearest points of two triangles that do not meet lie on two edges, or on a vertex and a face. They meet if an
    edge of one of them passes the other, or, in one plane, if edges cross or a vertex lies in a face.
    """
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    found = np.full(len(a), np.inf)
    for i, j in product(range(3), range(3)):
        found = np.minimum(found, _segments(a[:, i], a[:, (i + 1) % 3], b[:, j], b[:, (j + 1) % 3]))
    for one, other in ((a, b), (b, a)):
        for i in range(3):
            found = np.minimum(found, _point_to_face(one[:, i], other))
            found = np.where(_passes(one[:, i], one[:, (i + 1) % 3], other), 0.0, found)
    return found


def _dot(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", u, v)


def _point_to_segment(p: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    along = b - a
    share = np.clip(_dot(p - a, along) / np.maximum(_dot(along, along), 1e-300), 0.0, 1.0)
    return np.linalg.norm(p - a - share[:, None] * along, axis=1)


def _segments(p: np.ndarray, p1: np.ndarray, q: np.ndarray, q1: np.ndarray) -> np.ndarray:
    """Least of the four distances of ends to the other segment, and of that of the lines where both feet lie inside."""
    ends = [_point_to_segment(p, q, q1), _point_to_segment(p1, q, q1)]
    ends += [_point_to_segment(q, p, p1), _point_to_segment(q1, p, p1)]
    best = np.minimum.reduce(ends)
    d, e, r = p1 - p, q1 - q, q - p
    n = np.cross(d, e)
    nn = _dot(n, n)
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = _dot(np.cross(r, e), n) / nn, _dot(np.cross(r, d), n) / nn
        lines = np.abs(_dot(r, n)) / np.sqrt(nn)
        inside = (nn > 1e-28 * _dot(d, d) * _dot(e, e)) & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    return np.where(inside, np.minimum(best, np.where(inside, lines, np.inf)), best)


def _normals(face: np.ndarray) -> np.ndarray:
    """Normals from the two edges at the vertex opposite of the longest one, so that a short edge is exact."""
    edges = np.roll(face, -1, axis=1) - face
    longest = np.argmax(np.einsum("ijk,ijk->ij", edges, edges), axis=1)
    rows = np.arange(len(face))
    return np.cross(edges[rows, (longest + 1) % 3], edges[rows, (longest + 2) % 3])


def _over(p: np.ndarray, face: np.ndarray, n: np.ndarray) -> np.ndarray:
    sides = [_dot(np.cross(face[:, (i + 1) % 3] - face[:, i], p - face[:, i]), n) >= 0.0 for i in range(3)]
    return np.logical_and.reduce(sides) & (_dot(n, n) > 0.0)


def _point_to_face(p: np.ndarray, face: np.ndarray) -> np.ndarray:
    n = _normals(face)
    height = np.abs(_dot(p - face[:, 0], n)) / np.maximum(np.linalg.norm(n, axis=1), 1e-300)
    return np.where(_over(p, face, n), height, np.inf)


def _passes(p: np.ndarray, q: np.ndarray, face: np.ndarray) -> np.ndarray:
    n = _normals(face)
    hp, hq = _dot(p - face[:, 0], n), _dot(q - face[:, 0], n)
    with np.errstate(divide="ignore", invalid="ignore"):
        through = p + (q - p) * (hp / (hp - hq))[:, None]
    return (hp * hq < 0.0) & _over(np.nan_to_num(through), face, n)
