"""Models of LIBERO's things, upright: its own MJCF files, or boxes in their place."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from sceniris_gym.importers.libero.kinds import TURN, Box, Kind
from sceniris_gym.scene.model_files import load_model

INNER = "object"
"""The body of a model that LIBERO places, below the root."""
_FILES = (
    "articulated_objects/{0}.xml",
    "stable_hope_objects/{0}/{0}.xml",
    "stable_scanned_objects/{0}/{0}.xml",
    "turbosquid_objects/{0}/{0}.xml",
)
_HIDDEN = 3  # group of geoms that collide and are not drawn, which is 0 in LIBERO's models
_WALL = 0.004  # thickness of walls [m]
_DENSITY = 300.0  # kg/m^3
_COLOUR = [0.7, 0.6, 0.5, 1.0]
_SIDES = ("-x", "+x", "-y", "+y", "-z", "+z")


def load_thing(name: str, kind: Kind, assets: Path, where: str) -> mujoco.MjSpec | None:
    """Return LIBERO's model of a class, upright on its own axes; None if the folder does not have it.

    Raises:
        SceneFileError: MuJoCo cannot read it, or a file that it refers to is missing.
    """
    file = next((file for path in _FILES if (file := assets / path.format(name)).is_file()), None)
    if file is None:
        return None
    spec = load_model(file, where, _with_unique_names)
    spec.njmax = spec.nconmax = -1  # sizes of a scene are its own
    for geom in spec.geoms:
        geom.group = geom.group or _HIDDEN
    spec.compiler.inertiagrouprange = [_HIDDEN, _HIDDEN]  # as in robosuite, what collides has the mass
    inner = spec.body(INNER)
    inner.pos, inner.quat = np.zeros(3), TURN[kind.up]
    return spec


def stand_in(kind: Kind) -> mujoco.MjSpec:
    """Return boxes of the stated sizes in place of a model."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    inner = spec.worldbody.add_body().add_body(name=INNER)
    whole = Box((0.0, 0.0, 0.5 * kind.size[2]), kind.size, "+z" if kind.inside else "", kind.inside)
    for box in kind.boxes or (whole,):
        body, at = inner, np.array(box.pos)
        if box.joint:
            body = inner.add_body(name=box.joint)
            joint = body.add_joint(name=box.joint, range=box.range, limited=True, damping=1.0)
            if box.anchor is None:
                joint.type, joint.axis = mujoco.mjtJoint.mjJNT_SLIDE, [0.0, 1.0, 0.0]
            else:
                joint.pos = box.anchor
        _add_walls(body, at, 0.5 * np.array(box.size), box.open)
        half = 0.5 * np.array(box.size) - _WALL
        for site, pos, size in ((box.inside, at, half), (box.top, at + [0.0, 0.0, half[2]], [*half[:2], 0.001])):
            if site:
                body.add_site(name=site, type=mujoco.mjtGeom.mjGEOM_BOX, pos=pos, size=size, rgba=np.zeros(4))
    return spec


def _add_walls(body: mujoco.MjsBody, at: np.ndarray, half: np.ndarray, opening: str) -> None:
    """Add a solid box, or five walls inside of its bounds."""
    for i, side in enumerate(_SIDES if opening else ("",)):
        pos, size = at.copy(), half.copy()
        if side:
            size[i // 2] = 0.5 * _WALL
            pos[i // 2] += (2 * (i % 2) - 1) * (half[i // 2] - 0.5 * _WALL)
        if side != opening or not side:
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=pos, size=size, density=_DENSITY, rgba=_COLOUR)


def _with_unique_names(text: str) -> str:
    """Return MJCF in which no two elements of one kind in `<asset>` have one name: MuJoCo reads no such file."""
    root = ElementTree.fromstring(text)
    seen: Counter[tuple[str, str]] = Counter()
    for element in (element for asset in root.iter("asset") for element in asset if element.get("name")):
        key = element.tag, element.attrib["name"]
        seen[key] += 1
        if seen[key] > 1:
            element.set("name", f"{key[1]}_{seen[key]}")
    return ElementTree.tostring(root, encoding="unicode")
