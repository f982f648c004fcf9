"""Cost of fresh layouts for a few of many worlds in JAX, beside the same call of a LayoutGenerator with torch masks.

    python -m benchmarks.jax_call            # 4,096 worlds of `mid`, of which 2% are done; needs the extra jax

Both get a new mask in every call and put the layouts of its worlds into an array of all worlds, on the device. They
take turns; a round is timed as a whole, with one wait at its end. `scan` is the same in one `lax.scan` under `jit`.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import tyro
import warp as wp

from benchmarks.timing import spread
from sceniris_gym.errors import import_extra
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator

jax: Any = import_extra("jax", "jax")
jnp: Any = jax.numpy


@dataclass(frozen=True)
class Options:
    """Scene, sizes and device of the measurement.

    Attributes:
        scene: name or path of a scene
        worlds: number of worlds
        done: share of the worlds that are done in a call
        calls: calls in a round
        rounds: rounds that count, after one that does not
        device: "cpu" or "cuda:0", where JAX computes; by default cuda:0 if there is one
    """

    scene: str = "mid"
    worlds: int = 4096
    done: float = 0.02
    calls: int = 200
    rounds: int = 10
    device: str | None = None


def torch_round(generator: LayoutGenerator, masks: torch.Tensor, qpos: torch.Tensor) -> Callable[[], None]:
    """Return a round of a generator."""
    fresh = generator.layouts.qpos

    def turn() -> None:
        for mask in masks:
            generator.generate(mask)
            torch.where(mask[:, None], fresh, qpos, out=qpos)
        wp.synchronize()

    return turn


def jax_rounds(layouts: Any, masks: np.ndarray) -> dict[str, Callable[[], None]]:
    """Return a round of single calls, and one of a scan."""
    calls, worlds = masks.shape
    seeds = jnp.stack([jnp.zeros(worlds, jnp.uint32), jnp.arange(worlds, dtype=jnp.uint32)], axis=1)
    start, episode, masks = layouts.qpos(seeds, 0).qpos, jnp.zeros(worlds, jnp.int32), jnp.asarray(masks)

    def step(carry: tuple[Any, Any], mask: Any) -> tuple[tuple[Any, Any], None]:
        qpos, episode = carry
        episode = episode + mask
        return (jnp.where(mask[:, None], layouts.qpos(seeds, episode, mask).qpos, qpos), episode), None

    single, whole = jax.jit(step), jax.jit(lambda carry: jax.lax.scan(step, carry, masks)[0])
    rows = [masks[i] for i in range(calls)]

    def turn() -> None:
        carry = start, episode
        for mask in rows:
            carry, _ = single(carry, mask)
        jax.block_until_ready(carry)

    return {"jit": turn, "scan": lambda: jax.block_until_ready(whole((start, episode)))}


def main(options: Options) -> None:
    """Print the milliseconds of a call, in each way, as a line of JSON."""
    from sceniris_gym.adapters.jax import LayoutFunction

    compiled = compile_scene(options.scene, options.device)
    masks = np.random.default_rng(0).random((options.calls, options.worlds)) < options.done
    generator = LayoutGenerator(compiled, options.worlds)
    generator.generate()
    device = wp.device_to_torch(wp.get_device(compiled.device))
    qpos = generator.layouts.qpos.clone()
    turns = {"torch": torch_round(generator, torch.tensor(masks, device=device), qpos)}
    turns |= jax_rounds(LayoutFunction(compiled), masks)
    found: dict[str, list[float]] = {name: [] for name in turns}
    for _ in range(options.rounds + 1):
        for name, turn in turns.items():
            start = time.perf_counter()
            turn()
            found[name].append(1000.0 * (time.perf_counter() - start) / options.calls)
    times = {f"{name}_ms": spread(values[1:]) for name, values in found.items()}
    ratios = {name: round(times[f"{name}_ms"]["median"] / times["torch_ms"]["median"], 3) for name in ("jit", "scan")}
    about = {"scene": options.scene, "worlds": options.worlds, "done": options.done, "device": compiled.device}
    print(json.dumps({**about, "jax": jax.__version__, **times, "times_torch": ratios}))


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
