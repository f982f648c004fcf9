"""Reads mesh files (OBJ, STL, PLY, OFF, GLB, glTF, and DAE with pycollada) and URDF files."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import trimesh
from trimesh.resolvers import FilePathResolver

from sceniris_gym.errors import MeshError, NotSupportedError, SceneFileError, check_names, import_extra
from sceniris_gym.files import opened
from sceniris_gym.geometry.rotations import matrix, of_angles
from sceniris_gym.importers.things.thing import GREY, LEAST_MOMENT, Inertia, Joint, Link, Surface, Thing
from sceniris_gym.scene.model_files import file_of

SUFFIXES = (".obj", ".stl", ".ply", ".off", ".glb", ".gltf", ".dae")
"""Suffixes of mesh files."""
# Metres per unit and up axis where the format fixes them. glTF prescribes both. trimesh converts DAE to metres, z up.
_FRAMES = {".glb": (1.0, "y"), ".gltf": (1.0, "y"), ".dae": (1.0, "z")}


def read_mesh(path: Path) -> Thing:
    """Read a mesh file as an object with one link, in the file's unit and axes.

    Raises:
        SceneFileError: The file cannot be read.
        MeshError: The file has non-finite vertices.
        MissingExtraError: The file is DAE, and pycollada is not installed.
    """
    meters, up = _FRAMES.get(path.suffix.lower(), (None, None))
    return Thing(path.stem, (Link(path.stem, surfaces=read_surfaces(path)),), meters, up)


def read_surfaces(path: Path) -> tuple[Surface, ...]:
    """Read the surfaces of a mesh file, one for each mesh and material. Raises the same errors as `read_mesh`."""
    if path.suffix.lower() == ".dae":
        import_extra("collada", "import", "pycollada")
    try:
        beside = _Beside(str(path))
        # When trimesh merges vertices, it silently drops non-finite ones. Load without merging to find them.
        loaded = trimesh.load_scene(path, resolver=beside, process=False).geometry.values()
        raw = [mesh for mesh in loaded if isinstance(mesh, trimesh.Trimesh)]
        if not all(np.isfinite(mesh.vertices).all() for mesh in raw):
            raise MeshError(f"{path}: it has non-finite vertices. Export it again.", "not finite")
        scene = trimesh.load_scene(path, resolver=beside)
        found = []
        for node in scene.graph.nodes_geometry:
            pose, name = scene.graph[node]
            mesh = scene.geometry[name]
            if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
                found.append(_surface(mesh, np.asarray(pose, float)))
    except (MemoryError, MeshError):
        raise
    except Exception as error:  # each of trimesh's readers raises different errors
        if path.suffix.lower() not in SUFFIXES:
            raise SceneFileError(f"{path}: it should be a mesh file that ends in {', '.join(SUFFIXES)}.") from None
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise SceneFileError(
            f"{path}: it cannot be read as {path.suffix[1:].upper()}: {reason:.200}. Export it again."
        ) from None
    return tuple(found)


class _Beside(FilePathResolver):
    """Lets trimesh open the files that a mesh file names, such as materials and buffers. Rejects pipes and devices."""

    def get(self, name: str) -> Any:
        """Return the contents of the file `name` in the mesh's folder."""
        opened(Path(self.parent, name.strip())).close()
        return super().get(name)


def _surface(mesh: trimesh.Trimesh, pose: np.ndarray) -> Surface:
    rgba, texture, uv = _look(mesh.visual)
    if uv is not None and len(uv) != len(mesh.vertices):
        texture = uv = None
    surface = Surface(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, int), rgba, texture, uv)
    return surface.moved(pose[:3, :3], pose[:3, 3])


def _look(visual: Any) -> tuple[tuple[float, ...], Any, np.ndarray | None]:
    """Return the colour, texture image and texture coordinates of `Trimesh.visual`. The last two may be None."""
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


_JOINTS = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide"}
_MOMENTS = ("ixx", "ixy", "ixz", "ixy", "iyy", "iyz", "ixz", "iyz", "izz")


def read_urdf(path: Path) -> Thing:
    """Read a URDF file as an object with all its links.

    Paths of meshes are relative to the URDF file. A path that starts with `package://` or `model://` is searched in the
    folders above the URDF file.

    Raises:
        SceneFileError: The file is not a URDF file, its links do not form a tree, or meshes are missing.
        NotSupportedError: The file has a floating or planar joint, or a shape that URDF does not define.
    """
    try:
        robot = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, UnicodeDecodeError, OSError) as error:
        raise SceneFileError(f"{path}: it cannot be read as XML: {error}. Correct it, or export it again.") from None
    if robot.tag != "robot":
        raise SceneFileError(f"{path}: its root element should be <robot>, got <{robot.tag}>. Give a URDF file.")
    folder = path.absolute().parent  # a relative path may lack the folders above it
    meshes = {mesh.get("filename", ""): file_of(mesh.get("filename", ""), folder) for mesh in robot.iter("mesh")}
    missing = [name for name, found in meshes.items() if found is None]
    if missing:
        raise SceneFileError(
            f"{path}: {len(missing)} mesh paths do not exist or are not files: {', '.join(missing[:5])}"
            f"{', ...' if len(missing) > 5 else ''}. Put the meshes at these paths, relative to the URDF file or below "
            "a folder with the package's name."
        )
    colours = {material.get("name", ""): rgba for material in robot.iter("material") if (rgba := _rgba_of(material))}
    links = {link.get("name", ""): _link(path, link, colours) for link in robot.findall("link")}
    joints = robot.findall("joint")
    mimics = [joint.get("name") for joint in joints if joint.find("mimic") is not None]
    notes = [f"the joint '{name}' mimics another joint in the file, but moves freely here" for name in mimics]
    ordered = tuple(_in_order(path, links, joints))
    return Thing(robot.get("name") or path.stem, ordered, 1.0, "z", tuple(notes))


