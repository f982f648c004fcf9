"""Rates of a generator alone, for layouts of all worlds and of every fiftieth one, cold and warm.

python -m benchmarks.generator_rates mid:65536 kitchen:4096 --device cuda:0
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np
import warp as wp

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import Status

_ROUNDS = 21
_EVERY = 50


def median(work: Callable[[], object], device: str) -> float:
    """Median wall-clock time [s] of work, with the device idle before and after."""
    times = []
    for _ in range(_ROUNDS):
        wp.synchronize_device(device)
        start = time.perf_counter()
        work()
        wp.synchronize_device(device)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def main() -> None:
    """Print a line for each scene and number of worlds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", metavar="SCENE:WORLDS")
    parser.add_argument("--device", default="cuda:0")
    words = parser.parse_args()
    wp.config.quiet = True
    for word in words.scenes:
        scene, _, worlds = word.rpartition(":")
        if not scene or not worlds.isdecimal():
            parser.error(f"'{word}' should be a scene and a number of worlds, such as mid:4096")
        start = time.perf_counter()
        compiled = compile_scene(scene, words.device)
        wp.synchronize_device(words.device)
        cold = time.perf_counter() - start
        generator = LayoutGenerator(compiled, int(worlds))
        generator.generate()
        few = wp.array(np.arange(generator.nworld) % _EVERY == 0, dtype=bool, device=words.device)
        partial = median(lambda generator=generator, few=few: generator.generate(few), words.device)
        full = median(generator.generate, words.device)
        valid = int((generator.layouts.status.numpy() == Status.VALID).sum())
        print(
            f"{scene} {worlds}: ready after {cold:.1f} s, all worlds {1e3 * full:.3f} ms, {valid / full:,.0f} valid "
            f"layouts/s, {100 / _EVERY:.0f}% of them {1e3 * partial:.3f} ms",
            flush=True,
        )


if __name__ == "__main__":
    main()
