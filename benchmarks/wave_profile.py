"""Waves of a generator and the time of its kernels, for layouts of all worlds and of every fiftieth one.

python -m benchmarks.wave_profile mid:4096 kitchen:4096 --device cuda:0

Prints a line of JSON for each scene and share of the worlds: rows and candidates of each wave, restarts at once and
worlds left of each round, and on a GPU for each kernel its launches, their sum [ms], median and minimum [us]. Launches
are timed one by one, without a graph; each takes some 4 us more than in a graph, where a pass of a loop and a launch
have a price of their own, which the first line gives: both in us, with kernels that have nothing to do.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections import defaultdict
from collections.abc import Sequence
from typing import Any
from unittest.mock import patch

import numpy as np
import warp as wp

from sceniris_gym.layout import generate
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator
from sceniris_gym.layout.wave.search import Workspace

_EVERY = 50
_PASSES = 200
_KERNELS = 10


@wp.kernel(enable_backward=False)
def _count_down(left: wp.array[int]):
    left[0] = left[0] - 1


@wp.kernel(enable_backward=False, grid_stride=False)
def _idle(left: wp.array[int], lanes: int):
    for i in range(wp.tid(), left[1], lanes):
        left[1] = i


def overhead(device: str, lanes: int) -> dict[str, float]:
    """Return the times of a pass through a loop in a graph, and of a launch in it [us]."""
    found = []
    for kernels in (0, _KERNELS):
        left = wp.zeros(2, dtype=int, device=device)

        def body(left: wp.array = left, kernels: int = kernels) -> None:
            for _ in range(kernels):
                wp.launch(_idle, dim=lanes, inputs=[left, lanes], device=device)
            wp.launch(_count_down, dim=1, inputs=[left], device=device)

        left.zero_()
        body()  # loads the kernels
        with wp.ScopedCapture(device) as capture:
            wp.capture_while(left, body)
        times = []
        for passes in (1, 1 + _PASSES) * 9:
            left.assign([passes, 0])
            wp.synchronize_device(device)
            start = time.perf_counter()
            wp.capture_launch(capture.graph)
            wp.synchronize_device(device)
            times.append(time.perf_counter() - start)
        found.append(1e6 * (statistics.median(times[1::2]) - statistics.median(times[::2])) / _PASSES)
    return {"pass_us": round(found[0], 2), "launch_us": round((found[1] - found[0]) / _KERNELS, 2)}


def count_waves(generator: LayoutGenerator, mask: wp.array | None) -> dict[str, Any]:
    """Return rows and candidates of each wave, and restarts at once and worlds left of each round."""
    waves: list[list[int]] = []
    rounds: list[list[int]] = []
    accept, settle = generate.launch_accept, generate.launch_settle

    def counted_accept(work: Workspace, staged: bool) -> None:
        drawn = min(int(work.search.candidates.numpy()[0]), work.search.cause.shape[0])
        waves.append([int(work.search.rows.numpy()[0]), drawn])
        accept(work, staged)

    def counted_settle(work: Workspace) -> None:
        settle(work)
        rounds.append([int(a.numpy()[0]) for a in (work.search.restarts_at_once, work.search.worlds_left)])

    with (
        patch.object(generate, "launch_accept", counted_accept),
        patch.object(generate, "launch_settle", counted_settle),
    ):
        generator.launch_generate(mask)
    return {"waves": waves, "rounds": rounds}


def time_kernels(generator: LayoutGenerator, mask: wp.array | None) -> dict[str, list[float]]:
    """Return for each kernel its launches, their sum [ms], and their median and minimum [us]."""
    times: defaultdict[str, list[float]] = defaultdict(list)
    with wp.ScopedTimer("", print=False, synchronize=True, cuda_filter=wp.TIMING_KERNEL) as timer:
        generator.launch_generate(mask)
    for launch in timer.timing_results:
        times[launch.name.removeprefix("forward kernel ")].append(1e3 * launch.elapsed)
    by_sum = sorted(times.items(), key=lambda item: -sum(item[1]))
    return {
        name: [len(us), round(sum(us) / 1e3, 3), round(statistics.median(us), 1), round(min(us), 1)]
        for name, us in by_sum
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the lines."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", metavar="SCENE:WORLDS")
    parser.add_argument("--device", default="cuda:0")
    words = parser.parse_args(arguments)
    wp.config.quiet = True
    on_gpu = wp.get_device(words.device).is_cuda
    if on_gpu:
        print(json.dumps(overhead(words.device, 1 << 16)), flush=True)
    for word in words.scenes:
        scene, _, worlds = word.rpartition(":")
        if not scene or not worlds.isdecimal():
            parser.error(f"'{word}' should be a scene and a number of worlds, such as mid:4096")
        generator = LayoutGenerator(compile_scene(scene, words.device), int(worlds))
        few = wp.array(np.arange(generator.nworld) % _EVERY == 0, dtype=bool, device=words.device)
        for share, mask in ((1.0, None), (1.0 / _EVERY, few)):
            found = {"scene": scene, "num_envs": int(worlds), "share": share} | count_waves(generator, mask)
            if on_gpu:
                found["kernels"] = time_kernels(generator, mask)
            print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
