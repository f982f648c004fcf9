"""Writes a thing as an asset: MJCF, and beside it a folder of meshes and pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import count
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from sceniris_gym.importers.things.grasps import GraspSite
from sceniris_gym.importers.things.thing import Inertia, Joint, Surface, Thing

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