def _link(path: Path, element: ElementTree.Element, colours: dict[str, tuple[float, ...]]) -> Link:
    surfaces, solids = (
        tuple(surface for shape in element.findall(kind) for surface in _shape(path, shape, colours))
        for kind in ("visual", "collision")
    )
    inertia = _inertia(element.find("inertial"))
    return Link(element.get("name", ""), surfaces=surfaces or solids, solids=solids, inertia=inertia)


def _in_order(path: Path, links: dict[str, Link], joints: list[ElementTree.Element]) -> Iterator[Link]:
    """Yield links with their joints, parents before children."""
    children: dict[str, list[tuple[str, ElementTree.Element]]] = {}
    for joint in joints:
        ends = [end.get("link", "") if (end := joint.find(kind)) is not None else "" for kind in ("parent", "child")]
        check_names("link", ends, f"{path}: joint '{joint.get('name')}'", links)
        children.setdefault(ends[0], []).append((ends[1], joint))
    hanging = {child for below in children.values() for child, _ in below}
    roots = [name for name in links if name not in hanging]
    if not links:
        raise SceneFileError(f"{path}: it has no links. Add a <link> with a mesh, a box or another shape.")
    if len(roots) != 1:
        wrong = f"{len(roots)} roots: {', '.join(roots[:5])}" if roots else "a cycle"
        raise SceneFileError(f"{path}: joints should connect all links to one root, got {wrong}. Correct the joints.")
    waiting = [links[roots[0]]]
    while waiting:
        yield (link := waiting.pop(0))
        for name, joint in children.get(link.name, []):
            pos, quat = _origin(joint)
            waiting.append(replace(links[name], parent=link.name, pos=pos, quat=quat, joint=_joint(path, joint)))


def _joint(path: Path, element: ElementTree.Element) -> Joint | None:
    name, kind = element.get("name", ""), element.get("type", "")
    if kind == "fixed":
        return None
    if kind not in _JOINTS:
        raise NotSupportedError(
            f"{path}: joint '{name}' should be revolute, continuous, prismatic or fixed, got '{kind}'."
        )
    axis, limit = element.find("axis"), element.find("limit")
    limits = None
    if limit is not None and kind != "continuous":
        low, high = float(limit.get("lower", 0.0)), float(limit.get("upper", 0.0))
        limits = (low, high) if low < high else None
    return Joint(name, _JOINTS[kind], _floats(None if axis is None else axis.get("xyz"), (1, 0, 0)), limits)


def _shape(path: Path, element: ElementTree.Element, colours: dict[str, tuple[float, ...]]) -> Iterator[Surface]:
    geometry, material = element.find("geometry"), element.find("material")
    if geometry is None or not len(geometry):
        return
    pos, quat = _origin(element)
    shape = geometry[0]
    if shape.tag == "mesh":
        found = file_of(shape.get("filename", ""), path.absolute().parent)
        assert found is not None
        scale = np.diag(_floats(shape.get("scale"), (1, 1, 1)))
        surfaces = [surface.moved(scale) for surface in read_surfaces(found)]
    else:
        if shape.tag == "box":
            made = trimesh.creation.box(_floats(shape.get("size"), (1, 1, 1)))
        elif shape.tag == "sphere":
            made = trimesh.creation.icosphere(subdivisions=3, radius=float(shape.get("radius", 1.0)))
        elif shape.tag in ("cylinder", "capsule"):
            make = getattr(trimesh.creation, shape.tag)
            made = make(radius=float(shape.get("radius", 1.0)), height=float(shape.get("length", 1.0)))
        else:
            raise NotSupportedError(
                f"{path}: a geometry should be box, sphere, cylinder, capsule or mesh, got <{shape.tag}>."
            )
        surfaces = [Surface(np.asarray(made.vertices), np.asarray(made.faces))]
    rgba = None if material is None else _rgba_of(material) or colours.get(material.get("name", ""))
    for surface in surfaces:
        own = surface if rgba is None or surface.texture is not None else replace(surface, rgba=rgba)
        yield own.moved(matrix(quat), pos)


def _rgba_of(material: ElementTree.Element) -> tuple[float, ...] | None:
    colour = material.find("color")
    return None if colour is None else tuple(_floats(colour.get("rgba"), GREY))


def _inertia(element: ElementTree.Element | None) -> Inertia | None:
    mass, inertia = (None, None) if element is None else (element.find("mass"), element.find("inertia"))
    if element is None or mass is None or inertia is None:
        return None
    pos, quat = _origin(element)
    rotation = matrix(quat)
    full = rotation @ np.reshape([float(inertia.get(name, 0.0)) for name in _MOMENTS], (3, 3)) @ rotation.T
    value = float(mass.get("value", 0.0))
    least, middle, most = np.linalg.eigvalsh(full)
    if value <= 0.0 or least <= LEAST_MOMENT or least + middle < most:
        return None  # physically impossible: the inertia is computed from the shape instead
    return Inertia(value, pos, full)


def _origin(element: ElementTree.Element) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose in the `<origin>` of a URDF element: position and orientation (wxyz)."""
    origin = element.find("origin")
    attributes = {} if origin is None else origin.attrib
    return _floats(attributes.get("xyz"), (0, 0, 0)), of_angles(_floats(attributes.get("rpy"), (0, 0, 0)))


def _floats(text: str | None, default: tuple[float, ...]) -> np.ndarray:
    return np.array(default if not text else [float(word) for word in text.split()], float)
