"""An imported object as a tree of links, as the readers of all file formats return it, and its export to MJCF."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Any, Self
from xml.etree import ElementTree

import mujoco
import numpy as np
from PIL.Image import Image

from sceniris_gym.geometry.rotations import matrix, quaternion
from sceniris_gym.importers.things.grasps import GraspSite

GREY = (0.7, 0.7, 0.7, 1.0)
LEAST_MOMENT = 1e-14
"""MuJoCo rejects moments of inertia up to this limit [kg m^2]."""


@dataclass(frozen=True)
class Surface:
    """Triangles with the same colour or texture.

    Attributes:
        vertices: Vertices in the link's frame, shape (n, 3).
        faces: Vertex indices, counterclockwise as seen from outside, shape (m, 3).
        rgba: Colour, each component from 0 to 1.
        texture: Image mapped onto the triangles, or None.
        uv: Texture coordinates of the vertices, origin at the bottom left, shape (n, 2), or None.
    """

    vertices: np.ndarray
    faces: np.ndarray
    rgba: tuple[float, ...] = GREY
    texture: Image | None = None
    uv: np.ndarray | None = None

    def moved(self, rotation: np.ndarray, shift: np.ndarray | float = 0.0) -> Self:
        """Return the surface with each vertex multiplied by `rotation`, any matrix (3, 3), and shifted by `shift`."""
        # A matrix that mirrors turns the faces inside out, so their vertex order is reversed.
        faces = self.faces[:, ::-1] if np.linalg.det(rotation) < 0.0 else self.faces
        return replace(self, vertices=self.vertices @ rotation.T + shift, faces=faces)


@dataclass(frozen=True)
class Joint:
    """A joint between a link and its parent. The axis of the joint passes through the link's origin.

    Attributes:
        name: Name of the joint.
        type: "hinge" or "slide".
        axis: Axis in the link's frame, shape (3,).
        range: Limits, or None if unlimited [rad for a hinge, the object's unit of length for a slide].
    """

    name: str
    type: str
    axis: np.ndarray
    range: tuple[float, float] | None


@dataclass(frozen=True)
class Inertia:
    """Mass [kg], centre of mass in the link's frame, and inertia matrix about it along the link's axes, (3, 3)."""

    mass: float
    center: np.ndarray
    matrix: np.ndarray


@dataclass(frozen=True)
class Link:
    """A rigid part of an object.

    Attributes:
        name: Name of the link.
        parent: Name of the parent link, or None for the root.
        pos: Origin in the parent's frame, shape (3,).
        quat: Orientation in the parent's frame, wxyz.
        joint: Joint to the parent, or None if the link is fixed to it.
        surfaces: Visual surfaces.
        solids: Collision surfaces. If empty, the visual surfaces are used for collision too.
        inertia: Inertia of the link. None if the file has no usable inertia.
    """

    name: str
    parent: str | None = None
    pos: np.ndarray = field(default_factory=lambda: np.zeros(3))
    quat: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    joint: Joint | None = None
    surfaces: tuple[Surface, ...] = ()
    solids: tuple[Surface, ...] = ()
    inertia: Inertia | None = None

    @property
    def touched(self) -> tuple[Surface, ...]:
        """The surfaces that define the collision geometry: `solids`, or `surfaces` if there are no solids."""
        return self.solids or self.surfaces

    def moved(self, rotation: np.ndarray, shift: np.ndarray | float = 0.0) -> Self:
        """Return the link with all its surfaces moved by `Surface.moved`. The link's frame and inertia stay."""
        surfaces, solids = (tuple(s.moved(rotation, shift) for s in kind) for kind in (self.surfaces, self.solids))
        return replace(self, surfaces=surfaces, solids=solids)


@dataclass(frozen=True)
class Thing:
    """An object as its file describes it, in the unit of length and the axes of the file.

    Attributes:
        name: Name of the object.
        links: Links, parents before their children. The first link is the root.
        meters: Metres per unit of length, or None if the file does not specify a unit.
        up: The axis that points up, "x", "y" or "z", or None if the file does not specify an axis.
        notes: Sentences about parts of the file that were changed or left out.
    """

    name: str
    links: tuple[Link, ...]
    meters: float | None = None
    up: str | None = None
    notes: tuple[str, ...] = ()

    def points(self) -> np.ndarray:
        """Return the vertices that all links touch with, in the root's frame, with joints at zero, shape (n, 3)."""
        frames: dict[str | None, tuple[np.ndarray, np.ndarray]] = {None: (np.eye(3), np.zeros(3))}
        found = [np.zeros((0, 3))]
        for link in self.links:
            rotation, at = frames[link.parent]
            frames[link.name] = rotation, at = rotation @ matrix(link.quat), at + rotation @ link.pos
            found += [at + surface.vertices @ rotation.T for surface in link.touched]
        return np.concatenate(found)

    def extents(self) -> np.ndarray:
        """Return the edge lengths of the object's bounding box along the root's axes, shape (3,)."""
        return np.ptp(points, axis=0) if len(points := self.points()) else np.zeros(3)

    def scaled(self, factor: float) -> Self:
        """Return the object with all lengths multiplied by a factor. Masses do not change."""
        return replace(self, links=tuple(_scaled(link, factor) for link in self.links))

    def moved(self, rotation: np.ndarray, shift: np.ndarray) -> Self:
        """Return the object rotated by `rotation` (3, 3) and then shifted by `shift` (3,), in the root's frame.

        The root's frame stays at the origin. Instead, the root's surfaces and inertia and its child links move.
        """
        root, *rest = self.links
        inertia = root.inertia
        if inertia is not None:
            inertia = Inertia(inertia.mass, rotation @ inertia.center + shift, rotation @ inertia.matrix @ rotation.T)
        moved = replace(root.moved(rotation, shift), inertia=inertia)

        def attached(link: Link) -> Link:
            return replace(link, pos=rotation @ link.pos + shift, quat=quaternion(rotation @ matrix(link.quat)))

        children = [attached(link) if link.parent == root.name else link for link in rest]
        return replace(self, links=(moved, *children))


def _scaled(link: Link, factor: float) -> Link:
    joint, inertia = link.joint, link.inertia
    if joint is not None and joint.type == "slide" and joint.range is not None:
        joint = replace(joint, range=(joint.range[0] * factor, joint.range[1] * factor))
    if inertia is not None:
        inertia = Inertia(inertia.mass, inertia.center * factor, inertia.matrix * factor**2)
    return replace(link.moved(factor * np.eye(3)), pos=link.pos * factor, joint=joint, inertia=inertia)


_JOINT = {"damping": "0.05", "frictionloss": "0.05"}  # so that a door or drawer stays where it is released


def write_asset(thing: Thing, grasps: Sequence[GraspSite], path: Path) -> list[Path]:
    """Write an MJCF file, and its meshes and images into a folder of the same name next to the file.

    The name of each file in the folder starts with the asset's name, because a scene keeps the files of all its assets
    in one dictionary, `MjSpec.assets`.

    Args:
        thing: The object in metres, z up, with its root at the asset's origin. The solids of each link are its convex
            parts, and each link has an inertia.
        grasps: Grasps in the root's frame.
        path: The MJCF file.

    Returns:
        All files that were written.
    """
    name, folder = path.stem, path.parent / path.stem
    folder.mkdir(parents=True, exist_ok=True)
    root = ElementTree.Element("mujoco", model=name)
    add = ElementTree.SubElement
    add(root, "compiler", angle="radian", meshdir=name, texturedir=name, autolimits="true")
    default = add(root, "default")
    add(add(default, "default", {"class": "visual"}), "geom", type="mesh", group="2", contype="0", conaffinity="0")
    collision = add(default, "default", {"class": "collision"})
    add(collision, "geom", type="mesh", group="3", friction="0.8 0.005 0.0001", rgba="0.3 0.6 0.9 0.5")
    asset, world = add(root, "asset"), add(root, "worldbody")
    writer = _Writer(folder, asset)
    elements: dict[str | None, ElementTree.Element] = {None: world}
    taken = {"world"}  # reserved by MuJoCo
    for link in thing.links:
        pose = {} if link.parent is None else {"pos": _text(link.pos), "quat": _text(link.quat)}
        body = name if link.parent is None else link.name
        while body in taken:
            body += "_"
        taken.add(body)
        elements[link.name] = element = add(elements[link.parent], "body", {"name": body, **pose})
        if link.joint is not None:
            add(element, "joint", _joint(link.joint))
        assert link.inertia is not None
        add(element, "inertial", _inertial(link.inertia))
        for surface in link.surfaces:
            writer.surface(element, surface)
        for part in link.solids:
            writer.part(element, part)
    for k, grasp in enumerate(grasps):
        pose = {"pos": _text(grasp.pos), "quat": _text(grasp.quat)}
        add(elements[thing.links[0].name], "site", {"name": f"grasp_{k}", "size": "0.005", "group": "4", **pose})
    ElementTree.indent(root)
    path.write_text(ElementTree.tostring(root, encoding="unicode") + "\n")
    # MuJoCo caches meshes by path and modification time in seconds. Without this call, it could load the meshes of an
    # earlier draft written in the same second.
    mujoco.mj_clearCache(mujoco.mj_getCache())
    return [path, *writer.files]


class _Writer:
    """Writes the meshes and images of an asset, and adds their MJCF elements under numbered names."""

    def __init__(self, folder: Path, asset: ElementTree.Element) -> None:
        self._folder, self._asset = folder, asset
        self._surfaces, self._parts = count(), count()
        self._materials: dict[tuple, str] = {}
        self.files: list[Path] = []

    def surface(self, body: ElementTree.Element, surface: Surface) -> None:
        number = next(self._surfaces)
        looks = {"class": "visual", "material": self._material(surface)}
        self._mesh(body, surface, f"visual_{number}", str(number), looks, inertia="shell")

    def part(self, body: ElementTree.Element, part: Surface) -> None:
        name = f"part_{next(self._parts)}"
        self._mesh(body, part, name, name, {"class": "collision"})

    def _mesh(
        self, body: ElementTree.Element, surface: Surface, name: str, file: str, geom: dict[str, str], **mesh: Any
    ) -> None:
        """Write a surface as a mesh file, and add a geom with this mesh to a body."""
        lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in surface.vertices]
        if surface.uv is not None:
            lines += [f"vt {u:.7g} {v:.7g}" for u, v in surface.uv]
            lines += [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in surface.faces + 1]
        else:
            lines += [f"f {a} {b} {c}" for a, b, c in surface.faces + 1]
        path = self._folder / f"{self._folder.name}_{file}.obj"
        path.write_text("\n".join(lines) + "\n")
        self.files.append(path)
        ElementTree.SubElement(self._asset, "mesh", name=name, file=path.name, **mesh)
        ElementTree.SubElement(body, "geom", {"name": name, "mesh": name, **geom})

    def _material(self, surface: Surface) -> str:
        key = (id(surface.texture),) if surface.texture is not None else surface.rgba
        if key not in self._materials:
            self._materials[key] = name = f"surface_{len(self._materials)}"
            looks = {"rgba": _text(surface.rgba)}
            if surface.texture is not None:
                file = self._folder / f"{self._folder.name}_{name}.png"
                surface.texture.save(file)
                self.files.append(file)
                ElementTree.SubElement(self._asset, "texture", name=name, type="2d", file=file.name)
                looks["texture"] = name
            ElementTree.SubElement(self._asset, "material", {"name": name, **looks})
        return self._materials[key]


def _joint(joint: Joint) -> dict[str, str]:
    limits = {} if joint.range is None else {"range": _text(joint.range)}
    return {"name": joint.name, "type": joint.type, "axis": _text(joint.axis), **limits, **_JOINT}


def _inertial(inertia: Inertia) -> dict[str, str]:
    full = inertia.matrix[np.triu_indices(3)][[0, 3, 5, 1, 2, 4]]  # xx, yy, zz, xy, xz, yz
    return {"pos": _text(inertia.center), "mass": f"{inertia.mass:.9g}", "fullinertia": _text(full)}


def _text(values: Iterable[float]) -> str:
    return " ".join(f"{0.0 if abs(v) < 1e-15 else v:.9g}" for v in values)
