"""The arena of a LIBERO problem, which only pictures show: floor, walls, table, mount of the arm, and cameras."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR
from sceniris_gym.importers.libero.kinds import WORKSPACES, Vec3
from sceniris_gym.importers.libero.places import HIDDEN
from sceniris_gym.scene import assemble, backdrop
from sceniris_gym.scene.model_files import load_model


@dataclass(frozen=True)
class Arena:
    """The surroundings of a work surface.

    Attributes:
        eye, view: Position of the camera `agentview` [m], and its viewing direction.
        style: Name of LIBERO's file, `libero_STYLE_base_style.xml` in the folder `scenes`.
        floor, wall: Textures of the floor and the walls, in the folder `textures`.
    """

    eye: Vec3
    view: Vec3
    style: str
    floor: str
    wall: str = "light-gray-plaster"


_STEEP, _FLAT, _TILES = (-0.777998, 0.0, -0.628266), (-0.848765, 0.0, -0.52877), "light-gray-floor-tile"
_HIGH, _LINEN = (0.658613, 0.0, 1.61035), "yellow_linen_wall_texture"
ARENAS = {
    "kitchen_table": Arena(_HIGH, _STEEP, "kitchen_tabletop", "gray_ceramic_tile", _LINEN),
    "table": Arena(_HIGH, _STEEP, "tabletop", _TILES),
    "study_table": Arena((0.458613, 0.0, 1.61035), _STEEP, "study", _TILES),
    "living_room_table": Arena((0.606577, 0.0, 0.96), _FLAT, "living_room_tabletop", "seamless_wood_planks_floor"),
    "floor": Arena((0.896577, 0.0, 0.65), _FLAT, "floor", _TILES),
}
"""Arenas by class of the work surface."""
_PLAIN = {"kitchen_table": "table", "table": "table"}  # tables whose size is in LIBERO's code, not in the file
_SHAPES = Path(__file__).with_suffix(".xml")
_ARENA, _PARTS, _MOUNT = "arena", "arena_parts", "mount"
_MOUNTED = 0.9  # an arm with its base above this height [m] has a mount
_DRAWN = "1"  # group of visual geoms in LIBERO's files


def add_arena(spec: mujoco.MjSpec, surface: str, kind: str, assets: Path | None, *, arm: bool) -> None:
    """Add what LIBERO draws around the objects. It does not collide, so that layouts stay as they are.

    Floor, walls and furniture come from LIBERO's file if the folder `assets` has this file. Otherwise, they are plain.

    Args:
        spec: The scene, with the work surface.
        surface: Name of the work surface.
        kind: Class of the work surface.
        assets: LIBERO's folder of models.
        arm: Whether an arm stands at the base. If the base is high, a mount is below the base.
    """
    arena, base, frame = ARENAS[kind], WORKSPACES[kind].base, spec.worldbody.add_frame()
    theirs, parts = None, {"room", _PLAIN.get(kind, kind)}
    if assets is not None and (file := assets / f"scenes/libero_{arena.style}_base_style.xml").is_file():
        theirs, parts = load_model(file, _ARENA, partial(_as_body, arena=arena)), {_PLAIN.get(kind)}
        assemble.attach(spec, theirs, _ARENA, frame, _ARENA)
    else:
        backdrop.add_light(spec)
    if arm and base[2] > _MOUNTED:
        parts.add(_MOUNT)
    shapes = load_model(_SHAPES, _ARENA)
    shapes.body(_MOUNT).pos = base
    for body in shapes.bodies[1:]:
        if body.name not in parts:
            shapes.delete(body)
    if len(shapes.bodies) > 1:
        assemble.attach(spec, shapes, _PARTS, frame, _ARENA, around=True)
    # robosuite's renderer cuts the sum of lights at white before it applies a texture, ours after. The headlight adds
    # 0.7 to them
    fraction = np.minimum(0.5 / sum(light.diffuse for light in spec.lights), 1.0)
    for light in spec.lights:
        light.diffuse = light.diffuse * fraction
    for geom in spec.geoms if theirs else ():
        geom.material = geom.material.replace(f"{_PARTS}/", f"{_ARENA}/")
    if kind != FLOOR:
        spec.geom(f"{surface}/top").group = HIDDEN


def cameras(kind: str, robot: str | None) -> dict[str, Any]:
    """Return LIBERO's cameras as under `cameras` of a scene file. The camera at the hand needs the arm `panda`."""
    eye, view = ARENAS[kind].eye, ARENAS[kind].view
    found: dict[str, Any] = {"agentview": {"pos": eye, "look_at": np.round(np.add(eye, view), 6).tolist()}}
    if robot == "panda":
        wrist = {"body": "robot/hand", "pos": [0.05, 0.0, 0.0], "look_at": [0.05, 0.0, 1.0], "up": [1.0, 0.0, 0.0]}
        found["robot0_eye_in_hand"] = {**wrist, "fovy": 75.0}
    return found


def _as_body(text: str, arena: Arena) -> str:
    """Return a file of LIBERO's arena with all visual geoms and lights in one body, and the textures of the problem."""
    root = ElementTree.fromstring(text)
    for name, file in (("texplane", arena.floor), ("tex-wall", arena.wall)):
        for texture in root.findall(f"asset/texture[@name='{name}']"):
            texture.set("file", f"../textures/{file}.png")
    body = ElementTree.Element("body", name=_ARENA)
    for world in root.findall("worldbody"):
        body.extend(part for part in world if part.tag != "camera" and part.get("name") != "table")
        world[:] = [body]
    for parent in list(body.iter()):
        for geom in parent.findall("geom"):
            if geom.get("group") != _DRAWN:
                parent.remove(geom)
            geom.attrib |= {"contype": "0", "conaffinity": "0"}
            if geom.get("type") == "plane":
                geom.set("pos", "0 0 -0.001")  # below the floor of the scene, if there is one
    return ElementTree.tostring(root, encoding="unicode")
