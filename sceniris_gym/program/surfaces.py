"""The obstacles of a scene, and the surfaces that an object may stand on: level faces, cropped to its region."""

from __future__ import annotations

import mujoco
import numpy as np

from sceniris_gym.config.fields import FLOOR
from sceniris_gym.errors import NoSupportError
from sceniris_gym.geometry import supports
from sceniris_gym.geometry.pieces import Piece, PieceType, extract_pieces
from sceniris_gym.geometry.supports import SupportSurface
from sceniris_gym.program.placed_object import PlacedObject
from sceniris_gym.scene.model import SceneModel
from sceniris_gym.scene.support import Support, static_supports

UPRIGHT = float(np.cos(np.radians(0.1)))
"""Least z component of a support's z axis: 0.1 degree is 0.1 mm under an object of 8 cm, a fifth of the default gap."""
LEVEL = 0.9999985
"""The same in single precision, for supports as they are in a world."""


def obstacles(scene: SceneModel) -> list[Piece]:
    """Return all pieces of a scene, sorted by body, planes before solid pieces.

    Raises:
        MeshError, NotSupportedError: A geom that cannot be an obstacle; the error names the key of its asset.
    """
    config = scene.config
    where = dict.fromkeys(range(scene.mjm.nbody), config.where)
    for body, name in scene.owners.items():
        robot = config.all_robots.get(name)
        asset = ".asset" if robot is None and config.objects[name].asset is not None else ""
        where[body] = f"{config.where}: {config.key(name) if robot is None else robot.key}{asset}"
    pieces = extract_pieces(scene.mjm, config.geometry, where=where)
    return sorted(pieces, key=lambda p: (p.body, p.type != PieceType.PLANE, p.contact_class, p.geom))


def surfaces_of(
    scene: SceneModel, o: PlacedObject, pieces: list[Piece], edges: list[float]
) -> list[list[SupportSurface]]:
    """Return the surfaces that an object may stand on, a list for each of its variants.

    Args:
        scene: The scene.
        o: The object, or a robot whose base is drawn, without its surfaces.
        pieces: All obstacles.
        edges: The least shorter edge of the bounds [m] for each variant, which `ratio_on_support` erodes by.

    Raises:
        NoSupportError: A support without any level surface, or nothing is left of it after its erosion and region.
    """
    config, support = o.config, o.support
    if config.support is None or support is None:
        assert config.region is not None
        if config.region.points is not None:
            return [supports.points_in_space(config.region.points)] * len(edges)
        assert config.region.box is not None
        return [[supports.rectangle(*config.region.box)] if config.relations else []] * len(edges)
    word, parent = config.support.word, config.support.parent
    where = f"{scene.config.where}: {scene.config.key(o.name)}.{word}"
    if support.is_floor:
        assert scene.config.floor is not None
        half = 0.5 * np.array(scene.config.floor.size)
        found = [supports.rectangle(-half, half)]
    else:
        found = _level_surfaces(support, pieces, open_above=word == "on")
    if not found:
        raise NoSupportError(
            f"{where}: '{parent}' has no level surface of 2 cm or more in width"
            f"{' that is open above' if word == 'on' else ''}. Valid: {_others(scene, o.name, pieces, word)}."
        )
    half = 0.5 * config.ratio_on_support
    return supports.crop(found, config.region, [half * edge for edge in edges], where)


def may_lean(scene: SceneModel, support: Support) -> bool:
    """Return whether a support may lean: its object may lie, or a joint above it turns about a tilted axis."""
    if support.owner is None:
        return False
    owner = scene.config.parts.get(support.owner)
    if owner is not None and owner.drawn_orientation.kind in ("stable", "any"):
        return True
    mjm, chain = scene.mjm, [support.body]
    while chain[-1] not in (0, scene.bodies[support.owner]):
        chain.append(int(mjm.body_parentid[chain[-1]]))
    joints = list(scene.moving_joints(support.owner))
    turns = np.isin(mjm.jnt_bodyid[joints], chain) & (mjm.jnt_type[joints] == mujoco.mjtJoint.mjJNT_HINGE)
    return bool((turns & (np.abs(mjm.jnt_axis[joints, 2]) < UPRIGHT)).any())


def _level_surfaces(support: Support, pieces: list[Piece], *, open_above: bool) -> list[SupportSurface]:
    """Return the level surfaces of a support; static geometry of no object is open above wherever there is room."""
    own = [p for p in pieces if p.body == support.body]
    covered = open_above and support.owner is not None
    return supports.level_surfaces(support.body, own, open_above=covered, geom=support.geom)


def _others(scene: SceneModel, own: str, pieces: list[Piece], word: str) -> str:
    """Return the names of all supports with a level surface, but for an object's own, each once, for messages."""
    known = {name: Support(scene.bodies[name], name) for name in scene.config.objects}
    for name in scene.config.objects:
        known |= {f"{name}/{part}": Support(body, name) for part, body in scene.parts(name).items()}
    if scene.config.model is not None:
        known = {**known, **static_supports(scene.mjm, scene.bodies), **known}
    if scene.config.floor is not None:
        known.pop(FLOOR, None)  # a geom of the same name
    found: dict[frozenset[int], str] = {}  # by their geoms, first the names of objects, then those of the model
    for name, s in known.items():
        level = s.owner != own and scene.home.xmat[s.body][8] >= UPRIGHT
        if level and _level_surfaces(s, pieces, open_above=word == "on"):
            geoms = frozenset(p.geom for p in pieces if p.body == s.body and s.geom in (None, p.geom))
            found.setdefault(geoms, name)
    floor = [] if scene.config.floor is None or word == "inside" else [FLOOR]
    return ", ".join([*floor, *sorted(found.values())]) or "none, as nothing else in this scene has one"
