"""Check of relations and regions: they can hold together, and the device has room for the pieces that they make."""

from __future__ import annotations

from sceniris_gym.config.limits import MAX_CORNERS, MAX_PIECES
from sceniris_gym.config.relations import Beside
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.program.pack.regions import cut_pieces
from sceniris_gym.program.pack.relations import MOST_SLICES
from sceniris_gym.program.plan import Plan


def check_relations(plan: Plan) -> None:
    """Check that the relations of each object fit together and onto the device, and that `between` has a width.

    Raises:
        SceneKeyError: Relations with too many corners or pieces, `beside` with `face_to`, a width that is missing, or
            too many points on several surfaces.
    """
    for o in plan.objects:
        relations, where = o.config.relations, f"{plan.scene.config.where}: objects.{o.name}.relations"
        corners = 3 + sum(max(4, len(r.anchors)) for r in relations)
        if corners > MAX_CORNERS:
            raise SceneKeyError(
                f"{where}: together may cut a support into pieces of {corners} corners, and there is room for "
                f"{MAX_CORNERS}. Use fewer relations, or fewer anchors of 'between'."
            )
        if o.orientation == "face_to" and any(isinstance(r, Beside) for r in relations):
            raise SceneKeyError(
                f"{where}: 'beside' depends on how the object is turned, and 'face_to' on where it is. Use one of them."
            )
        for i, relation in enumerate(relations):
            if relation.has_own_width and max(v.short_edge for v in o.variants) == 0.0:
                raise SceneKeyError(
                    f"{where}.{i}.width: is missing. '{o.name}' has nothing that collides, so no bounds and no width "
                    "of its own."
                )
        pieces, points = cut_pieces(o), None if o.config.region is None else o.config.region.points
        if pieces > MAX_PIECES and points is not None:
            raise SceneKeyError(
                f"{plan.scene.config.where}: objects.{o.name}.region: has {len(points):,} points on several surfaces, "
                f"{pieces:,} together, and there is room for {MAX_PIECES:,}. Use fewer points, or a part of the "
                "support with fewer surfaces."
            )
        if pieces > MAX_PIECES:
            raise SceneKeyError(
                f"{where}: together cut the region into {pieces} pieces, and there is room for {MAX_PIECES}. Use fewer "
                f"rings, or wider ones: a thin one makes up to {MOST_SLICES} slices."
            )
