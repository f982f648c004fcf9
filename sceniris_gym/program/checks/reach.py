"""Check of `reachable`: tiers have the map or the arm that they need, and fall back on `ik` with a warning only."""

from __future__ import annotations

from sceniris_gym.config.tier import Tier
from sceniris_gym.errors import MapError, ReachWarning, SceneKeyError
from sceniris_gym.program.notices import warn
from sceniris_gym.program.plan import Plan
from sceniris_gym.program.reach import asset_and_words
from sceniris_gym.reach.map import build_command, why_not_map


def check_reach(plan: Plan) -> None:
    """Check that each reach target is decided as the scene file asks; warn where `ik` decides instead of a map.

    Raises:
        MapError: A tier asks for the map of an arm that has none.
        SceneKeyError: An arm that is not in the scene would have to be posed.
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
                f"'{build_command(asset, tcp)}' and name it as the robot's 'map', or ask for 'ik', which needs none."
            )
        if asked and why_not is not None:
            warn(ReachWarning(f"{where}: {', '.join(asked)}: {why_not}, so 'ik' decides."))
        solved = [target.name for target in targets if not target.tier.needs_map]
        if solved and not robot.in_scene:
            instead = "Build that" if one.map is not None and one.map.coarse else "Ask for 'map'"
            raise SceneKeyError(
                f"{where}: objects.{solved[0]}.reachable: 'ik' and 'clear' pose the arm, which has 'in_scene: false'"
                f"{'' if why_not is None else f', and {why_not}'}. {instead}, or put the robot into the scene."
            )
