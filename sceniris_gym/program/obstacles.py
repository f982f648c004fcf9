"""The obstacles of a scene: its geoms as pieces, in the order of all lists that number them."""

from __future__ import annotations

from sceniris_gym.geometry.pieces import Piece, PieceType, extract_pieces
from sceniris_gym.scene.model import SceneModel


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
