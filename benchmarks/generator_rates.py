"""Rates of a generator alone, for layouts of all worlds and of every fiftieth one.

python -m benchmarks.generator_rates mid:65536 kitchen:4096 --device cuda:0

Prints a line of JSON for each scene: seconds until it is compiled, milliseconds for layouts of all worlds and of 2% of
them, and valid layouts a second.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable

import numpy as np
import warp as wp

from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.layouts import LayoutStatus

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
    """Print the lines."""
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
        valid = int((generator.layouts.status.cpu().numpy() == LayoutStatus.VALID).sum())
        found = {
            "scene": scene,
            "num_envs": int(worlds),
            "ready_s": round(cold, 1),
            "ms": round(1e3 * full, 3),
            "valid_per_s": round(valid / full),
            "ms_of_2_percent": round(1e3 * partial, 3),
        }
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
