"""Check of regions: the device has room for the pieces that relations cut them into."""

from __future__ import annotations

from sceniris_gym.config.limits import MAX_PIECES
from sceniris_gym.errors import SceneKeyError
from sceniris_gym.program.pack.regions import cut_pieces
from sceniris_gym.program.pack.relations import MOST_SLICES
from sceniris_gym.program.plan import Plan


def check_regions(plan: Plan) -> None:
    """Check that the region of each object has no more pieces than the device has room for.

    Raises:
        SceneKeyError: Too many points on several surfaces, or relations that cut a region too finely.
    """
    where = plan.scene.config.where
    for o in plan.objects:
        pieces = cut_pieces(o)
        points = None if o.config is None or o.config.region is None else o.config.region.points
        if pieces > MAX_PIECES and points is not None:
            raise SceneKeyError(
                f"{where}: objects.{o.name}.region: has {len(points):,} points on several surfaces, {pieces:,} "
                f"together, and there is room for {MAX_PIECES:,}. Use fewer points, or a part of the support with "
                "fewer surfaces."
            )
        if pieces > MAX_PIECES:
            raise SceneKeyError(
                f"{where}: objects.{o.name}.relations: together cut the region into {pieces} pieces, and there is "
                f"room for {MAX_PIECES}. Use fewer rings, or wider ones: a thin one makes up to {MOST_SLICES} slices."
            )
