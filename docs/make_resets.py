"""The animation of the README: the shipped policy of ClutterExtract-v0, in a fresh layout at each reset.

python -m docs.make_resets   # some minutes on a CPU
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
from PIL import Image

import sceniris_gym  # noqa: F401, registers the environments
from docs.make_worlds import grid
from sceniris_gym.config.loader import shipped
from sceniris_gym.training.policies import policy_of

PICTURE = Path(__file__).parent / "resets.gif"
_ENV = "sceniris_gym/ClutterExtract-v0"
_WORLDS, _COLUMNS, _SIZE = 6, 3, (272, 204)
_DRAWN, _SEEN = (816, 612), (slice(48, 456), slice(224, 768))  # pixels of a camera's picture, and its part that is kept
_EPISODE, _EPISODES, _EVERY = 84, 3, 4  # control steps per episode, episodes, control steps per picture
_COLOURS = 96


def main() -> None:
    """Draw the picture."""
    words: dict[str, Any] = {
        "render_mode": "rgb_array",
        "render_config": {"size": _DRAWN},
        "device": "cpu",
    }
    envs: Any = gym.make_vec(_ENV, num_envs=_WORLDS, max_episode_steps=_EPISODE, **words).unwrapped
    policy = policy_of(str(shipped("envs", ".pt")["clutter_extract"]))
    (observation, _), frames = envs.reset(seed=0), []
    for step in range(_EPISODE * _EPISODES):
        if step % _EVERY == 0:
            frames.append(grid([picture[_SEEN] for picture in envs.render()], _COLUMNS, 3, _SIZE))
        observation, *_ = envs.step(policy(observation))
    few = [frame.quantize(_COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE) for frame in frames]
    pause = round(1000.0 * _EVERY * envs.state.dt)
    few[0].save(PICTURE, save_all=True, append_images=few[1:], duration=pause, loop=0, optimize=True)
    print(f"{PICTURE}: {len(few)} pictures, {PICTURE.stat().st_size // 1024} KiB; {envs.statistics.read()}")


if __name__ == "__main__":
    main()
