"""Mass and inertia of a homogeneous link: from its closed surface, or from its convex parts."""

from __future__ import annotations

import numpy as np

from sceniris_gym.importers.things.convex_parts import Parts
from sceniris_gym.importers.things.fit import height_over
from sceniris_gym.importers.things.repair import Solid
from sceniris_gym.importers.things.thing import Inertia

_CELLS = 40  # along the longest edge: the mass of a mug comes out within 3%


def inertia_of(solid: Solid, parts: Parts, density: float) -> Inertia:
    """Return the inertia of a homogeneous link.

    It is computed from the convex parts where the surface would not do: overlapping pieces would be counted twice, and
    a shell has no inside.

    Args:
        solid: Its surface [m].
        parts: Its convex parts.
        density: In kg/m^3.
    """
    mesh = solid.mesh
    if solid.closed and mesh.is_watertight and mesh.body_count == 1:
        full = np.asarray(mesh.moment_inertia) * density
        found = Inertia(float(mesh.volume) * density, np.asarray(mesh.center_mass), full)
        if found.mass > 0.0 and found.least > 0.0:
            return found
    return _of_cells(parts, density)


def _of_cells(parts: Parts, density: float) -> Inertia:
    """Return the inertia of all small cells whose centres are inside a part."""
    low = np.min([part.bounds[0] for part in parts.meshes], axis=0)
    high = np.max([part.bounds[1] for part in parts.meshes], axis=0)
    counts = np.maximum(np.ceil((high - low) / ((high - low).max() / _CELLS)).astype(int), 4)
    step = (high - low) / counts
    axes = [low[i] + step[i] * (np.arange(counts[i]) + 0.5) for i in range(3)]
    cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = np.zeros(len(cells), bool)
    for part in parts.meshes:
        near = ~inside & ((cells >= part.bounds[0]) & (cells <= part.bounds[1])).all(axis=1)
        inside[near] = height_over(part, cells[near]) <= 0.0
    points = cells[inside] if inside.any() else np.array([0.5 * (low + high)])
    each = density * float(step.prod())
    center = points.mean(axis=0)
    r = points - center
    own = each * len(points) * np.diag([(step**2).sum() - step[i] ** 2 for i in range(3)]) / 12.0
    return Inertia(each * len(points), center, each * ((r**2).sum() * np.eye(3) - r.T @ r) + own)
