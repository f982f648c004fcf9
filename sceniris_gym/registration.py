"""Registers the environments with Gymnasium. Entry points are strings, so nothing heavy is imported here."""

from __future__ import annotations

import gymnasium

ENVS = {  # id -> keyword arguments of gymnasium.register
    "sceniris_gym/DrawerPick-v0": {
        "kwargs": {"task": "sceniris_gym.envs.drawer_pick:DrawerPick"},
        "max_episode_steps": 200,
    },
    "sceniris_gym/DrawerOpenPick-v0": {
        "kwargs": {"task": "sceniris_gym.envs.drawer_open_pick:DrawerOpenPick"},
        "max_episode_steps": 400,
    },
    "sceniris_gym/TabletopReach-v0": {
        "kwargs": {"task": "sceniris_gym.envs.tabletop_reach:TabletopReach", "nconmax": 40, "njmax": 160},
        "max_episode_steps": 100,
    },
    "sceniris_gym/TabletopReachEasy-v0": {
        "kwargs": {"task": "sceniris_gym.envs.tabletop_reach_easy:TabletopReachEasy", "nconmax": 40, "njmax": 160},
        "max_episode_steps": 100,
    },
    "sceniris_gym/TabletopLift-v0": {
        "kwargs": {"task": "sceniris_gym.envs.tabletop_lift:TabletopLift", "nconmax": 48, "njmax": 192},
        "max_episode_steps": 150,
    },
    "sceniris_gym/TabletopLiftEasy-v0": {
        "kwargs": {"task": "sceniris_gym.envs.tabletop_lift_easy:TabletopLiftEasy", "nconmax": 48, "njmax": 192},
        "max_episode_steps": 150,
    },
    "sceniris_gym/ClutterExtract-v0": {
        "kwargs": {
            "task": "sceniris_gym.envs.clutter_extract:ClutterExtract",
            "nconmax": 128,
            "njmax": 512,
            "nvmax": 81,  # the arm's 9, and 6 for the peg and each of the 11 others that are present at most
        },
        "max_episode_steps": 200,
    },
    "sceniris_gym/ClutterPush-v0": {
        "kwargs": {"task": "sceniris_gym.envs.clutter_push:ClutterPush", "nconmax": 40, "njmax": 160},
        "max_episode_steps": 250,
    },
    "sceniris_gym/KitchenReset-v0": {
        "kwargs": {"task": "sceniris_gym.envs.kitchen_reset:KitchenReset", "nconmax": 256, "njmax": 1024},
        "max_episode_steps": 200,
    },
}
ENTRY_POINTS = {
    "entry_point": "sceniris_gym.vector.single_env:SceneEnv",
    "vector_entry_point": "sceniris_gym.vector.vector_env:SceneVectorEnv",
}


def register_envs() -> None:
    """Register every environment of this package with Gymnasium; a second call changes nothing."""
    for env_id, arguments in ENVS.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(id=env_id, **ENTRY_POINTS, **arguments)
