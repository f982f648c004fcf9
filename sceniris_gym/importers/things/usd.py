"""Reads the meshes and materials of a USD stage. Importing this module requires usd-core."""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image
from pxr import Ar, Tf, Usd, UsdGeom, UsdShade

from sceniris_gym.errors import NotSupportedError, SceneFileError
from sceniris_gym.importers.things.thing import GREY, Link, Surface, Thing


def read_usd(path: Path) -> Thing:
    """Read all visible meshes and primitives of a USD stage as an object with one link.

    Animated values are read at the earliest time. If the stage has several instances of a prototype, each is read.

    Raises:
        SceneFileError: The file cannot be read, or refers to a file that does not exist.
        NotSupportedError: The stage has a PointInstancer.
    """
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise SceneFileError(
            f"{path}: usd-core cannot read it. Export it again. Reason: {str(error).strip().splitlines()[-1]:.200}"
        ) from None
    if errors := stage.GetCompositionErrors():
        raise SceneFileError(
            f"{path}: the stage refers to a missing or invalid file: {str(errors[0]).strip(' .'):.300}. Put the file "
            "where the stage expects it, or export the stage as one file."
        )
    time, notes, found = Usd.TimeCode.EarliestTime(), [], []
    poses = UsdGeom.XformCache(time)
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if prim.IsA(UsdGeom.PointInstancer):
            raise NotSupportedError(
                f"{path}: '{prim.GetPath()}' is a PointInstancer, which is a scene and not an object. Export its "
                "prototype as a separate file, import that, and place the asset several times in a scene file."
            )
        if prim.HasAPI("PhysicsDriveAPI") or prim.GetTypeName() in ("PhysicsRevoluteJoint", "PhysicsPrismaticJoint"):
            notes.append(f"the joint '{prim.GetPath()}' is left out: the asset is one rigid body")
        if not prim.IsA(UsdGeom.Gprim) or UsdGeom.Imageable(prim).ComputeVisibility(time) == "invisible":
            continue
        if UsdGeom.Imageable(prim).ComputePurpose() not in ("default", "render"):
            continue
        pose = np.array(poses.GetLocalToWorldTransform(prim), float).T
        found += [surface.moved(pose[:3, :3], pose[:3, 3]) for surface in _surfaces(prim, time)]
    meters, up = UsdGeom.GetStageMetersPerUnit(stage), str(UsdGeom.GetStageUpAxis(stage)).lower()
    return Thing(path.stem, (Link(path.stem, surfaces=tuple(found)),), meters, up, tuple(notes))


def _surfaces(prim: Any, time: Any) -> Iterator[Surface]:
    """Yield the surface of a mesh or primitive, in the prim's frame. A prim without faces has no surface."""
    colours = UsdGeom.Gprim(prim).GetDisplayColorAttr().Get(time)
    rgba = (*(float(c) for c in np.mean(np.array(colours), axis=0)), 1.0) if colours else GREY
    if not prim.IsA(UsdGeom.Mesh):
        if (made := _primitive(prim, time)) is not None:
            yield Surface(np.asarray(made.vertices), np.asarray(made.faces), rgba)
        return
    mesh = UsdGeom.Mesh(prim)
    points = np.array(mesh.GetPointsAttr().Get(time) or np.zeros((0, 3)), float).reshape(-1, 3)
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(time) or [], int)
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get(time) or [], int)
    if not len(counts):
        return
    if corners.min(initial=0) < 0 or counts.sum() != len(corners) or corners.max(initial=-1) >= len(points):
        raise SceneFileError(
            f"{prim.GetStage().GetRootLayer().realPath}: faces of '{prim.GetPath()}' refer to vertices that do "
            "not exist. Export it again."
        )
    triangles = _fans(counts)
    if mesh.GetOrientationAttr().Get(time) == "leftHanded":
        triangles = triangles[:, ::-1]
    colour, texture = _material(prim)
    uv = _coordinates(prim, time, corners, len(points)) if texture is not None else None
    if uv is not None:  # a separate vertex per corner of a face, because textures may have seams
        yield Surface(points[corners], triangles, (1.0, 1.0, 1.0, 1.0), texture, uv)
    else:
        yield Surface(points, corners[triangles], rgba if colour is None else colour)


def _fans(counts: np.ndarray) -> np.ndarray:
    """Split polygons into triangles that share the polygon's first corner.

    Args:
        counts: Number of corners of each polygon. The corners of all polygons are numbered in order.

    Returns:
        Numbers of the three corners of each triangle, shape (n, 3).
    """
    first = np.cumsum(counts) - counts
    fans = [first[counts > i + 2, None] + [0, i + 1, i + 2] for i in range(int(counts.max()) - 2)]
    return np.concatenate([*fans, np.zeros((0, 3), int)])


def _primitive(prim: Any, time: Any) -> Any:
    def value(name: str) -> Any:
        return prim.GetAttribute(name).Get(time)

    if prim.IsA(UsdGeom.Cube):
        return trimesh.creation.box([value("size")] * 3)
    if prim.IsA(UsdGeom.Sphere):
        return trimesh.creation.icosphere(subdivisions=3, radius=value("radius"))
    if not (prim.IsA(UsdGeom.Cylinder) or prim.IsA(UsdGeom.Cone) or prim.IsA(UsdGeom.Capsule)):
        return None
    make = getattr(trimesh.creation, prim.GetTypeName().lower())
    made = make(radius=value("radius"), height=value("height"))
    if prim.IsA(UsdGeom.Cone):
        made.apply_translation([0.0, 0.0, -0.5 * value("height")])
    rotation = {"X": [[0, 0, 1], [1, 0, 0], [0, 1, 0]], "Y": [[0, 1, 0], [0, 0, 1], [1, 0, 0]]}.get(value("axis"))
    if rotation is not None:
        made.vertices = made.vertices @ np.array(rotation, float).T
    return made


def _material(prim: Any) -> tuple[tuple[float, ...] | None, Any]:
    """Return the colour and the image of a prim's diffuse material. At least one of them is None."""
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    shader = material.ComputeSurfaceSource()[0] if material else None
    diffuse = shader.GetInput("diffuseColor") if shader else None
    if not diffuse:
        return None, None
    for source in diffuse.GetConnectedSources()[0]:
        picture = UsdShade.Shader(source.source).GetInput("file")
        if picture and (image := _picture(picture.Get())) is not None:
            return None, image
    value = diffuse.Get()
    return (None if value is None else (*(float(c) for c in value), 1.0)), None


def _picture(asset: Any) -> Any:
    """Load the image at a USD asset path, also from inside a .usdz file. Return None if the image cannot be read."""
    if asset is None or not asset.resolvedPath:
        return None
    opened = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(asset.resolvedPath))
    if not opened:
        return None
    try:
        return Image.open(io.BytesIO(bytes(opened.GetBuffer()))).convert("RGB")
    except OSError:  # Pillow's UnidentifiedImageError is an OSError
        return None


def _coordinates(prim: Any, time: Any, corners: np.ndarray, npoint: int) -> np.ndarray | None:
    """Return texture coordinates of all face corners, shape (ncorner, 2), or None for a mesh without coordinates."""
    api = UsdGeom.PrimvarsAPI(prim)
    uv = next((api.GetPrimvar(name) for name in ("st", "UVMap", "uv", "st_0") if api.HasPrimvar(name)), None)
    values = None if uv is None else uv.ComputeFlattened(time)
    if values is None:
        return None
    found = np.array(values, float).reshape(-1, 2)
    if len(found) == len(corners):
        return found
    return found[corners] if len(found) == npoint else None
