"""Things as they are read from a file of any format, a tree of links with surfaces and solids, and written as MJCF."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
from PIL.Image import Image

from sceniris_gym.geometry.rotations import matrix, quaternion
from sceniris_gym.importers.things.grasps import GraspSite

GREY = (0.7, 0.7, 0.7, 1.0)
LEAST_MOMENT = 1e-14
"""Moments of inertia that are no larger than this [kg m^2] are none to MuJoCo."""


@dataclass(frozen=True)
class Surface:
    """Triangles that look alike.

    Attributes:
        vertices: In the frame of its link, shape (n, 3).
        faces: Indices of vertices, counterclockwise as seen from outside, shape (m, 3).
        rgba: Its colour, each component from 0 to 1.
        texture: The image that is mapped onto it.
        uv: Texture coordinates of the vertices, origin at the bottom left, shape (n, 2).
    """

    vertices: np.ndarray
    faces: np.ndarray
    rgba: tuple[float, ...] = GREY
    texture: Image | None = None
    uv: np.ndarray | None = None

    def moved(self, turn: np.ndarray, shift: np.ndarray | float = 0.0) -> Surface:
        """Return the surface with its vertices times a matrix, shape (3, 3), which may mirror, then shifted."""
        faces = self.faces[:, ::-1] if np.linalg.det(turn) < 0.0 else self.faces
        return replace(self, vertices=self.vertices @ turn.T + shift, faces=faces)


@dataclass(frozen=True)
class Joint:
    """A joint between a link and its parent, about or along an axis through the link's origin.

    Attributes:
        name: Its name.
        type: "hinge" or "slide".
        axis: In the link's frame, shape (3,).
        range: Its limits [rad, or the unit of length]; None without limits.
    """

    name: str
    type: str
    axis: np.ndarray
    range: tuple[float, float] | None


@dataclass(frozen=True)
class Inertia:
    """Mass [kg], centre of mass, and the inertia matrix about it in the link's axes, shape (3, 3)."""

    mass: float
    center: np.ndarray
    matrix: np.ndarray

    @property
    def least(self) -> float:
        """The least of its principal moments [kg m^2]."""
        return float(np.linalg.eigvalsh(self.matrix)[0])


@dataclass(frozen=True)
class Link:
    """A rigid part of a thing.

    Attributes:
        name: Its name.
        parent: The link that it hangs on; None for the root.
        pos: Its origin in its parent's frame, shape (3,).
        quat: Its orientation there, wxyz.
        joint: The joint to its parent; None if it is fixed.
        surfaces: Its visual surfaces.
        solids: Its collision surfaces, if the file has any; else the visual ones serve as such.
        inertia: Its inertia, if the file gives it.
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
        """The surfaces that collision geometry is made for."""
        return self.solids or self.surfaces

    def moved(self, turn: np.ndarray, shift: np.ndarray | float = 0.0) -> Link:
        """Return the link with each of its surfaces moved, in its own frame."""
        surfaces, solids = (tuple(s.moved(turn, shift) for s in kind) for kind in (self.surfaces, self.solids))
        return replace(self, surfaces=surfaces, solids=solids)


@dataclass(frozen=True)
class Thing:
    """A thing as its file describes it.

    Attributes:
        name: Its name.
        links: Its links, parents before their children; the first is the root.
        meters: Metres for each unit of length; None if the file does not say.
        up: The axis that points up, "x", "y" or "z"; None if the file does not say.
        notes: Remarks on parts of the file that were interpreted differently, or left out.
    """

    name: str
    links: tuple[Link, ...]
    meters: float | None = None
    up: str | None = None
    notes: tuple[str, ...] = ()

    def points(self) -> np.ndarray:
        """Return all vertices with joints at zero, in the frame of the root, shape (n, 3)."""
        frames: dict[str | None, tuple[np.ndarray, np.ndarray]] = {None: (np.eye(3), np.zeros(3))}
        found = [np.zeros((0, 3))]
        for link in self.links:
            turn, at = frames[link.parent]
            frames[link.name] = turn, at = turn @ matrix(link.quat), at + turn @ link.pos
            found += [at + surface.vertices @ turn.T for surface in (*link.surfaces, *link.solids)]
        return np.concatenate(found)

    def extents(self) -> np.ndarray:
        """Return the lengths of its bounds along its axes, shape (3,)."""
        return np.ptp(points, axis=0) if len(points := self.points()) else np.zeros(3)

    def scaled(self, factor: float) -> Thing:
        """Return the thing in another unit of length; masses stay as they are."""
        return replace(self, links=tuple(_scaled(link, factor) for link in self.links))

    def moved(self, turn: np.ndarray, shift: np.ndarray) -> Thing:
        """Return the thing turned by `turn` (3, 3), then shifted by `shift` (3,), in the frame of its root.

        The root link's frame stays at the origin, so what belongs to the root is moved itself.
        """
        root, *rest = self.links
        inertia = root.inertia
        if inertia is not None:
            inertia = Inertia(inertia.mass, turn @ inertia.center + shift, turn @ inertia.matrix @ turn.T)
        moved = replace(root.moved(turn, shift), inertia=inertia)
        children = [
            link
            if link.parent != root.name
            else replace(link, pos=turn @ link.pos + shift, quat=quaternion(turn @ matrix(link.quat)))
            for link in rest
        ]
        return replace(self, links=(moved, *children))


def _scaled(link: Link, factor: float) -> Link:
    joint, inertia = link.joint, link.inertia
    if joint is not None and joint.type == "slide" and joint.range is not None:
        joint = replace(joint, range=(joint.range[0] * factor, joint.range[1] * factor))
    if inertia is not None:
        inertia = Inertia(inertia.mass, inertia.center * factor, inertia.matrix * factor**2)
    return replace(link.moved(factor * np.eye(3)), pos=link.pos * factor, joint=joint, inertia=inertia)


_JOINT = {"damping": "0.05", "frictionloss": "0.05"}  # so that a door or drawer stays about where it was left


def write_asset(thing: Thing, grasps: Sequence[GraspSite], path: Path) -> list[Path]:
    """Write `path` and the folder of the same name beside it.

    File names in the folder begin with the asset's name, as a scene keeps all of them in one place.

    Args:
        thing: The thing in metres, z up, its root's origin at the asset's; solids of links are their convex parts, and
            each link has an inertia.
        grasps: Grasps in the frame of its root.
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
    taken = {"world"}  # MuJoCo's own body
    for link in thing.links:
        pose = {} if link.parent is None else {"pos": _text(link.pos), "quat": _text(link.quat)}
        body = name if link.parent is None else link.name
        while body in taken:
            body += "_"
        taken.add(body)
        element = add(elements[link.parent], "body", {"name": body, **pose})
        elements[link.name] = element
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
    # MuJoCo caches meshes by path and modification time in seconds: it would mistake these for those of an earlier
    # draft that was written just before.
    mujoco.mj_clearCache(mujoco.mj_getCache())
    return [path, *writer.files]


class _Writer:
    """Numbers the meshes, materials and pictures of an asset, and writes them."""

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
        """Write a surface as a mesh of this name, and add a geom of it to a body."""
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
