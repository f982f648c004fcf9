"""Checks of each object's keys: supports, relations and regions, drawn joints and `reachable`."""

import numpy as np

from sceniris_gym.config.bounds import MAX_CORNERS, MAX_PIECES
from sceniris_gym.config.relations import Beside
from sceniris_gym.config.tier import Tier
from sceniris_gym.errors import MapError, NotSupportedError, ReachWarning, SceneKeyError
from sceniris_gym.geometry.supports import COS_MAX_TILT
from sceniris_gym.program.notices import warn
from sceniris_gym.program.pack.relations import MOST_SLICES, cut_pieces
from sceniris_gym.program.plan import Plan
from sceniris_gym.program.reach import asset_and_words
from sceniris_gym.reach.map import build_command, why_not_map

# Tolerance [m or rad] of a joint's limits for rounding.
_ROUNDING = 1e-6


def check_supports(plan: Plan) -> None:
    """Check that objects can stand on the supports named in the scene file.

    Raises:
        NotSupportedError: The z axis of a supporting body does not point up in the start pose.
        SceneKeyError: An object has `inside: floor`, or is on an endless plane without a region that bounds its places.
    """
    config = plan.scene.config
    for o in plan.objects:
        if o.config.support is None or o.support is None:
            continue
        word, parent, region = o.config.support.word, o.config.support.parent, o.config.region
        where, up = f"{config.where}: {config.key(o.name)}.{word}", plan.scene.home.xmat[o.support.body][8]
        if o.support.is_floor and word == "inside":
            raise SceneKeyError(f"{where}: the floor has no inside, because it has no cover. Write 'on: floor'.")
        if up < COS_MAX_TILT:
            lean = np.degrees(np.arccos(np.clip(up, -1.0, 1.0)))
            raise NotSupportedError(
                f"{where}: the z axis of '{parent}' leans by {lean:.3g} degrees at home, but supports should be level. "
                "Give the support a body whose z axis points up."
            )
        is_endless = any(s.is_endless for surfaces in o.surfaces for s in surfaces)
        if is_endless and (region is None or region.fraction is not None):
            raise SceneKeyError(
                f"{where}: the plane '{parent}' is endless. Give the object a region on the plane, as in "
                f"{config.key(o.name)}.region: {{box: [[-0.3, -0.3], [0.3, 0.3]]}}."
            )


def check_relations(plan: Plan) -> None:
    """Check each object's relations: their number, their combination, and the `width` of `between`.

    Raises:
        SceneKeyError: The relations cut the region into too many pieces, or into pieces with too many corners. `beside`
            is combined with `face_to`. `between` has no `width`, and the object has no geom that could give one.
            The points of a region make too many places, because several surfaces are below them.
    """
    for o in plan.objects:
        relations, where = o.config.relations, f"{plan.scene.config.where}: objects.{o.name}.relations"
        corners = 3 + sum(max(4, len(r.anchors)) for r in relations)
        if corners > MAX_CORNERS:
            raise SceneKeyError(
                f"{where}: the relations may cut a support into pieces with {corners} corners, which should be at "
                f"most {MAX_CORNERS}. Use fewer relations, or fewer anchors of 'between'."
            )
        if o.orientation == "face_to" and any(isinstance(r, Beside) for r in relations):
            raise SceneKeyError(
                f"{where}: 'beside' needs the object's rotation first, but 'face_to' needs its position first. Remove "
                "one of them."
            )
        for i, relation in enumerate(relations):
            if relation.has_own_width and max(v.short_edge for v in o.stable_poses) == 0.0:
                raise SceneKeyError(
                    f"{where}.{i}.width: '{o.name}' has no geom that collides, so it has no width. Give a width [m]."
                )
        pieces, points = cut_pieces(o), None if o.config.region is None else o.config.region.points
        if pieces > MAX_PIECES and points is not None:
            raise SceneKeyError(
                f"{plan.scene.config.where}: objects.{o.name}.region: its {len(points):,} points lie on several "
                f"surfaces and make {pieces:,} places, which should be at most {MAX_PIECES:,}. Use fewer points, or a "
                "part of the support with fewer surfaces."
            )
        if pieces > MAX_PIECES:
            raise SceneKeyError(
                f"{where}: the relations cut the region into {pieces} pieces, which should be at most {MAX_PIECES}. "
                f"Use fewer relations, or wider ranges of 'distance': a narrow one makes up to {MOST_SLICES} pieces."
            )


def check_followers(plan: Plan) -> None:
    """Check that a joint that follows a drawn joint belongs to the same object and stays within its limits.

    Raises:
        NotSupportedError: A joint of another object follows a drawn joint.
        SceneKeyError: A following joint would leave its limits.
    """
    config, mjm = plan.scene.config, plan.scene.mjm
    for o in plan.objects:
        where, own = f"{config.where}: {config.key(o.name)}.joints", plan.scene.joints(o.name).values()
        spans = o.spans
        for c in o.followers:
            (low, high), (least, most) = spans[c.adr], c.limits
            follower, driver = (mjm.joint(j).name for j in (c.follower, c.driver))
            if c.follower not in own:
                raise NotSupportedError(
                    f"{where}: {c.label} makes joint '{follower}' follow the drawn joint '{driver}', but '{follower}' "
                    f"is not part of '{o.name}'. Make both joints part of one asset, do not draw '{driver}', or remove "
                    "the equality."
                )
            if low < least - _ROUNDING or high > most + _ROUNDING:
                raise SceneKeyError(
                    f"{where}: {c.label} makes joint '{follower}' follow '{driver}' to positions from {low:.4g} to "
                    f"{high:.4g}, which should be inside its limits [{least:g}, {most:g}]. Draw '{driver}' from a "
                    "smaller range."
                )


def check_reach(plan: Plan) -> None:
    """Check that each reach target can be tested as its tier demands. Warn if `ik` replaces a tier that needs a map.

    Raises:
        MapError: A tier needs a map, and the arm has no map.
        SceneKeyError: The tier is `ik`, `clear` or `path`, which pose the arm, but the robot has `in_scene: false`.
    """
    config, where = plan.scene.config, plan.scene.config.where
    for i, one in enumerate(plan.reaching.arms):
        targets = [target for target in plan.reaching.targets if target.arm == i]
        robot = config.all_robots[one.robot]
        words = {t.name: word for t in targets if (word := config.objects[t.name].reachable) is not True}
        asked = [f"objects.{name}.reachable" for name, word in words.items() if Tier.of(str(word)).needs_map]
        asset, tcp = asset_and_words(robot)
        why_not = why_not_map(one.arm, one.map, asset, tcp)
        if asked and one.map is None and one.arm.no_map is None:
            raise MapError(
                f"{where}: {asked[0]}: there is no map of the arm '{asset}'. Build it with "
                f"'{build_command(asset, tcp)}' and set the robot's 'map' to its file, or use 'ik', which needs no map."
            )
        if asked and why_not is not None:
            warn(ReachWarning(f"{where}: {', '.join(asked)}: {why_not}, so 'ik' decides."))
        solved = [target.name for target in targets if not target.tier.needs_map]
        if solved and not robot.in_scene:
            instead = "Build a finer map" if one.map is not None and one.map.coarse else "Use 'map'"
            raise SceneKeyError(
                f"{where}: objects.{solved[0]}.reachable: 'ik', 'clear' and 'path' need the robot, but it has "
                f"'in_scene: false'{'' if why_not is None else f', and {why_not}'}. {instead}, or put the robot into "
                "the scene."
            )
