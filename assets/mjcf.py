"""One MJCF file per asset, written element by element."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np
import trimesh

from sceniris_gym.files import replacing

from .paths import mjcf_file
from .shapes import Mesh

Element = ET.Element


def text(value: object) -> str:
    """Format an attribute: numbers with nine significant digits, sequences separated by spaces."""
    if isinstance(value, str):
        return value
    if isinstance(value, Iterable):
        return " ".join(text(item) for item in value)
    if isinstance(value, bool):
        return "true" if value else "false"
    number = f"{round(float(value), 12):.9g}"  # pyrefly: ignore[bad-argument-type]
    return "0" if number == "-0" else number


def add(parent: Element, tag: str, **attributes: object) -> Element:
    """Append an element. A trailing underscore of an attribute's name is dropped (``class_``)."""
    return ET.SubElement(parent, tag, {name.rstrip("_"): text(value) for name, value in attributes.items()})


class Document:
    """The MJCF file of one asset: sections in MuJoCo's order, and one root body with the asset's name."""

    def __init__(self, name: str, friction: tuple[float, float, float] = (0.8, 0.005, 0.0001), **root: object):
        self.name = name
        self.tree = ET.Element("mujoco", {"model": name})
        add(self.tree, "compiler", angle="radian", meshdir="meshes", texturedir="meshes", autolimits=True)
        self.default = add(self.tree, "default")
        visual = add(self.default, "default", class_="visual")
        add(visual, "geom", type="mesh", group=2, contype=0, conaffinity=0)
        collision = add(self.default, "default", class_="collision")
        add(collision, "geom", type="mesh", group=3, friction=friction, rgba=(0.3, 0.6, 0.9, 0.5))
        self.asset = add(self.tree, "asset")
        self.root = add(add(self.tree, "worldbody"), "body", name=name, **root)

    def colour(
        self, name: str, rgb: tuple[float, float, float], shine: float = 0.3, texture: str | None = None
    ) -> None:
        """Add a material. ``texture`` is the name of a PNG file next to the meshes."""
        if texture is None:
            add(self.asset, "material", name=name, rgba=(*rgb, 1), specular=shine, shininess=shine)
            return
        add(self.asset, "texture", name=name, type="2d", file=texture)
        add(self.asset, "material", name=name, texture=name, specular=shine, shininess=shine)

    def mesh(self, name: str, file: str) -> None:
        """Add a mesh asset for ``meshes/<file>.obj``."""
        add(self.asset, "mesh", name=name, file=f"{file}.obj")

    def visual(self, body: Element, name: str, mesh: str, material: str, **more: object) -> None:
        """Add a visual geom."""
        add(body, "geom", name=name, class_="visual", mesh=mesh, material=material, **more)

    def collision(self, body: Element, name: str, mesh: str, **more: object) -> None:
        """Add a convex collision mesh."""
        add(body, "geom", name=name, class_="collision", mesh=mesh, **more)

    def collision_box(
        self, body: Element, name: str, low: Iterable[float], high: Iterable[float], **more: object
    ) -> None:
        """Add a collision box between two corners [m] in the body's frame."""
        low, high = np.asarray(list(low)), np.asarray(list(high))
        add(
            body, "geom", name=name, class_="collision", type="box", pos=(low + high) / 2, size=(high - low) / 2, **more
        )

    def save(self) -> None:
        """Write ``<name>.xml``."""
        ET.indent(self.tree, "  ")
        with replacing(mjcf_file(self.name)) as file:
            file.write_text(ET.tostring(self.tree, encoding="unicode") + "\n")


def inertial(body: Element, mesh: Mesh, mass: float) -> None:
    """Set the mass [kg] of ``body``, and its inertia from a homogeneous ``mesh`` in the body's frame."""
    shape = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    inertia = shape.moment_inertia * mass / shape.volume
    i, j = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    # The element comes first in its body, as is usual in MJCF files.
    element = ET.Element(
        "inertial", {"pos": text(shape.center_mass), "mass": text(mass), "fullinertia": text(inertia[i, j])}
    )
    body.insert(0, element)
