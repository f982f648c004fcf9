"""Reads files of meshes: OBJ, STL, PLY, OFF, GLB and glTF, and DAE with pycollada."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.resolvers import FilePathResolver

from sceniris_gym.errors import MeshError, SceneFileError, import_extra
from sceniris_gym.files import opened
from sceniris_gym.importers.things.thing import GREY, Link, Surface, Thing

SUFFIXES = (".obj", ".stl", ".ply", ".off", ".glb", ".gltf", ".dae")
"""Suffixes of the files that are read."""
# Metres for each unit and the axis that points up, if known: glTF prescribes them, and trimesh converts DAE.
_FRAMES = {".glb": (1.0, "y"), ".gltf": (1.0, "y"), ".dae": (1.0, "z")}


def read_mesh(path: Path) -> Thing:
    """Read a file of meshes as a thing of one link; nothing is scaled or turned.

    Raises:
        SceneFileError: It cannot be read.
        MeshError: It has vertices that are not finite.
        MissingExtraError: It is a DAE file, and pycollada is not installed.
    """
    meters, up = _FRAMES.get(path.suffix.lower(), (None, None))
    return Thing(path.stem, (Link(path.stem, surfaces=read_surfaces(path)),), meters, up)


def read_surfaces(path: Path) -> tuple[Surface, ...]:
    """Read the surfaces of a file of meshes, one for each of its materials; errors as in `read_mesh`."""
    if path.suffix.lower() == ".dae":
        import_extra("collada", "import", "pycollada")
    try:
        beside = _Beside(str(path))
        # When trimesh merges vertices, it silently drops those that are not finite, as if the file had holes.
        loaded = trimesh.load_scene(path, resolver=beside, process=False).geometry.values()
        raw = [mesh for mesh in loaded if isinstance(mesh, trimesh.Trimesh)]
        if not all(np.isfinite(mesh.vertices).all() for mesh in raw):
            raise MeshError(f"{path}: it has vertices that are not finite. Export it again.", "not finite")
        scene = trimesh.load_scene(path, resolver=beside)
        found = []
        for node in scene.graph.nodes_geometry:
            pose, name = scene.graph[node]
            mesh = scene.geometry[name]
            if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
                found.append(_surface(mesh, np.asarray(pose, float)))
    except (MemoryError, MeshError):
        raise
    except Exception as error:  # a reader of a dozen formats, each with errors of its own
        if path.suffix.lower() not in SUFFIXES:
            raise SceneFileError(
                f"{path}: it should be a file of meshes, whose name ends in {', '.join(SUFFIXES)}."
            ) from None
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise SceneFileError(
            f"{path}: it cannot be read as {path.suffix[1:].upper()}: {reason:.200}. Export it again."
        ) from None
    return tuple(found)


class _Beside(FilePathResolver):
    """The files that a mesh refers to, such as materials and buffers, but no pipes and no devices."""

    def get(self, name: str) -> Any:
        """Return the contents of one of them."""
        opened(Path(self.parent, name.strip())).close()
        return super().get(name)


def _surface(mesh: trimesh.Trimesh, pose: np.ndarray) -> Surface:
    rgba, texture, uv = _look(mesh.visual)
    if uv is not None and len(uv) != len(mesh.vertices):
        texture = uv = None
    surface = Surface(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, int), rgba, texture, uv)
    return surface.moved(pose[:3, :3], pose[:3, 3])


def _look(visual: Any) -> tuple[tuple[float, ...], Any, np.ndarray | None]:
    """Return the colour, the picture and the texture coordinates of a trimesh visual."""
    if visual.kind == "texture":
        material = visual.material
        image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        uv = None if visual.uv is None else np.asarray(visual.uv, float)
        if image is not None and uv is not None and np.isfinite(uv).all():
            return (1.0, 1.0, 1.0, 1.0), image.convert("RGB"), uv
        return _colour(material.main_color), None, None
    if visual.kind in ("face", "vertex") and visual.defined:
        colours = visual.face_colors if visual.kind == "face" else visual.vertex_colors
        return _colour(np.median(colours, axis=0)), None, None
    return GREY, None, None


def _colour(rgba: Any) -> tuple[float, ...]:
    values = np.asarray(rgba, float).ravel() / 255.0
    return tuple(float(v) for v in np.append(values[:3], values[3] if len(values) > 3 and values[3] > 0.0 else 1.0))
