"""Registration of the environments with Gymnasium. Entry points are strings, so no large library is imported."""

from typing import Any

import gymnasium

ENVS = {
    "sceniris_gym/DrawerPick-v0": ("drawer_pick:DrawerPick", 200),
    "sceniris_gym/DrawerOpenPick-v0": ("drawer_open_pick:DrawerOpenPick", 400),
    "sceniris_gym/TabletopReach-v0": ("tabletop_reach:TabletopReach", 100),
    "sceniris_gym/TabletopReachEasy-v0": ("tabletop_reach_easy:TabletopReachEasy", 100),
    "sceniris_gym/TabletopReachPixels-v0": ("tabletop_reach_pixels:TabletopReachPixels", 100),
    "sceniris_gym/TabletopLift-v0": ("tabletop_lift:TabletopLift", 150),
    "sceniris_gym/TabletopLiftEasy-v0": ("tabletop_lift_easy:TabletopLiftEasy", 150),
    "sceniris_gym/TabletopLiftAny-v0": ("tabletop_lift_any:TabletopLiftAny", 150),
    "sceniris_gym/ClutterExtract-v0": ("clutter_extract:ClutterExtract", 200),
    "sceniris_gym/ClutterPush-v0": ("clutter_push:ClutterPush", 250),
    "sceniris_gym/KitchenReset-v0": ("kitchen_reset:KitchenReset", 200),
    "sceniris_gym/KitchenAny-v0": ("kitchen_any:KitchenAny", 300),
    "sceniris_gym/OpenAny-v0": ("open_any:OpenAny", 250),
}
"""Id -> the task in `sceniris_gym.envs`, and the greatest number of steps of an episode."""
ENTRY_POINTS: dict[str, Any] = {
    "entry_point": "sceniris_gym.vector.single_env:SceneEnv",
    "vector_entry_point": "sceniris_gym.vector.vector_env:SceneVectorEnv",
}


def register_envs() -> None:
    """Register every environment of this package with Gymnasium, unless it is registered already."""
    for env_id, (task, steps) in ENVS.items():
        if env_id not in gymnasium.registry:
            kwargs = {"task": f"sceniris_gym.envs.{task}"}
            gymnasium.register(env_id, **ENTRY_POINTS, max_episode_steps=steps, kwargs=kwargs)
