"""The bodies of an object that can support others, for supports such as `{any: cabinet}`."""

from sceniris_gym.config.member_names import object_of
from sceniris_gym.geometry.pieces import extract_pieces
from sceniris_gym.geometry.supports import COS_MAX_TILT, level_surfaces
from sceniris_gym.scene.model import SceneModel


def level_bodies(scene: SceneModel, name: str, word: str) -> list[str]:
    """Return the names of the bodies of an object that have a level surface in the start pose, or the object's name.

    For an object with variants, these are bodies of all variants.

    Args:
        scene: The scene.
        name: The object.
        word: The support's key: 'on', 'inside' or 'in'.
    """
    bodies = {
        "/".join([own, *filter(None, [part])]): body
        for own in scene.config.objects
        if object_of(own) == name
        for part, body in {"": scene.bodies[own], **scene.parts(own)}.items()
    }
    pieces = extract_pieces(scene.mjm, scene.config.geometry, set(bodies.values()))
    level = {support: body for support, body in bodies.items() if scene.home.xmat[body][8] >= COS_MAX_TILT}
    own = {body: [piece for piece in pieces if piece.body == body] for body in level.values()}
    found = [support for support, body in level.items() if level_surfaces(body, own[body], open_above=word == "on")]
    return found or [name]
