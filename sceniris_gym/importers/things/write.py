"""Writes a thing as an asset: MJCF, and beside it a folder of meshes and pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from sceniris_gym.importers.things.grasps import GraspSite
from sceniris_gym.importers.things.thing import Inertia, Link, Surface, Thing

_JOINT = {"damping": "0.05", "frictionloss": "0.05"}  # so that a door or drawer stays about where it was left


@dataclass(frozen=True)
class Body:
    """What is written of a link: its convex parts as (vertices, faces) [m], and its inertia."""

    parts: Sequence[tuple[np.ndarray, np.ndarray]]
    inertia: Inertia


def write_asset(thing: Thing, bodies: Sequence[Body], grasps: Sequence[GraspSite], path: Path) -> list[Path]:
    """Write `path` and the folder of the same name beside it.

    File names in the folder begin with the asset's name, as a scene keeps all of them in one place.

    Args:
        thing: The thing, in metres, z up, its root's origin where that of the asset is to be.
        bodies: For each of its links; links without surfaces have no parts.
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
    writer = _Writer(name, folder, asset)
    elements: dict[str | None, ElementTree.Element] = {None: world}
    for i, (link, body) in enumerate(zip(thing.links, bodies, strict=True)):
        pose = {} if i == 0 else {"pos": _text(link.pos), "quat": _text(link.quat)}
        element = add(elements[link.parent], "body", {"name": name if i == 0 else link.name, **pose})
        elements[link.name] = element
        _add_joint(element, link)
        _add_inertia(element, body.inertia)
        for surface in link.surfaces:
            writer.surface(element, surface)
        for vertices, faces in body.parts:
            writer.part(element, vertices, faces)
        if i == 0:
            for k, grasp in enumerate(grasps):
                pose = {"pos": _text(grasp.pos), "quat": _text(grasp.quat)}
                add(element, "site", {"name": f"grasp_{k}", "size": "0.005", "group": "4", **pose})
    ElementTree.indent(root)
    path.write_text(ElementTree.tostring(root, encoding="unicode") + "\n")
    return [path, *writer.files]


class _Writer:
    """Numbers the meshes, materials and pictures of an asset, and writes them."""

    def __init__(self, name: str, folder: Path, asset: ElementTree.Element) -> None:
        self._name, self._folder, self._asset = name, folder, asset
        self._surfaces = self._parts = 0
        self._materials: dict[tuple, str] = {}
        self.files: list[Path] = []

    def surface(self, body: ElementTree.Element, surface: Surface) -> None:
        number, self._surfaces = self._surfaces, self._surfaces + 1
        file = self._obj(f"{self._name}_{number}.obj", surface.vertices, surface.faces, surface.uv)
        ElementTree.SubElement(self._asset, "mesh", name=f"visual_{number}", file=file, inertia="shell")
        looks = {"class": "visual", "mesh": f"visual_{number}", "material": self._material(surface)}
        ElementTree.SubElement(body, "geom", {"name": f"visual_{number}", **looks})

    def part(self, body: ElementTree.Element, vertices: np.ndarray, faces: np.ndarray) -> None:
        number, self._parts = self._parts, self._parts + 1
        file = self._obj(f"{self._name}_part_{number}.obj", vertices, faces)
        ElementTree.SubElement(self._asset, "mesh", name=f"part_{number}", file=file)
        ElementTree.SubElement(body, "geom", {"class": "collision"}, name=f"part_{number}", mesh=f"part_{number}")

    def _material(self, surface: Surface) -> str:
        key = (id(surface.texture),) if surface.texture is not None else surface.rgba
        if key not in self._materials:
            self._materials[key] = name = f"surface_{len(self._materials)}"
            looks = {"rgba": _text(surface.rgba)}
            if surface.texture is not None:
                file = self._folder / f"{self._name}_{name}.png"
                surface.texture.save(file)
                self.files.append(file)
                ElementTree.SubElement(self._asset, "texture", name=name, type="2d", file=file.name)
                looks["texture"] = name
            ElementTree.SubElement(self._asset, "material", {"name": name, **looks})
        return self._materials[key]

    def _obj(self, file: str, vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray | None = None) -> str:
        lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
        if uv is not None:
            lines += [f"vt {u:.7g} {v:.7g}" for u, v in uv]
            lines += [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in faces + 1]
        else:
            lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
        (self._folder / file).write_text("\n".join(lines) + "\n")
        self.files.append(self._folder / file)
        return file


def _add_joint(element: ElementTree.Element, link: Link) -> None:
    joint = link.joint
    if joint is not None:
        limits = {} if joint.range is None else {"range": _text(joint.range)}
        words = {"name": joint.name, "type": joint.type, "axis": _text(joint.axis), **limits, **_JOINT}
        ElementTree.SubElement(element, "joint", words)


def _add_inertia(element: ElementTree.Element, inertia: Inertia) -> None:
    xx, yy, zz, xy, xz, yz = inertia.moments
    full = _text((xx, yy, zz, xy, xz, yz))
    pose = {"pos": _text(inertia.center), "mass": f"{inertia.mass:.9g}", "fullinertia": full}
    ElementTree.SubElement(element, "inertial", pose)


def _text(values: Iterable[float]) -> str:
    return " ".join(f"{0.0 if abs(v) < 1e-15 else v:.9g}" for v in values)
