"""The `bench` command: measures how fast layouts are made and worlds are reset."""

import resource
import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from sceniris_gym.audit.collisions import Tree
from sceniris_gym.audit.geometry import solids_of
from sceniris_gym.commands.narrowing import narrow
from sceniris_gym.device.sequence import LaunchSequence
from sceniris_gym.layout.compile import compile_scene
from sceniris_gym.layout.generate import LayoutGenerator, generator_memory
from sceniris_gym.layout.layouts import LayoutStatus
from sceniris_gym.layout.wave.search import suited_size
from sceniris_gym.program.compiled import CompiledScene
from sceniris_gym.sim.batch import Batch
from sceniris_gym.sim.randomizer import ResetRandomizer

REPEATS = 20
_WARM_UP = 3
_NARROWED = 4096  # greatest number of layouts for the measure of `reachable`
_PARTIAL = 50  # a partial reset resets one in 50 worlds


def bench(
    scene: str | Path,
    num_envs: int,
    device: str | None,
    seed: int,
    overrides: Mapping[str, Any] | None = None,
    picture: Path | None = None,
) -> dict:
    """Measure how fast layouts of a scene are made and worlds are reset, and return the figures.

    The memory that the worlds take is printed to stderr before it is allocated.

    Times are wall-clock times, with the device idle before and after. Warm times are medians of 20 replays of a
    captured graph. Rates and fractions refer to the layouts of these 20 replays.

    Args:
        scene: Name of a shipped scene, or a path.
        num_envs: Number of worlds.
        device: Warp's name of the device. None takes "cuda:0" if available, otherwise "cpu".
        seed: Seed of the first world.
        overrides: Parts of the scene to change.
        picture: PNG to write, or None. It shows the places of objects, with and without `reachable`.

    Raises:
        MemoryLimitError: The worlds do not fit into the memory of the device.
    """
    start = time.perf_counter()
    compiled = compile_scene(scene, device, overrides=overrides, cache=False)
    compiling = time.perf_counter() - start
    makes = generator_memory(compiled, suited_size(compiled, num_envs))
    batch = Batch(compiled.scene, num_envs, compiled.device, beside=[makes])
    print(f"{batch.memory}.", file=sys.stderr, flush=True)
    start = time.perf_counter()
    generator = LayoutGenerator(compiled, num_envs, seed=seed)
    generator.generate()
    wp.synchronize_device(compiled.device)
    cold = compiling + time.perf_counter() - start

    counts: Counter[str] = Counter()

    def count() -> None:
        status = generator.layouts.view.status.numpy()
        counts["valid"] += int((status == LayoutStatus.VALID).sum())
        counts["fallbacks"] += int((status == LayoutStatus.FALLBACK).sum())
        counts["candidates"] += int(generator.layouts.view.attempts.numpy().sum())
        counts["first_pass"] += int(generator.layouts.view.first_pass_valid.numpy().sum())

    graph = LaunchSequence(generator.generate, wp.get_device(compiled.device))
    warm = median_time(graph.replay, compiled.device, count)
    made = REPEATS * num_envs
    return {
        "scene": compiled.config.name,
        "hash": compiled.hash,
        "device": wp.get_device(compiled.device).name,
        "num_envs": num_envs,
        "geometry": compiled.config.geometry,
        "faces": faces(compiled),
        "attempts": compiled.attempts,
        "restarts": compiled.config.restarts,
        "cold_s": cold,
        "warm_s": warm,
        "first_pass_valid": counts["first_pass"] / made,
        "valid": counts["valid"] / made,
        "fallbacks": counts["fallbacks"],
        "valid_per_s": counts["valid"] / REPEATS / warm,
        "candidates_per_layout": counts["candidates"] / made,
        "ns_per_candidate": 1e9 * REPEATS * warm / counts["candidates"],
        **_resets(compiled, batch, generator),
        "peak_bytes": peak_bytes(compiled.device),
        **narrow(compiled, min(num_envs, _NARROWED), seed, picture),
    }


def faces(compiled: CompiledScene) -> dict[str, int]:
    """Count the triangles of each object in the scene's `geometry`. If it is `physics`, count faces of convex hulls."""
    tree = Tree(compiled.mjm, compiled.scene.bodies)
    total = dict.fromkeys(compiled.scene.bodies, 0)
    for solid in solids_of(compiled.mjm, compiled.config.geometry):
        owner = tree.owner[compiled.mjm.geom_bodyid[solid.geom]]
        if owner in total:
            total[owner] += len(solid.faces)
    return total


def peak_bytes(device: str) -> int:
    """Return the peak memory in use [bytes]: of Warp's pool on a GPU, of the process on a CPU."""
    where = wp.get_device(device)
    if where.is_cuda:
        return int(wp.get_mempool_used_mem_high(where))
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024  # kibibytes on Linux


def _resets(compiled: CompiledScene, batch: Batch, generator: LayoutGenerator) -> dict[str, float]:
    """Return the time [us] to reset all worlds and to reset 2% of them, with new layouts and kinematics."""
    randomizer = ResetRandomizer(compiled, batch.model, batch.data, layout_source=generator)
    times = {}
    for name, every in (("full_reset_us", 1), ("partial_reset_us", _PARTIAL)):
        mask = wp.array(np.arange(generator.nworld) % every == 0, dtype=bool, device=compiled.device)
        times[name] = 1e6 * median_time(partial(randomizer.reset, mask), compiled.device)
    return times


def median_time(work: Callable[[], object], device: str, after: Callable[[], object] = lambda: None) -> float:
    """Return the median time [s] of 20 runs of `work`, after 3 warm-up runs. Each of the 20 is followed by `after`."""
    times = []
    for i in range(_WARM_UP + REPEATS):
        wp.synchronize_device(device)
        start = time.perf_counter()
        work()
        wp.synchronize_device(device)
        if i >= _WARM_UP:
            times.append(time.perf_counter() - start)
            after()
    return statistics.median(times)
