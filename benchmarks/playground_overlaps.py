"""Starts with a contact in the task of docs/jax.md, Playground's PandaPickCube with three blocks beside its box.

    python -m benchmarks.playground_overlaps --arm MENAGERIE      # needs the extra jax, and MuJoCo Menagerie

"As it comes" each block is drawn as the task draws its box: anywhere in the square, whatever else is there. MuJoCo C is
the judge: contacts between things, or of a thing with the arm, deeper than 0.1 mm count. Then both wrappers go through
ten iterations of short episodes, and the different starts that they have seen are counted.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import tyro

from sceniris_gym.errors import import_extra

jax: Any = import_extra("jax", "jax")
jnp: Any = jax.numpy

PAGE = Path(__file__).parents[1] / "docs" / "jax.md"
MOST = 1e-4
"""Depth [m] from which a contact is an overlap."""
THINGS = 4
LENGTH = 10
"""Control steps of an episode, and of an iteration."""


@dataclass(frozen=True)
class Options:
    """Sizes of the measurement.

    Attributes:
        arm: folder of MuJoCo Menagerie, or of a stand-in for its Panda
        resets: starts to judge
        worlds: worlds of the ten iterations
    """

    arm: Path
    resets: int = 10_000
    worlds: int = 64


def task(arm: Path, worlds: int) -> dict[str, Any]:
    """Return the names of the page's program before it trains, with room for so many worlds."""
    from etils import epath
    from mujoco_playground._src import mjx_env

    mjx_env.MENAGERIE_PATH = epath.Path(arm)
    program = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[1].partition("sizes = ")[0]
    room = {"naconmax": 64 * worlds, "naccdmax": 64 * worlds}
    names: dict[str, Any] = {}
    exec(program.replace("super().__init__()", f"super().__init__(config_overrides={room})"), names)
    return names


def depths(mjm: mujoco.MjModel, starts: np.ndarray) -> np.ndarray:
    """Return the deepest contact [m] of each start but those with the floor, by MuJoCo C."""
    data, floor, found = mujoco.MjData(mjm), mjm.geom("floor").id, []
    for qpos in starts:
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(mjm, data)
        found.append(max([0.0, *(-contact.dist for contact in data.contact if floor not in contact.geom)]))
    return np.array(found)


def as_it_comes(mjm: mujoco.MjModel, resets: int) -> np.ndarray:
    """Return starts in which every thing is drawn like the task's box, shape (resets, nq)."""
    random, home = np.random.default_rng(0), mjm.key("home").qpos
    first = mjm.jnt_qposadr[mjm.body("box").jntadr[0]]
    starts = np.tile(home, (resets, 1))
    for i in range(THINGS):
        adr = first + 7 * i
        starts[:, adr : adr + 2] = home[first : first + 2] + random.uniform(-0.2, 0.2, (resets, 2))
    return starts


def starts_seen(env: Any, worlds: int) -> tuple[int, int]:
    """Return how many resets there are in ten iterations, and how many of their starts are different."""
    reset, step = jax.jit(env.reset), jax.jit(env.step)
    state = reset(jax.random.split(jax.random.PRNGKey(0), worlds))
    seen = [np.asarray(state.data.qpos)]
    for _ in range(10 * LENGTH):
        state = step(state, jnp.zeros((worlds, env.action_size)))
        seen.append(np.asarray(state.data.qpos)[np.asarray(state.done, bool)])
    found = np.concatenate(seen)
    return len(found), len(np.unique(found, axis=0))


def main(options: Options) -> None:
    """Print a line for each way to start, and the starts seen by each wrapper."""
    names = task(options.arm, options.worlds)
    from mujoco_playground._src import wrapper

    from sceniris_gym.adapters.jax import LayoutFunction

    env, compiled = names["env"], names["compiled"]
    keys = jax.random.split(jax.random.PRNGKey(1), options.resets)
    fresh = LayoutFunction(compiled).qpos(keys, 0)
    ways = {"as it comes": as_it_comes(env.mj_model, options.resets), "fresh layouts": np.asarray(fresh.qpos)}
    for way, starts in ways.items():
        found = depths(env.mj_model, starts)
        print(
            f"{way}: {int((found > MOST).sum())} of {len(found)} starts overlap, deepest {1000.0 * found.max():.2f} mm",
            flush=True,
        )
    print(f"{int(np.asarray(fresh.fallback).sum())} of the layouts are from the bank")
    for way, wrap in (("as it comes", wrapper.wrap_for_brax_training), ("fresh layouts", names["wrap"])):
        resets, different = starts_seen(wrap(env, episode_length=LENGTH, action_repeat=1), options.worlds)
        print(f"{way}: {different} different starts in {resets} resets of ten iterations", flush=True)


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
