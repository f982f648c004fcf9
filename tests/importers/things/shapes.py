"""Things that tests import: made here, so that their volumes and shapes are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from sceniris_gym.importers.things.thing import Surface


def surface(mesh: trimesh.Trimesh) -> Surface:
    """A mesh as a surface."""
    return Surface(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, int))


def cup(radius: float = 0.04, height: float = 0.09, wall: float = 0.006) -> trimesh.Trimesh:
    """A cup without handle, open at the top, made by turning its outline; it stands on z = 0."""
    inner = radius - wall
    outline = np.array([[0, 0], [radius, 0], [radius, height], [inner, height], [inner, wall], [0, wall]])
    return trimesh.creation.revolve(outline, sections=24)


def apple(height: float = 0.11) -> trimesh.Trimesh:
    """An apple of 11 cm and 5,120 faces with a dimple for its stem, or a flatter fruit."""
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.055)
    x, y, z = mesh.vertices.T
    dimple = 0.12 * height * np.exp(-((np.hypot(x, y) / 0.012) ** 2)) * (z > 0.0)
    mesh.vertices = np.stack([x, y, z * height / 0.11 - dimple], axis=1)
    return mesh


def box(extents: tuple[float, float, float] = (0.04, 0.06, 0.1)) -> trimesh.Trimesh:
    """A box around the origin."""
    return trimesh.creation.box(extents)


def write(mesh: trimesh.Trimesh, path: Path) -> Path:
    """Write a mesh, and return its file."""
    mesh.export(path)
    return path
