"""Check of relations: they can hold together, and the device has room for the polygons that they make."""

from __future__ import annotations

from sceniris_gym.config.limits import MAX_CORNERS
from sceniris_gym.config.relations import Beside
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.program.pack.relations import relations_of
from sceniris_gym.program.plan import Plan


def check_relations(plan: Plan) -> None:
    """Check that the relations of each object fit together and onto the device, and that `between` has a width.

    Raises:
        SceneKeyError: Relations with too many corners, `beside` with `face_to`, or a width that is missing.
    """
    for o in plan.objects:
        relations, where = relations_of(o), f"{plan.scene.config.where}: objects.{o.name}.relations"
        corners = 3 + sum(max(4, len(r.anchors)) for r in relations)
        if corners > MAX_CORNERS:
            raise SceneKeyError(
                f"{where}: together may cut a support into pieces of {corners} corners, and there is room for "
                f"{MAX_CORNERS}. Use fewer relations, or fewer anchors of 'between'."
            )
        faces = o.config is not None and o.config.drawn_orientation.kind == "face_to"
        if faces and any(isinstance(r, Beside) for r in relations):
            raise SceneKeyError(
                f"{where}: 'beside' depends on how the object is turned, and 'face_to' on where it is. Use one of them."
            )
        for i, relation in enumerate(relations):
            if relation.has_own_width and max(v.short_edge for v in o.variants) == 0.0:
                raise SceneKeyError(
                    f"{where}.{i}.width: is missing. '{o.name}' has nothing that collides, so no bounds and no width "
                    "of its own."
                )
