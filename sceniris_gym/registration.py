"""The environments that Gymnasium knows by name. Entry points are strings, so that nothing heavy is imported here."""

from __future__ import annotations

import gymnasium

ENVS = {  # id -> keyword arguments of gymnasium.register
    "sceniris_gym/DrawerPick-v0": {
        "entry_point": "sceniris_gym.envs.drawer_pick:make_env",
        "vector_entry_point": "sceniris_gym.envs.drawer_pick:make_vector_env",
        "max_episode_steps": 200,
    },
}


def register_envs() -> None:
    """Register every environment of this package with Gymnasium; a second call changes nothing."""
    for env_id, arguments in ENVS.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(id=env_id, **arguments)
