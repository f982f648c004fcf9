"""Registration of the environments with Gymnasium. Entry points are strings, so no large library is imported."""

from typing import Any

import gymnasium


def _env(task: str, max_episode_steps: int) -> dict[str, Any]:
    """Return the arguments of `gymnasium.register` for a task of `sceniris_gym.envs`."""
    return {"max_episode_steps": max_episode_steps, "kwargs": {"task": f"sceniris_gym.envs.{task}"}}


ENVS = {
    "sceniris_gym/DrawerPick-v0": _env("drawer_pick:DrawerPick", 200),
    "sceniris_gym/DrawerOpenPick-v0": _env("drawer_open_pick:DrawerOpenPick", 400),
    "sceniris_gym/TabletopReach-v0": _env("tabletop_reach:TabletopReach", 100),
    "sceniris_gym/TabletopReachEasy-v0": _env("tabletop_reach_easy:TabletopReachEasy", 100),
    "sceniris_gym/TabletopReachPixels-v0": _env("tabletop_reach_pixels:TabletopReachPixels", 100),
    "sceniris_gym/TabletopLift-v0": _env("tabletop_lift:TabletopLift", 150),
    "sceniris_gym/TabletopLiftEasy-v0": _env("tabletop_lift_easy:TabletopLiftEasy", 150),
    "sceniris_gym/TabletopLiftAny-v0": _env("tabletop_lift_any:TabletopLiftAny", 150),
    "sceniris_gym/ClutterExtract-v0": _env("clutter_extract:ClutterExtract", 200),
    "sceniris_gym/ClutterPush-v0": _env("clutter_push:ClutterPush", 250),
    "sceniris_gym/KitchenReset-v0": _env("kitchen_reset:KitchenReset", 200),
}
ENTRY_POINTS = {
    "entry_point": "sceniris_gym.vector.single_env:SceneEnv",
    "vector_entry_point": "sceniris_gym.vector.vector_env:SceneVectorEnv",
}


def register_envs() -> None:
    """Register every environment of this package with Gymnasium, unless it is registered already."""
    for env_id, arguments in ENVS.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(id=env_id, **ENTRY_POINTS, **arguments)
