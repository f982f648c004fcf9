"""The MJCF of one piece of furniture: boxes in its frame, parts on joints, handles with grasp sites."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from math import cos, sin
from typing import Any, Literal, NamedTuple

Point = tuple[float, float, float]
Hinge = Literal["left", "right", "top"]

_AXES = {"drawer": (0, -1, 0), "turn": (0, 1, 0), "left": (0, 0, -1), "right": (0, 0, 1), "top": (-1, 0, 0)}
_CLASSES = {
    "board": ("geom", {"type": "box", "density": 650, "friction": (0.8, 0.005, 0.0001)}),
    "slab": ("geom", {"type": "box", "density": 1500, "friction": (0.8, 0.005, 0.0001)}),
    "fitting": ("geom", {"density": 2700, "material": "metal", "friction": (0.8, 0.005, 0.0001)}),
    "slide": ("joint", {"type": "slide", "damping": 6, "frictionloss": 1.5, "armature": 0.1}),
    "hinge": ("joint", {"type": "hinge", "damping": 0.4, "frictionloss": 0.4, "armature": 0.02}),
}
_ACROSS = {"x": (0.0, 0.0, 0.5**0.5, 0.5**0.5), "z": (0.5, -0.5, -0.5, -0.5)}
"""Rotation (wxyz) of a grasp from the front across a bar along x or z."""
_TILTS = {"top": (0.0, 0.5, -0.5), "left": (0.0, -0.5), "right": (0.0, 0.5)}
"""Rotations [rad] of grasps about the bar of a handle: a hand at a door leans to its hinge, away from other doors."""


class Handle(NamedTuple):
    """A square bar or a round rod on two feet, or a knob on one foot.

    Attributes:
        shape: "bar", "rod" or "knob".
        thickness: Thickness of the bar, the rod or the knob [m].
        reach: Distance of its middle from the front [m].
        length: Length of the bar or the rod [m].
    """

    shape: str
    thickness: float
    reach: float
    length: float


class Part:
    """A body of a unit. All positions are in the frame of the unit, with all joints at 0."""

    def __init__(self, parent: "ET.Element | Part", name: str, origin: Point = (0, 0, 0), **more: object) -> None:
        self.name, self._origin = name, origin
        element, pos = (parent.element, parent._local(origin)) if isinstance(parent, Part) else (parent, origin)
        self.element = add(element, "body", name=name, pos=pos, **more)

    def box(self, name: str, low: Point, high: Point, material: str = "body", class_: str = "board") -> None:
        """Add a box between two corners [m]."""
        pos = self._local((a + b) / 2 for a, b in zip(low, high, strict=True))
        size = [(b - a) / 2 for a, b in zip(low, high, strict=True)]
        add(self.element, "geom", name=name, class_=class_, pos=pos, size=size, material=material)

    def tray(self, low: Point, high: Point, wall: float, material: str = "body") -> None:
        """Add a floor and four walls of the given thickness, between two corners [m]."""
        (x0, y0, _), (x1, y1, z1), z = low, high, low[2] + wall
        self.box(f"{self.name}_floor", low, (x1, y1, z), material)
        self.box(f"{self.name}_left", (x0, y0, z), (x0 + wall, y1, z1), material)
        self.box(f"{self.name}_right", (x1 - wall, y0, z), (x1, y1, z1), material)
        self.box(f"{self.name}_near", (x0 + wall, y0, z), (x1 - wall, y0 + wall, z1), material)
        self.box(f"{self.name}_far", (x0 + wall, y1 - wall, z), (x1 - wall, y1, z1), material)

    def handle(self, handle: Handle, x: float, y: float, z: float, hinge: Hinge = "top") -> None:
        """Add a handle and its grasps before a point of a front. It is upright if the hinge is left or right."""
        axis, front, half = "x" if hinge == "top" else "z", y - handle.reach, handle.thickness / 2
        type_, knob = "box" if handle.shape == "bar" else "capsule", handle.shape == "knob"

        def fitting(name: str, radius: float, shifts: tuple[float, float], planes: tuple[float, float]) -> None:
            """Add a piece between two points, shifted along the axis, at two y [m]."""
            ends = [(x + s * (axis == "x"), y, z + s * (axis == "z")) for s, y in zip(shifts, planes, strict=True)]
            fromto = [*self._local(ends[0]), *self._local(ends[1])]
            add(self.element, "geom", name=name, class_="fitting", type=type_, size=radius, fromto=fromto)

        long = 0.008 if knob else handle.length
        fitting(f"{self.name}_bar", half, (-long / 2, long / 2), (front, front))
        for i, shift in enumerate((0.0,) if knob else (0.02 - long / 2, long / 2 - 0.02)):
            fitting(f"{self.name}_foot_{i}", 0.8 * half, (shift, shift), (front + half, y))
        site = {"pos": self._local((x, front, z)), "size": 0.005, "group": 4}
        add(self.element, "site", name=f"{self.name}_handle", **site)
        for i, tilt in enumerate(_TILTS[hinge]):
            add(self.element, "site", name=f"grasp_{self.name}_{i}", quat=_about_x(_ACROSS[axis], tilt), **site)

    def _local(self, point: Iterable[float]) -> list[float]:
        return [a - b for a, b in zip(point, self._origin, strict=True)]


class Unit:
    """The MJCF document of one unit: its root body stands on z = 0, with its front towards -y.

    Args:
        name: Name of the document and the root.
        colours: For each material its colour, as six hexadecimal digits.
    """

    def __init__(self, name: str, colours: Mapping[str, str]) -> None:
        self.joints = dict[str, dict[str, Any]]()
        self._tree = ET.Element("mujoco", model=name)
        add(self._tree, "compiler", angle="radian", autolimits="true")
        defaults, assets = add(self._tree, "default"), add(self._tree, "asset")
        for class_, (tag, values) in _CLASSES.items():
            add(add(defaults, "default", class_=class_), tag, **values)
        for material, colour in colours.items():
            shine, rgb = 0.7 if material == "metal" else 0.2, [byte / 255 for byte in bytes.fromhex(colour)]
            add(assets, "material", name=material, rgba=(*rgb, 1), specular=shine, shininess=shine)
        self.root = Part(add(self._tree, "worldbody"), name)

    def part(self, name: str, origin: Point, parent: Part | None = None, **more: object) -> Part:
        """Add a part to the root or to another part. It is fixed if no joint is added to it."""
        return Part(parent or self.root, name, origin, **more)

    def opening(self, name: str, origin: Point, opens: str, most: float, **more: Any) -> Part:
        """Add a part on a joint with its own name: a drawer, a leaf with its hinge at the given side, or a handle.

        Args:
            name: Name of the body and of its joint.
            origin: A point of the axis [m].
            opens: "drawer", the side of the hinge, or "turn" for a hinge across the front.
            most: Upper limit of the joint, whose lower limit is 0 [m or rad].
            more: The parent, if it is not the root, and other attributes of the body.
        """
        part, type_ = self.part(name, origin, **more), "slide" if opens == "drawer" else "hinge"
        add(part.element, "joint", name=name, class_=type_, axis=_AXES[opens], range=(0, most))
        self.joints[name] = {"type": type_, "range": [0.0, most]}
        return part

    def sort_parts(self) -> list[str]:
        """Put fixed parts first, then hinges, then slides: variants with the same order share bodies in this order.

        Return the names of all parts.
        """
        parts = self.root.element.findall("body")
        for part in sorted(parts, key=lambda part: [joint.get("class") for joint in part.findall("joint")]):
            self.root.element.remove(part)
            self.root.element.append(part)
        return [part.get("name", "") for part in self.root.element.iter("body")][1:]

    def text(self) -> str:
        """Return the document as text."""
        ET.indent(self._tree, "  ")
        return ET.tostring(self._tree, encoding="unicode") + "\n"


def add(parent: ET.Element, tag: str, **values: object) -> ET.Element:
    """Append an element. Numbers are written with nine digits, and `class_` as `class`."""
    return ET.SubElement(parent, tag, {name.rstrip("_"): _word(value) for name, value in values.items()})


def _word(value: Any) -> str:
    if isinstance(value, str):
        return value
    return f"{round(value, 9):.9g}" if isinstance(value, int | float) else " ".join(map(_word, value))


def _about_x(quat: tuple[float, ...], angle: float) -> list[float]:
    """Return the product of a quaternion (wxyz) and a rotation about x [rad]."""
    (w, x, y, z), c, s = quat, cos(angle / 2), sin(angle / 2)
    return [w * c - x * s, x * c + w * s, y * c + z * s, z * c - y * s]
