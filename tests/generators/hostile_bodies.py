"""Bodies of hostile models: random geoms of every kind, and trees of bodies with joints."""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.etree.ElementTree import Element, SubElement

import numpy as np

CONVEX = ("sphere", "box", "capsule", "ellipsoid", "cylinder", "hull", "mesh")
SMALLEST = 0.0005
"""Least half size [m] of a geom."""
_BITS = ((1, 1), (2, 2), (1, 3), (2, 1), (0, 1), (1, 0), (4, 1), (0, 0))


@dataclass
class Joint:
    """A joint, its body's name, its type, and its limits [m or rad]; home is 0 unless a keyframe moves it."""

    name: str
    body: str
    type: str
    low: float
    high: float
    owner: str
    coupled: bool = False


@dataclass
class Parts:
    """Record of a model under construction, besides the elements themselves.

    Attributes:
        root: <mujoco>.
        rng: Random numbers.
        wanted: Features that the model shall have.
        used: Those that it has.
        unit: Half the size [m] of a typical thing.
        joints: All hinges and slides.
        bodies: Owner by name of body: a body of the world is its own owner.
        geoms: Body by name of geom.
        elements: Body elements by name.
    """

    root: Element
    rng: np.random.Generator
    wanted: set[str]
    unit: float
    used: set[str] = field(default_factory=set)
    joints: list[Joint] = field(default_factory=list)
    bodies: dict[str, str] = field(default_factory=dict)
    geoms: dict[str, str] = field(default_factory=dict)
    elements: dict[str, Element] = field(default_factory=dict)

    def has(self, feature: str) -> bool:
        """Return whether a feature is wanted, and count it as used if it is."""
        if feature in self.wanted:
            self.used.add(feature)
        return feature in self.wanted

    def section(self, name: str) -> Element:
        """The one element of this name below <mujoco>."""
        found = self.root.find(name)
        return SubElement(self.root, name) if found is None else found


def text(*values: float) -> str:
    """Numbers as an attribute."""
    return " ".join(f"{v:.8g}" for v in values)


def add_body(parts: Parts, parent: Element, name: str, pos: np.ndarray, owner: str | None = None, **more: str):
    """Add a named body; `owner` is the child of the world that it belongs to."""
    element = SubElement(parent, "body", more, name=name, pos=text(*pos))
    parts.bodies[name] = owner or name
    parts.elements[name] = element
    if parts.rng.random() < 0.3 and parts.has("gravcomp"):
        element.set("gravcomp", "1")
    return element


def add_geom(parts: Parts, body: Element, size: float, pos: np.ndarray, kind: str | None = None) -> Element:
    """Add a geom of about this half size, of a kind that the model shall have."""
    rng = parts.rng
    kinds = [k for k in CONVEX if k in parts.wanted]
    kind = kind or str(rng.choice(kinds))
    parts.used.add(kind)
    name = f"{body.get('name', 'world')}_g{len(body.findall('geom'))}"
    half = np.maximum(size * rng.uniform(0.4, 1.0, 3), SMALLEST)
    geom = SubElement(body, "geom", name=name, pos=text(*pos))
    if kind in ("hull", "mesh"):
        geom.set("type", "mesh")
        geom.set("mesh", _add_mesh(parts, kind, half))
    else:
        geom.set("type", kind)
        count = {"sphere": 1, "capsule": 2, "cylinder": 2}.get(kind, 3)
        geom.set("size", text(*half[:count]))
    if rng.random() < 0.4:
        geom.set("euler", text(*rng.uniform(-np.pi, np.pi, 3)))
    parts.geoms[name] = body.get("name", "world")
    if rng.random() < 0.3 and len(body.findall("geom")) > 1 and parts.has("bits"):
        contype, conaffinity = _BITS[rng.integers(len(_BITS))]
        geom.set("contype", str(contype))
        geom.set("conaffinity", str(conaffinity))
    if rng.random() < 0.4 and parts.has("margin"):
        margin = min(float(rng.uniform(0.05, 0.6)) * size, 0.05)
        geom.set("margin", text(margin))
        if parts.has("gap"):
            geom.set("gap", text(margin * float(rng.uniform(0.1, 1.0))))
    return geom


def _add_mesh(parts: Parts, kind: str, half: np.ndarray) -> str:
    assets = parts.section("asset")
    name = f"mesh{len(assets.findall('mesh'))}"
    if kind == "hull":
        points = parts.rng.normal(size=(int(parts.rng.integers(6, 24)), 3))
        points *= half / np.linalg.norm(points, axis=1, keepdims=True)
        SubElement(assets, "mesh", name=name, vertex=text(*points.ravel()))
        return name
    outline = np.array([[0.0, 0.0], [0.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [1.0, 0.0]])  # an L
    points = np.array([[*corner, z] for z in (-1.0, 1.0) for corner in outline]) * half
    faces = []
    for i in range(1, 5):
        faces += [(0, i + 1, i), (6, 6 + i, 7 + i)]
    for i in range(6):
        j = (i + 1) % 6
        faces += [(i, j, 6 + j), (i, 6 + j, 6 + i)]
    SubElement(assets, "mesh", name=name, vertex=text(*points.ravel()), face=text(*np.ravel(faces)))
    return name


def add_tree(parts: Parts, root: Element, size: float, bodies: int) -> None:
    """Add up to `bodies` bodies with joints below a body, mostly apart from each other."""
    rng, owner = parts.rng, str(root.get("name"))
    chain = [root]
    for i in range(bodies):
        parent = chain[int(rng.integers(len(chain)))]
        side = rng.normal(size=3)
        side[2] = abs(side[2]) + 0.2
        pos = side / np.linalg.norm(side) * size * float(rng.uniform(2.2, 3.0))
        body = add_body(parts, parent, f"{owner}_b{i}", pos, owner)
        parts.used.add("nested")
        add_joints(parts, body, size, owner)
        add_geom(parts, body, size * float(rng.uniform(0.3, 0.7)), np.zeros(3))
        chain.append(body)


def add_joints(parts: Parts, body: Element, size: float, owner: str) -> None:
    """Give a body one to three joints: hinges and slides with limits, or a ball."""
    rng = parts.rng
    if rng.random() < 0.3 and parts.has("ball_joint"):
        SubElement(body, "joint", name=f"{body.get('name')}_ball", type="ball")
        return
    count = int(rng.integers(2, 4)) if rng.random() < 0.5 and parts.has("several_joints") else 1
    for i in range(count):
        slides = rng.random() < 0.5 and parts.has("slide")
        add_joint(parts, body, f"{body.get('name')}_j{i}", "slide" if slides else "hinge", size, owner)


def add_joint(parts: Parts, body: Element, name: str, kind: str, size: float, owner: str) -> Joint:
    """Give a body a hinge or a slide with limits around 0."""
    rng = parts.rng
    reach = float(rng.uniform(0.5, 1.5)) * (size if kind == "slide" else 0.6)
    axis = rng.normal(size=3)
    joint = SubElement(body, "joint", name=name, type=kind, axis=text(*axis / np.linalg.norm(axis)))
    joint.set("range", text(-reach, reach))
    joint.set("limited", "true")
    joint.set("damping", text(float(rng.uniform(0.0, 0.1))))
    if parts.has("armature"):
        joint.set("armature", text(0.01 * size**2))
    if rng.random() < 0.5 and parts.has("springs"):
        joint.set("stiffness", text(float(rng.uniform(0.0, 5.0)) * size**4))
    parts.joints.append(Joint(name, str(body.get("name")), kind, -reach, reach, owner))
    return parts.joints[-1]
